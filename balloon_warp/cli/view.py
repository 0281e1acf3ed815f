"""The command `balloon-warp view`."""

import ipaddress
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from balloon_warp.cli.options import OUTPUT, Changes, Device, MeshOptions, SceneName, Set
from balloon_warp.cli.progress import Console, first_line, note, warner
from balloon_warp.scene.load import scene_name
from balloon_warp.system.warp_setup import quiet_warp

if TYPE_CHECKING:
    from balloon_warp.studio.page.page import Page


def view(
    scene: SceneName,
    *,
    open_page: Annotated[bool, typer.Option("--open", metavar="", help="Open the page in the browser.")] = False,
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            metavar="NUMBER",
            help="Port of the page. If not given, 8080 or the next free one.",
        ),
    ] = None,
    folder: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FOLDER",
            help="Folder of recordings.",
            rich_help_panel=OUTPUT,
        ),
    ] = Path("."),
    overrides: Set = None,
    mesh: MeshOptions,
    device: Device = None,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Address to listen on. With 127.0.0.1 only this machine can open the page, with 0.0.0.0 "
            "everybody in your network can.",
        ),
    ] = "127.0.0.1",
    origins: Annotated[
        list[str] | None,
        typer.Option(
            "--origin",
            metavar="https://HOST",
            help="Origin that may show the page besides this machine, such as a reverse proxy. May be repeated.",
        ),
    ] = None,
) -> None:
    """Play with a scene, or any mesh, in the browser: inflate it, pull it, throw things at it.

    Try `balloon-warp view squirrel_tether --open`.
    """
    loaded = Changes(overrides, mesh).load(scene)
    first = first_line(scene, loaded)
    quiet_warp()
    from balloon_warp.studio.page.view import view as play

    def say(page: "Page") -> None:
        if first:
            note(first)
        _say_where(page.address, scene_name(scene))
        if not _is_loopback(host):
            _say_who_may_come(page.server.get_port(), folder.resolve())

    play(
        loaded,
        name=scene_name(scene),
        device=device,
        folder=folder,
        host=host,
        port=port,
        origins=origins or [],
        open_page=open_page,
        on_start=say,
        on_warning=warner(first),
    )
    Console(emoji=False, highlight=False, soft_wrap=True).print("the page is closed")


def _say_where(address: str, name: str) -> None:
    Console(emoji=False, highlight=False, soft_wrap=True).print(f"{escape(name)} is at {address} (Ctrl-C ends it)")


def _say_who_may_come(port: int, folder: Path) -> None:
    Console(emoji=False, highlight=False, soft_wrap=True).print(
        f"[yellow]warning:[/] anyone who reaches port {port} of this machine can watch and control the page, and save "
        f"recordings into {escape(str(folder))}; it has no encryption and no login"
    )


def _is_loopback(host: str) -> bool:
    """Return whether only this machine reaches an address, or the addresses of a name."""
    places = socket.getaddrinfo(host, None)
    return all(ipaddress.ip_address(place[4][0]).is_loopback for place in places)

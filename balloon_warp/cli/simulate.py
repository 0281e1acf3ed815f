"""The commands `run` and `view`."""

import ipaddress
import json
import re
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from balloon_warp.cli.options import (
    LISTED_ELSEWHERE,
    LONG,
    OUTPUT,
    CameraOptions,
    Changes,
    Device,
    Json,
    LengthOptions,
    MeshOptions,
    RenderOptions,
    Resume,
    SceneName,
    Schedule,
    Set,
    command_line,
    own_name,
)
from balloon_warp.cli.progress import Console, Opening, counted, first_line, frame_progress, note, played, warner
from balloon_warp.errors import InputError
from balloon_warp.run.provenance import RunHeader
from balloon_warp.scene.load import scene_name
from balloon_warp.system.warp_setup import begin_driver, quiet_warp

if TYPE_CHECKING:
    from balloon_warp.run.job import Summary
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


Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help="Animation to write. USD: .usdc, .usda, .usd, .usdz. Other kinds: .glb; .abc, which needs "
        "Blender's module; .h5 for arrays; .pvd for ParaView; out.####.ply or out.####.obj for a "
        "file a frame. SCENE.usdc if not given.",
        rich_help_panel=OUTPUT,
    ),
]
Picture = Annotated[
    bool,
    typer.Option(
        "--picture",
        metavar="",
        help="Also make a picture, beside the animation. It takes the camera's options that `balloon-warp render "
        "--help` lists, such as --azimuth 90.",
        rich_help_panel=OUTPUT,
    ),
]
SavePoints = Annotated[
    Path | None,
    typer.Option(
        "--save-points",
        metavar="FILE",
        help="Also write points, edges, velocities and measures as arrays, to this .h5 file for h5py and xarray.",
        rich_help_panel=OUTPUT,
    ),
]
NoLights = Annotated[
    bool,
    typer.Option("--no-lights", metavar="", help="Omit lights, backdrop and camera.", rich_help_panel=OUTPUT),
]
NoGround = Annotated[
    bool,
    typer.Option(
        "--no-ground",
        metavar="",
        help="Omit ground and backdrop: they are so wide that a program that frames everything shows little else.",
        rich_help_panel=OUTPUT,
    ),
]
OnBlowup = Annotated[
    str,
    typer.Option(
        "--on-blowup",
        metavar="stop|freeze|restart",
        help="Action when the simulation blows up. stop: write nothing. freeze: write the frames "
        "until then. restart: restart with half the step.",
        rich_help_panel=LONG,
    ),
]
Checkpoint = Annotated[
    float,
    typer.Option(
        min=0.0,
        metavar="SECONDS",
        help="Interval between checkpoints of a long run, in FILE.partial. 0 saves on Ctrl-C alone.",
        rich_help_panel=LONG,
    ),
]
WHERE_TO = (
    "output",
    "picture",
    "save_points",
    "checkpoint",
    "resume",
    "as_json",
    "force",
    *RenderOptions.__annotations__,
)
"""Parameters that do not change the content of the stage"""


def run(
    context: typer.Context,
    scene: SceneName,
    *,
    output: Output = None,
    picture: Picture = False,
    camera: Annotated[CameraOptions, LISTED_ELSEWHERE],
    save_points: SavePoints = None,
    no_lights: NoLights = False,
    no_ground: NoGround = False,
    overrides: Set = None,
    length: LengthOptions,
    mesh: MeshOptions,
    device: Device = None,
    schedule: Schedule = "auto",
    on_blowup: OnBlowup = "stop",
    checkpoint: Checkpoint = 30.0,
    resume: Resume = False,
    as_json: Json = False,
) -> None:
    """Simulate a scene, or any mesh, and write it as animated USD.

    Try `balloon-warp run squirrel_tether --picture`, then `balloon-warp run YOUR_MESH.obj --picture`.
    """
    asked = camera.asked()
    if any(asked.values()) and not picture:
        name = next(name for name, value in asked.items() if value)
        raise InputError(f"--{name.replace('_', '-')}: needs --picture")
    loaded = Changes(overrides, mesh, length).load(scene)
    name = scene_name(scene)
    usual = f"{name}_balloon.usdc" if Path(scene).suffix.startswith(".usd") else f"{name}.usdc"
    stage = output or own_name(Path(usual), loaded)
    beside = own_name(picture_beside(stage), loaded) if picture else None
    begin_driver(device)
    from balloon_warp.studio.animate import animate  # loads Warp and USD: only once the scene is known to be good

    with frame_progress() as progress:
        task = progress.add_task(escape(name), total=loaded.frames)
        first = first_line(scene, loaded)
        opening = Opening(name, first)

        def begin(header: RunHeader) -> None:
            about_substeps = header.strain_bound, header.many_substeps
            opening.add(progress.begin(task, header), *about_substeps, then=header.coarse)

        summary = animate(
            loaded,
            stage,
            name=name,
            picture=beside,
            save_points=save_points,
            lights=not no_lights,
            ground=not no_ground,
            device=device,
            schedule=schedule,
            on_blowup=on_blowup,
            provenance={"command": command_line(context, WHERE_TO)},
            checkpoint_seconds=checkpoint,
            resume=resume,
            view=asked,
            on_begin=begin,
            on_frame=opening.before(lambda number: progress.update(task, completed=number)),
            on_note=opening.before(note),
            on_warning=opening.before(warner(first)),
        )
    if as_json:
        print(json.dumps(summary.as_json()))
    else:
        _print_summary(summary, loaded.frames_per_second)


def _lasting(summary: "Summary", rate: float) -> str:
    """Return the duration of the stage, and the frame rate to set in Blender."""
    kind = Path(summary.output).suffix.lower()
    if kind in (".obj", ".ply"):
        return f"{counted(summary.frames + 1, 'file')}, {rate:g} per second"
    return played(summary.frames, rate, hint=kind.startswith((".usd", ".abc")))


def picture_beside(output: Path) -> Path:
    """Return the path of an output's picture; the output's name may have #### for frames."""
    return output.with_name(f"{re.sub('[.]?#+', '', output.stem, count=1) or 'picture'}.png")


def _print_summary(summary: "Summary", rate: float) -> None:
    """Print the summary and the paths of the outputs.

    Args:
        rate: frames a second of the stage.
    """
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    resumed = f", the last {summary.frames - summary.begin}" if summary.begin else ""
    where = f"on {summary.device}, schedule {summary.schedule}"
    console.print(
        f"{summary.scene}: {counted(summary.particles, 'particle')}, {counted(summary.springs, 'spring')}, "
        f"{counted(summary.frames, 'frame')} of {counted(summary.substeps, 'substep')}{resumed} in "
        f"{summary.wall_seconds:.1f} s {where}",
        markup=False,
    )
    console.print(f"wrote {summary.output}: {_lasting(summary, rate)}", markup=False)
    if summary.points:
        console.print(f"wrote {summary.points}", markup=False)
    if summary.picture:
        console.print(f"wrote {summary.picture}", markup=False)

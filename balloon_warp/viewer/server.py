"""The server of a page: guarded, in our colors, at a port that is free."""

import contextlib
import io
import socket
from collections.abc import Callable, Sequence
from typing import Any

import viser

from balloon_warp.errors import InputError
from balloon_warp.viewer import colors
from balloon_warp.viewer.guard import guarded
from balloon_warp.viewer.origins import Origins

DEFAULT_PORT = 8080


def guarded_server(
    host: str, port: int | None, origins: Sequence[str], on_refused: Callable[[str], None]
) -> viser.ViserServer:
    """Serve an empty page; see `Page`.

    Raises:
        InputError: it cannot be served there, or an origin is none.
    """
    made: list[viser.ViserServer] = []

    def control(uuid: str) -> Any:
        """Return the control of the panel that has an id."""
        return made[0].gui._gui_input_handle_from_uuid.get(uuid) if made else None

    trusted = Origins(origins, on_refused)
    port = free_port(host, port)
    with guarded(host, control, trusted), contextlib.redirect_stdout(io.StringIO()):  # viser says where it is, too
        made.append(viser.ViserServer(host=host, port=port, label="Balloon Warp", verbose=False))
    server = made[0]
    server.request_share_url = _refuse_to_share  # a page's message would open this machine to the internet
    server.gui.configure_theme(brand_color=colors.BRAND, show_logo=False, show_share_button=False)
    server.gui.set_panel_label("Balloon Warp")
    server.gui.main_panel.dock_right()
    return server


def address_of(server: viser.ViserServer) -> str:
    """Return the address of the page."""
    host = server.get_host()
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://{f'[{host}]' if ':' in host else host}:{server.get_port()}"


def close(server: viser.ViserServer) -> None:
    """Stop to serve, without a word."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def free_port(host: str, port: int | None) -> int:
    """Return a port that can be listened on: the given one, or the first free one from `DEFAULT_PORT` on.

    Raises:
        InputError: there is no such address, or the port is taken.
    """
    reason = ""
    for candidate in [port] if port is not None else range(DEFAULT_PORT, DEFAULT_PORT + 100):
        try:
            family = socket.getaddrinfo(host, candidate)[0][0]
            with socket.socket(family) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((host, candidate))
                return probe.getsockname()[1]
        except OSError as error:
            reason = error.strerror or str(error)
    named = f"--port {port}" if port is not None else f"--host {host}"
    raise InputError(f"{named}: cannot listen on {host}: {reason}")


def _refuse_to_share(*_: object, **__: object) -> None:
    return None

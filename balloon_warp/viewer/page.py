"""The page: a server, what it draws and what is clicked in it. Several windows see, and do, the same."""

import contextlib
import functools
import io
import socket
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser

from balloon_warp.errors import InputError
from balloon_warp.viewer import colors
from balloon_warp.viewer.ahead import Ahead
from balloon_warp.viewer.controls import Controls
from balloon_warp.viewer.following import Follower, go_home, look_at
from balloon_warp.viewer.guard import guarded
from balloon_warp.viewer.layers import Layers
from balloon_warp.viewer.origins import Origins
from balloon_warp.viewer.picture import Picture
from balloon_warp.viewer.plots import Plots
from balloon_warp.viewer.pointing import Pointing, drag
from balloon_warp.viewer.saving import Done
from balloon_warp.viewer.session import SHOWN_SECONDS, Session

DEFAULT_PORT = 8080
BUSY_SECONDS = 0.4
"""Time that a request may take before the panel says so [s]"""
PANEL_SECONDS = 0.2
"""Time between two updates of the panel and the plots [s]"""


class Page:
    """Shows a session, and lets it be played with.

    Args:
        session: it is started and stopped with the page.
        host: address to listen on.
        port: to listen on; the first free one from `DEFAULT_PORT` on, when missing.
        origins: that it may be shown from beside its own address, such as a proxy's: "https://hub.example".
        on_refused: told once of each other origin that a browser says, in a sentence.

    Raises:
        InputError: the page cannot be served there, or an origin is none.
    """

    def __init__(
        self,
        session: Session,
        host: str = "127.0.0.1",
        port: int | None = None,
        origins: Sequence[str] = (),
        on_refused: Callable[[str], None] = lambda sentence: print(sentence, file=sys.stderr),
    ):
        self.session = session
        trusted = Origins(origins, on_refused)
        port = _free_port(host, port)
        with (
            guarded(host, self._control, trusted),
            contextlib.redirect_stdout(io.StringIO()),
        ):  # viser says where it is, too
            self.server = viser.ViserServer(host=host, port=port, label="Balloon Warp", verbose=False)
        self.server.request_share_url = _refuse_to_share  # a page's message would open this machine to the internet
        self.server.gui.configure_theme(brand_color=colors.BRAND, show_logo=False, show_share_button=False)
        self.server.gui.set_panel_label("Balloon Warp")
        self.server.gui.main_panel.dock_right()
        self.follower, self.ahead = Follower(), Ahead()
        self.layers = Layers(self.server, functools.partial(drag, session))
        self.controls = Controls(self.server, session, self.layers, self._look)
        with self.controls.plots_folder:
            self.plots = Plots(self.server)
        self.pointing = Pointing(self.server, session, self.layers, self.controls)
        self.server.on_client_connect(self._welcome)
        self.server.on_client_disconnect(self._farewell)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._show, name="page", daemon=True)

    @property
    def address(self) -> str:
        """Address of the page."""
        host = self.server.get_host()
        host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
        return f"http://{f'[{host}]' if ':' in host else host}:{self.server.get_port()}"

    def start(self) -> None:
        """Draw the start, and begin."""
        self.layers.draw(self.session.picture)
        self.controls.follow(self.session.picture)
        self.session.start()
        self._thread.start()

    def stop(self) -> None:
        """End the simulation and the server."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        self.ahead.end()
        self.session.stop()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    def _control(self, uuid: str) -> Any:
        """Return the control of the panel that has an id."""
        return self.server.gui._gui_input_handle_from_uuid.get(uuid)

    def _show(self) -> None:
        """Draw the newest picture, whenever there is one and somebody looks; runs in the drawing thread."""
        drawn, panel_at, prepared = None, 0.0, 0
        np.seterr(over="ignore", invalid="ignore")  # on this thread: the page says what blew up, not the terminal
        while not self._stop.wait(SHOWN_SECONDS / 2):
            self.session.watched = bool(self.server.get_clients())
            picture, busy = self.session.picture, self.session.busy_seconds
            if self.session.watched and busy > BUSY_SECONDS and time.perf_counter() - panel_at >= PANEL_SECONDS:
                panel_at = time.perf_counter()
                self.controls.wait(picture, busy)
            if picture is drawn or not self.session.watched:
                continue
            self.layers.draw(picture)
            self.follower.follow(self.server.get_clients(), self._center(picture))
            drawn = picture
            if picture.load != prepared and picture.frame.number > 0:  # its own kernels are there, and do not wait
                prepared = picture.load
                self.ahead.begin(picture.model.scene, str(picture.model.device), self.session.laws)
            now = time.perf_counter()
            if now - panel_at >= PANEL_SECONDS:
                panel_at = now
                self.controls.follow(picture)
                self.plots.add(picture, self.layers.drawing.measures(picture))
            while self.session.notices:
                self._tell(self.session.notices.popleft())

    def _tell(self, sentence: str) -> None:
        for client in self.server.get_clients().values():
            color = "green" if isinstance(sentence, Done) else "red"
            client.add_notification("Balloon Warp", str(sentence), auto_close_seconds=8.0, color=color)

    async def _welcome(self, client: viser.ClientHandle) -> None:
        go_home(client.camera, *self.layers.home)

    def _look(self, client: viser.ClientHandle) -> None:
        """Turn a window to the balloons where they are now, as far away as at first, and follow them; or stay."""
        if self.follower.follows(client):
            self.follower.end(client)
            return
        home, middle = self.layers.home
        away = np.asarray(client.camera.position) - np.asarray(client.camera.look_at)
        away *= np.linalg.norm(home - middle) / max(float(np.linalg.norm(away)), 1e-9)
        look_at(client, self._center(self.session.picture), away)
        self.follower.begin(client)

    @staticmethod
    def _center(picture: Picture) -> np.ndarray:
        """Return the center of all balloons [m], shape (3,)."""
        return np.concatenate(picture.frame.points).mean(axis=0, dtype=np.float64)

    async def _farewell(self, client: viser.ClientHandle) -> None:
        """Release what a window holds when it leaves."""
        self.session.ask(lambda playground: playground.release(client.client_id))


def _refuse_to_share(*_: object, **__: object) -> None:
    return None


def _free_port(host: str, port: int | None) -> int:
    """Return a port that can be listened on.

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

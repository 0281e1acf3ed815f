"""The page: server, drawings, clicks and drags, of a session or of a world that a program advances."""

import functools
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser

from balloon_warp.errors import InputError
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator
from balloon_warp.studio.page import drawings
from balloon_warp.studio.page.controls import Controls, Plots
from balloon_warp.studio.page.drawings import (
    Follower,
    go_home,
    ground_distance,
    hit_distance,
    nearest_particle,
    throw_at,
)
from balloon_warp.studio.page.layers import Layers
from balloon_warp.studio.page.playground import KernelPrecompiler, Playground, Touch
from balloon_warp.studio.page.server import address_of, close, guarded_server
from balloon_warp.studio.page.session import (
    SHOWN_SECONDS,
    Done,
    Pace,
    Picture,
    Session,
)

NEAREST = 0.4
"""Least distance of a sphere's start from the camera, over the distance to its target, so that it does not fill the
view"""


class Pointing:
    """Pointer event handlers of the page's view: clicks, and drags by `drag`.

    Args:
        server: of the page.
        session: of the simulation.
        layers: of the view.
        controls: which choose the action of a click.
    """

    def __init__(self, server: viser.ViserServer, session: Session, layers: Layers, controls: Controls):
        self.session, self.layers, self.controls = session, layers, controls
        server.scene.on_click()(self._click)

    def _click(self, event: Any) -> None:
        """Throw or tie, where a click points."""
        origin, direction = np.array(event.ray_origin, float), np.array(event.ray_direction, float)
        tool = self.controls.tool.value
        if tool == "throws a sphere":
            self._throw(origin, direction)
        elif tool == "ties a string":
            self.session.ask(lambda playground: self._tie(playground, origin, direction), touch=Touch.TIES)

    def _throw(self, origin: np.ndarray, direction: np.ndarray) -> None:
        """Throw a sphere from before the camera to the place that the click points at.

        It is drawn at once, and simulated as soon as possible.
        """
        picture, size = self.session.picture, self.session.playground.size
        points, scene = np.concatenate(picture.frame.points), picture.scene
        radius = self.controls.radius.value * size
        on_balloon = hit_distance(origin, direction, points, self.layers.drawing.all_triangles)
        on_obstacle = self.layers.obstacles.hit_distance(origin, direction)
        hit = min((each for each in (on_balloon, on_obstacle) if each is not None), default=None)
        if hit is None and scene.ground:
            hit = ground_distance(origin, direction, scene.up, scene.ground.height)
        if hit is None:
            hit = float((points.mean(axis=0) - origin) @ direction)
        target = origin + hit * direction
        start = origin + max(hit - 1.2 * size - radius, NEAREST * hit) * direction
        if scene.ground:  # not from below it
            up = np.array(scene.up)
            start = start + max(scene.ground.height + 1.01 * radius - start @ up, 0.0) * up
        velocity = throw_at(target, start, self.controls.throw_speed.value * size, scene.gravity, scene.up)
        mass = float(self.controls.mass.value)
        self.session.ask(lambda playground: playground.throw(start, velocity, radius, mass), touch=Touch.THROWS)
        color = drawings.sphere_color(len(self.session.playground.journal.spheres), None)
        self.layers.draw_pending_sphere(start, radius, color, self.session.asked)

    def _tie(self, playground: Playground, origin: np.ndarray, direction: np.ndarray) -> None:
        """Tie a string from the ground, or from below, to the particle that the click points at."""
        scene, points = playground.live, playground.points
        hit = hit_distance(origin, direction, points, self.layers.drawing.all_triangles)
        if hit is None:
            raise InputError("click on a balloon to tie a string to it")
        particle = nearest_particle(points, origin + hit * direction)
        up, place = np.array(scene.up), points[particle].astype(float)
        drop = place @ up - scene.ground.height if scene.ground else playground.size
        playground.tie(particle, place - max(drop, 0.1 * playground.size) * up)


async def drag(session: Session, event: Any) -> None:
    """Pull at the particle where a drag began."""
    who, phase = event.client_id, event.phase
    start, place = np.array(event.start_position, float), np.array(event.end_position, float)
    if phase == "start":
        session.ask(
            lambda playground: playground.grab(who, nearest_particle(playground.points, start), place), touch=Touch.TIES
        )
    elif phase == "update":
        session.ask(lambda playground: playground.pull(who, place), key=("pull", who), touch=Touch.TIES)
    else:
        session.ask(lambda playground: playground.release(who), touch=Touch.RELEASES)


class Onlooker:
    """Shows a world of a simulator as it is whenever `show` is called.

    Args:
        simulator: of the world.
        world: its number.
        host: address to listen on.
        port: to listen on; 8080 or the next free one, when missing.
        open_page: whether to open the page in the browser.
        on_note: told in a sentence where the page is, and who asks for it and is refused.

    Raises:
        InputError: there is no such world, or the page cannot be served there.
    """

    def __init__(
        self,
        simulator: Simulator,
        world: int = 0,
        *,
        host: str = "127.0.0.1",
        port: int | None = None,
        open_page: bool = True,
        on_note: Callable[[str], None] = lambda sentence: print(sentence, file=sys.stderr),
    ):
        simulator.model.require_world(world)
        self._simulator, self._world = simulator, world
        self._model, self._pace = simulator.model.of_world(world, copied=False), Pace()
        self.server = guarded_server(host, port, (), on_note)
        self.layers = Layers(self.server)
        self.layers.draw(self._picture())
        self.server.on_client_connect(self._welcome)
        on_note(f"world {world} is shown at {self.address}")
        if open_page:
            webbrowser.open(self.address)

    @property
    def address(self) -> str:
        """Address of the page."""
        return address_of(self.server)

    def show(self, seconds: float = 0.0) -> None:
        """Draw the world, where somebody looks, no sooner than it would be there in real time.

        Args:
            seconds: that were simulated since the last time.
        """
        if self.server.get_clients():
            self.layers.draw(self._picture())
            time.sleep(self._pace.wait(time.perf_counter(), seconds) if seconds else 0.0)

    def stop(self) -> None:
        """End the server."""
        close(self.server)

    def _picture(self) -> Picture:
        frame, scene = self._simulator.read_frame(self._world), self._model.scene
        return Picture(
            load=1,
            revision=1,
            executed=0,
            name="",
            model=self._model,
            scene=scene,
            frame=frame,
            seconds=frame.number * self._model.frame_seconds,
            sphere_numbers=tuple(range(len(scene.sphere))),
            hands=frozenset(),
            inflation=1.0,
            running=True,
            speed=self._pace.speed,
            rate=0.0,
            step_seconds=0.0,
            schedule=self._simulator.schedule.name,
            trouble="",
            why="",
            recorded_seconds=None,
        )

    async def _welcome(self, client: viser.ClientHandle) -> None:
        go_home(client.camera, *self.layers.home)


BUSY_SECONDS = 0.6
"""Time that a request may take before the panel says so [s]"""
SLOW = 3.0
"""Factor on the time that a frame takes by which one must be late before the panel says so"""
PANEL_SECONDS = 0.2
"""Time between two updates of the panel and the plots [s]"""


class Page:
    """Shows a session, and lets it be played with.

    Args:
        session: it is started and stopped with the page.
        host: address to listen on.
        port: to listen on; 8080 or the next free one, when missing.
        origins: Origins that may show the page besides its own address, such as a proxy: "https://hub.example".
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
        self.server = guarded_server(host, port, origins, on_refused)
        self.follower, self.ahead = Follower(), KernelPrecompiler()
        session.is_ready, session.prepare = lambda kinds: self.ahead.has(kinds), self._prepare
        self.layers = Layers(self.server, functools.partial(drag, session))
        self.controls = Controls(self.server, session, self.layers, self._look, self._go_home)
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
        return address_of(self.server)

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
        close(self.server)

    def _show(self) -> None:
        """Draw the newest picture, whenever there is one and somebody looks; runs in the drawing thread."""
        drawn, panel_at, prepared = None, 0.0, 0
        np.seterr(over="ignore", invalid="ignore")  # on this thread: the page reports a blow-up, not the terminal
        while not self._stop.wait(SHOWN_SECONDS / 2):
            self.session.watched = bool(self.server.get_clients())
            picture, busy = self.session.picture, self.session.busy_seconds
            busy = busy if busy > BUSY_SECONDS + SLOW * picture.step_seconds else 0.0
            if self.session.watched and busy and time.perf_counter() - panel_at >= PANEL_SECONDS:
                panel_at = time.perf_counter()
                self.controls.wait(picture, busy)
            if picture is drawn or not self.session.watched:
                continue
            self.layers.draw(picture)
            self.follower.follow(self.server.get_clients(), self._center(picture))
            drawn = picture
            if picture.load != prepared and picture.frame.number > 0:  # its own kernels are there, and do not wait
                prepared = picture.load
                self._prepare(picture.model.scene)
            now = time.perf_counter()
            if now - panel_at >= PANEL_SECONDS:
                panel_at = now
                self.controls.follow(picture, busy)
                self.plots.add(picture, self.layers.drawing.measures(picture))
            while self.session.notices:
                self._tell(self.session.notices.popleft())

    def _prepare(self, scene: Scene) -> None:
        """Compile the kernels that playing with a scene takes, beside the simulation."""
        device = str(self.session.picture.model.device)
        self.ahead.begin(scene, device, self.session.laws, self.session.kernels_came)

    def _tell(self, sentence: str) -> None:
        for client in self.server.get_clients().values():
            color = "green" if isinstance(sentence, Done) else "red"
            client.add_notification("Balloon Warp", str(sentence), auto_close_seconds=8.0, color=color)

    async def _welcome(self, client: viser.ClientHandle) -> None:
        self._go_home(client)

    def _go_home(self, client: viser.ClientHandle) -> None:
        go_home(client.camera, *self.layers.home)

    def _look(self, client: viser.ClientHandle) -> None:
        """Turn a window to the balloons where they are now, as far away as at first, and follow them; or stay."""
        home, middle = self.layers.home
        self.follower.toggle(client, self._center(self.session.picture), float(np.linalg.norm(home - middle)))

    @staticmethod
    def _center(picture: Picture) -> np.ndarray:
        """Return the center of all balloons [m], shape (3,)."""
        return np.concatenate(picture.frame.points).mean(axis=0, dtype=np.float64)

    async def _farewell(self, client: viser.ClientHandle) -> None:
        """Release the points that a window holds when it closes."""
        self.session.ask(lambda playground: playground.release(client.client_id), touch=Touch.RELEASES)

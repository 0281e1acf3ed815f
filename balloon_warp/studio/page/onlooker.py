"""A page on which one sees a world that a program advances, such as an environment's; nothing is done to it there."""

import sys
import time
import webbrowser
from collections.abc import Callable

import viser

from balloon_warp.simulator import Simulator
from balloon_warp.studio.page.camera import go_home
from balloon_warp.studio.page.layers import Layers
from balloon_warp.studio.page.recording import Picture
from balloon_warp.studio.page.server import address_of, close, guarded_server
from balloon_warp.studio.page.session import Pace


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
            granted=0,
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

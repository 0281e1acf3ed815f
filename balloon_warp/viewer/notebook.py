"""The page in a notebook's cell."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from balloon_warp.simulator import Simulator
from balloon_warp.viewer.view import make_page
from balloon_warp.warp_lock import lock_of

if TYPE_CHECKING:
    from balloon_warp.viewer.page import Page


class Shown:
    """A page that is served until it is closed, or the process ends. As the last line of a cell it is seen there.

    Args:
        page: that is started.
        size: width, as CSS has it, and height in pixels.
    """

    def __init__(self, page: "Page", size: tuple[str, int]):
        self.page, self.size = page, size

    @property
    def address(self) -> str:
        """Address of the page, for a window of its own."""
        return self.page.address

    def close(self) -> None:
        """End the simulation and the page; a recording that goes on is saved."""
        self.page.stop()

    def _repr_html_(self) -> str:
        width, height = self.size
        return (
            f'<iframe src="{escape(self.address)}" title="Balloon Warp" '
            f'style="width: {escape(width)}; height: {height}px; border: 0"></iframe>'
        )

    def __repr__(self) -> str:
        return f"Shown({self.address})"


def show(
    simulator: Simulator,
    world: int = 0,
    *,
    folder: str | Path = ".",
    width: str = "100%",
    height: int = 640,
    origins: Sequence[str] = (),
) -> Shown:
    """Serve one world of a simulator in the page of `balloon-warp view`, to play with.

    As the last line of a notebook's cell it is seen there, elsewhere its `address` says where to look. It begins where
    the world is now, in a simulation of its own, with the scene's values, and runs until it is closed: `shown.close()`.

    Args:
        folder: Folder of recordings.
        width: Width in the notebook, in CSS, such as "100%" or "800px".
        height: Height in pixels.
        origins: Origins that may show the page besides this machine, such as a proxy: ["https://hub.example"].

    Raises:
        InputError: there is no such world, the folder is not there, or the page cannot be served.
        MissingExtraError: viser is not installed.
    """
    model = simulator.model
    model.require_world(world)
    with lock_of(model.device):
        now = {name: array.numpy() for name, array in simulator.state.of_world(world).arrays.items()}
    page = make_page(model.scene, "scene", str(model.device), folder, model.own_laws, origins=origins)
    page.session.begin_at(now)
    page.start()
    return Shown(page, (width, height))

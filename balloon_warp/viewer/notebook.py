"""The page in a notebook's cell."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import NDArray

from balloon_warp.kernels.laws import Law
from balloon_warp.scene import Scene
from balloon_warp.viewer.view import make_page

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
        """where the page is, for a window of its own"""
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
    scene: Scene,
    name: str,
    device: str,
    laws: Sequence[Law],
    folder: str | Path,
    size: tuple[str, int],
    now: Mapping[str, NDArray] | None = None,
    origins: Sequence[str] = (),
) -> Shown:
    """Serve a page, see `view`, and go on.

    Args:
        origins: that it may be shown from beside its own address.
        now: where it begins, as `Simulator.restore` takes it; the scene's start when missing.

    Raises:
        InputError: the scene cannot be simulated, the folder is not there, or the page cannot be served.
        MissingExtraError: viser is not installed.
    """
    page = make_page(scene, name, device, folder, laws, origins=origins)
    if now is not None:
        page.session.begin_at(now)
    page.start()
    return Shown(page, size)

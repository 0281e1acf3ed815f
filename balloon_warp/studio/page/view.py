"""A session in a page, from a script, the command line or a notebook's cell."""

import threading
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.kernels.laws import Law
from balloon_warp.scene import SceneLike, scene_of
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_threads import lock_of

if TYPE_CHECKING:
    from balloon_warp.studio.page.page import Onlooker, Page


def view(
    scene: SceneLike,
    *,
    name: str = "scene",
    device: str | None = None,
    folder: str | Path = ".",
    host: str = "127.0.0.1",
    port: int | None = None,
    origins: Sequence[str] = (),
    open_page: bool = True,
    laws: Sequence[Law] = (),
    on_start: Callable[["Page"], None] = lambda page: None,
    on_warning: Callable[[str], None] = lambda sentence: None,
) -> None:
    """Play with a scene in the browser, until Ctrl-C.

    Args:
        scene: Scene to start with, or a source that `load_scene` takes.
        name: Name of the scene on the page and in recordings.
        device: Warp device; the GPU, or else the CPU, if not given.
        folder: Folder of recordings.
        host: Address to listen on; this machine alone if not given.
        port: Port; 8080 or the next free one if not given.
        origins: Origins that may show the page besides its own address, such as a proxy: ["https://hub.example"].
        open_page: Whether to open the page in the browser.
        laws: User-defined laws beside the built-in ones; see `balloon_warp.laws`. Their parameters have sliders.
        on_start: Called with the page once it is served.
        on_warning: called with sentences on odd meshes and their treatment, on strings that start overstretched, on
            spheres that may come through, and on origins that ask for the page and are refused.

    Raises:
        InputError: the scene cannot be simulated, the folder is not there, or the page cannot be served.
        MissingExtraError: viser is not installed.
    """
    page = make_page(scene, name, device, folder, laws, host=host, port=port, origins=origins, on_refused=on_warning)
    for warning in page.session.playground.simulator.model.warnings:
        on_warning(warning)
    try:
        page.start()
        on_start(page)
        if open_page:
            webbrowser.open(page.address)
        threading.Event().wait()
    except KeyboardInterrupt:
        page.stop()


def make_page(
    scene: SceneLike,
    name: str,
    device: str | None,
    folder: str | Path,
    laws: Sequence[Law],
    *,
    host: str = "127.0.0.1",
    port: int | None = None,
    **who: Any,
) -> "Page":
    """Make a page that is served, and not started yet; see `view`.

    Args:
        who: may talk to it, as `Page` takes it: `origins` and `on_refused`.

    Raises:
        InputError: the scene cannot be simulated, the folder is not there, or the page cannot be served.
        MissingExtraError: viser is not installed.
    """
    scene = scene_of(scene)
    if not Path(folder).is_dir():
        raise InputError(f"{folder}: the folder does not exist")
    with _needing_viser():
        from balloon_warp.studio.page.page import Page
    from balloon_warp.studio.page.session import Session

    return Page(Session(name, scene, device, Path(folder).resolve(), laws), host, port, **who)


def look_on(simulator: Simulator, world: int = 0, **options: Any) -> "Onlooker":
    """Serve a page that shows a world of a simulator while a program advances it, and open it in the browser.

    Args:
        options: as `Onlooker` takes them.

    Raises:
        InputError: there is no such world, or the page cannot be served.
        MissingExtraError: viser is not installed.
    """
    with _needing_viser():
        from balloon_warp.studio.page.page import Onlooker
    return Onlooker(simulator, world, **options)


@contextmanager
def _needing_viser() -> Iterator[None]:
    """Load modules that need viser, or say that it is missing."""
    try:
        yield
    except ModuleNotFoundError as missing:
        if missing.name != "viser":
            raise
        raise MissingExtraError("view needs viser: pip install 'balloon-warp[view]'") from None


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

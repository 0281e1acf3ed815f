"""A session in a page, from a script or the command line."""

import threading
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.kernels.laws import Law
from balloon_warp.scene import SceneLike, scene_of
from balloon_warp.simulator import Simulator

if TYPE_CHECKING:
    from balloon_warp.viewer.onlooker import Onlooker
    from balloon_warp.viewer.page import Page


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
        from balloon_warp.viewer.page import Page
    from balloon_warp.viewer.session import Session

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
        from balloon_warp.viewer.onlooker import Onlooker
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

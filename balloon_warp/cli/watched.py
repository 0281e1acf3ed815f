"""The page of a design, for the time of a `with` block and for as long as somebody looks."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from rich.markup import escape

from balloon_warp.cli.console import Console
from balloon_warp.cli.warn import warn
from balloon_warp.errors import MissingExtraError

if TYPE_CHECKING:
    from balloon_warp.designing.step import DesignStep


@contextmanager
def watched(view: bool, port: int | None, name: str) -> "Iterator[Callable[[DesignStep], None]]":
    """Draw the steps that it gets into a page, which stays after the block until Ctrl-C; or do nothing with them.

    Args:
        view: whether it is wanted.
        port: of the page; 8080 or the next free one, when missing.
        name: of the design.

    Raises:
        InputError: the page cannot be served.
        MissingExtraError: viser is not installed.
    """
    if not view:
        yield lambda step: None
        return
    try:
        from balloon_warp.designing.page import DesignPage
    except ModuleNotFoundError as missing:
        if missing.name != "viser":
            raise
        raise MissingExtraError("--view needs viser: pip install 'balloon-warp[view]'") from None
    page, console = DesignPage(port=port, on_refused=warn), Console(emoji=False, highlight=False, soft_wrap=True)
    try:
        console.print(f"{escape(name)} is at {page.address}")
        yield page.show
        console.print("Ctrl-C closes the page")
        with suppress(KeyboardInterrupt):
            stay()
    finally:
        page.stop()


def stay() -> None:
    """Wait for Ctrl-C."""
    threading.Event().wait()

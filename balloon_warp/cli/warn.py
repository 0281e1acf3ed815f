"""Warnings and notes on a user's terminal."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from rich.markup import escape

from balloon_warp.cli.console import Console
from balloon_warp.mesh.units import NO_AXIS
from balloon_warp.scene import Scene, bundled_scenes


def warn(sentence: str) -> None:
    """Print a warning on standard error, where no program reads results."""
    Console(emoji=False, stderr=True, highlight=False, soft_wrap=True).print(f"[yellow]warning:[/] {escape(sentence)}")


def note(sentence: str) -> None:
    """Print a note on standard error, where no program reads results."""
    Console(emoji=False, stderr=True, highlight=False, soft_wrap=True).print(f"[cyan]note:[/] {escape(sentence)}")


class Opening:
    """First line of a run about its mesh, printed before any other; a run that does not begin prints its error alone.

    Args:
        name: of the simulated scene.
        sentence: a note on it, if there is one.
    """

    def __init__(self, name: str, sentence: str | None):
        self._name, self._sentence, self._more = name, sentence, ""
        self._then: str | None = None

    def add(self, *more: str | None, then: str | None = None) -> None:
        """Take further sentences of the line, and a note below it."""
        self._more, self._then = ". ".join(filter(None, more)), then

    def before(self, listener: Callable[..., Any]) -> Callable[..., None]:
        """Return a listener that says the line, if nobody did, before it hears anything."""

        def listen(*words: Any) -> None:
            self._say()
            listener(*words)

        return listen

    def _say(self) -> None:
        sentence, more, then = self._sentence, self._more, self._then
        self._sentence, self._more, self._then = None, "", None
        if sentence:
            note(f"{sentence}. {more}" if more else sentence)
        elif more:
            Console(emoji=False, stderr=True, highlight=False, soft_wrap=True).print(
                f"{self._name}: {more}", markup=False
            )
        if then:
            note(then)


def unsaid(first: str | None, sentences: Iterable[str]) -> list[str]:
    """Return the warnings without those on the up axis, which the first line about a mesh by itself has named."""
    if first is None or NO_AXIS not in first:
        return [*sentences]
    return [each for each in sentences if NO_AXIS not in each or not first.startswith(each.partition(":")[0])]


def warner(first: str | None) -> Callable[[str], None]:
    """Return a listener that prints the warnings that the first line has not named."""

    def listen(sentence: str) -> None:
        for each in unsaid(first, [sentence]):
            warn(each)

    return listen


def first_line(source: str, scene: Scene) -> str | None:
    """Return the first line about a mesh by itself: its default scene."""
    return None if source in bundled_scenes() or Path(source).suffix.lower() == ".toml" else scene.description

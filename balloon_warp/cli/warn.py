"""Warnings and notes on a user's terminal."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from balloon_warp.mesh.units import NO_AXIS
from balloon_warp.scene import Scene, bundled_scenes


def warn(sentence: str) -> None:
    """Print a warning on standard error, where no program reads results."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(f"[yellow]warning:[/] {escape(sentence)}")


def note(sentence: str) -> None:
    """Print what is good to know, where no program reads results."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(f"[cyan]note:[/] {escape(sentence)}")


def opened_by(sentence: str | None, *listeners: Callable[..., Any]) -> list[Callable[..., None]]:
    """Listeners of which the first that is told anything notes that sentence before, if there is one: where nothing
    begins there is nothing to say but what is wrong."""
    waiting = [sentence] if sentence else []

    def opened(listener: Callable[..., Any]) -> Callable[..., None]:
        def listen(*words: Any) -> None:
            while waiting:
                note(waiting.pop())
            listener(*words)

        return listen

    return [opened(listener) for listener in listeners]


def unsaid(first: str | None, sentences: Iterable[str]) -> list[str]:
    """Leave out of warnings what the first line about a mesh by itself has said: which axis of it is up."""
    if first is None or NO_AXIS not in first:
        return [*sentences]
    return [each for each in sentences if NO_AXIS not in each or not first.startswith(each.partition(":")[0])]


def warner(first: str | None) -> Callable[[str], None]:
    """Make a listener that warns of what the first line has not said."""

    def listen(sentence: str) -> None:
        for each in unsaid(first, [sentence]):
            warn(each)

    return listen


def first_line(source: str, scene: Scene) -> str | None:
    """The first line about a mesh by itself: what scene it got."""
    return None if source in bundled_scenes() or Path(source).suffix.lower() == ".toml" else scene.description

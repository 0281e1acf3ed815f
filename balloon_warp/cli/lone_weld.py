"""`--weld`, which may stand alone or before a number."""

from itertools import zip_longest
from typing import Any

from typer.core import TyperCommand

from balloon_warp.cli.addresses import require_addresses
from balloon_warp.errors import InputError
from balloon_warp.mesh.prepare import LARGEST_GAP, LEAST_GAP

EXACT = "exact"
"""Value of `--weld` without a number, which may also be typed"""


class Command(TyperCommand):
    """A command whose `--weld` may stand alone: the next word is its value only if it is a number."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, with_values(args))

    def invoke(self, ctx: Any) -> Any:
        require_addresses()  # before the command loads modules that would not find room
        return super().invoke(ctx)


def with_values(words: list[str]) -> list[str]:
    """Return the words of a command line, with a value after each `--weld` that has none."""
    end = words.index("--") if "--" in words else len(words)
    filled: list[str] = []
    for word, following in zip_longest(words[:end], words[1:end]):
        filled += [word, EXACT] if word == "--weld" and following != EXACT and _number(following) is None else [word]
    return filled + words[end:]


def weld_of(said: str | None) -> bool | float | None:
    """Return the value of the scene's field for `--weld`.

    Raises:
        InputError: it is neither alone nor such a part.
    """
    if said in (None, EXACT):
        return None if said is None else True
    gap = _number(said)
    if gap is None or not LEAST_GAP <= gap <= LARGEST_GAP:
        expected = f"a fraction of the mesh's size from {LEAST_GAP:g} to {LARGEST_GAP:g}, such as 1e-4"
        raise InputError(f"--weld {said}: expected {expected}, or no value")
    return gap


def _number(word: str | None) -> float | None:
    try:
        return float(word or "")
    except ValueError:
        return None

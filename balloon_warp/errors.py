"""Errors that a user can cause, of one sentence each, and suggestions of known names."""

import difflib
from collections.abc import Iterable
from pathlib import Path


class InputError(ValueError):
    """Bad input: the message names the file or field, the value found, and the expected one. Exit status 2."""


class NoRoomError(InputError):
    """Worlds do not fit into a device's memory: the message says how many would. Exit status 2."""


class MissingExtraError(ImportError):
    """A feature needs an optional package: the message names the extra that installs it. Exit status 2."""


class BlowUpError(RuntimeError):
    """The simulation blew up. The message names the place, the cause and a remedy. Exit status 1.

    Args:
        report: source of the message: a `BlowUp`, or a sentence.
    """

    def __init__(self, report: object):
        super().__init__(str(report))
        self.report = report


class WorkersLostError(RuntimeError):
    """The workers of a batch, or their scheduler, are gone: the message names the loss. Exit status 1."""


class StoppedError(RuntimeError):
    """The user, or the machine, stopped a run: the message says how far it got. Exit status 130, or 143."""


LONGEST = 100
"""Largest number of characters of a name that are compared: the time grows with their square"""
MUCH_LESS = 0.1
"""Margin of similarity between two names, which is 1 for equal ones"""


def closest(name: str, known: Iterable[str]) -> list[str]:
    """Find the known names most like `name`, whatever the case.

    Returns:
        Three at most, and none that is much less alike than the first.
    """
    by_lower = {each.lower(): each for each in known}
    wanted = name[:LONGEST].lower()
    close = difflib.get_close_matches(wanted, by_lower)
    likeness = {each: difflib.SequenceMatcher(None, each, wanted).ratio() for each in close}
    return [by_lower[each] for each in close if likeness[each] > likeness[close[0]] - MUCH_LESS]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """End a sentence by asking for the known names most like `name`; empty where none is like it."""
    return ask(closest(name, known))


def did_you_mean_file(path: Path, suffixes: Iterable[str], names: Iterable[str] = ()) -> str:
    """End a sentence about a file that is not there with the files beside it that are like it, or where a link leads.

    Args:
        path: the file that was asked for.
        suffixes: of files that could have been meant, such as ".toml".
        names: of other things that could have been meant, such as bundled scenes.
    """
    endings = tuple(suffixes)
    if path.is_symlink():
        return f"; it is a broken link to {path.readlink()}"
    try:
        beside = [each.name for each in path.parent.iterdir() if each.name.lower().endswith(endings)]
    except OSError:
        return f"; no folder {path.parent}"
    bare = path.parent == Path()
    files = [name if bare else str(path.parent / name) for name in beside]
    return did_you_mean(str(path), [*names, *files])


def ask(names: Iterable[str]) -> str:
    """End a sentence with `; did you mean a, b or c?`; empty where there are no names."""
    *first, last = [*names] or [""]
    listed = f"{', '.join(first)} or {last}" if first else last
    return f"; did you mean {listed}?" if listed else ""

"""Objects of a mesh file by their names: of an OBJ file its objects and groups, of a glTF file its nodes and meshes."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from balloon_warp.errors import InputError
from balloon_warp.suggestions import did_you_mean

MOST_NAMED = 5
"""Largest number of names in a sentence"""


class Objects:
    """The objects that are taken of a file, by name; all of it where none is named.

    A name may be a path, as of prims: /Room/Wall is an object Wall within Room.
    """

    def __init__(self, named: str | Sequence[str] | None):
        names = [named] if isinstance(named, str) else [*(named or ())]
        self._wanted = {name: tuple(word for word in name.split("/") if word) or (name,) for name in names}
        self._found = set[str]()
        self._known: dict[str, None] = {}

    @property
    def name(self) -> str:
        """Name of the only object that is taken, "" if there are several, or all."""
        only = [words[-1] for words in self._wanted.values()]
        return only[0] if len(only) == 1 else ""

    def takes(self, path: Iterable[str]) -> bool:
        """Return whether an object is taken: it is one of them, or is within one.

        Args:
            path: names of the objects around it, from the outside, and its own.
        """
        whole = [name for name in path if name]
        self._known.update(dict.fromkeys(reversed(whole)))
        hits = [name for name, words in self._wanted.items() if _holds(whole, name, words)]
        self._found.update(hits)
        return bool(hits) or not self._wanted

    def check(self, path: Path) -> None:
        """Make sure that all were found, once all objects of the file have been asked for.

        Raises:
            InputError: one was not; it names those that there are.
        """
        for name in self._wanted:
            if name not in self._found:
                known = [*self._known]
                more = f" and {len(known) - MOST_NAMED} more" if len(known) > MOST_NAMED else ""
                has = f"it has {', '.join(known[:MOST_NAMED])}{more}" if known else "nothing in it has a name"
                raise InputError(f"{path}: has no object {name} ({has}){did_you_mean(name.strip('/'), known)}")


def _holds(path: list[str], name: str, words: tuple[str, ...]) -> bool:
    """Return whether a name, or the words of its path in a row, are in another path."""
    return name in path or any(tuple(path[at : at + len(words)]) == words for at in range(len(path)))

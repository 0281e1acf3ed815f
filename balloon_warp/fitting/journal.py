"""Journal of a fit: the residuals of simulated worlds in a file, from which `--resume` goes on.

A search asks for the same places each time, as long as it gets the same answers. So it goes through those of the file
again, without simulating, to where it was stopped.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.marks import LINE
from balloon_warp.ownership import require_ours

Values = NDArray[np.float64]
Forward = Callable[[Values], Values]
MARK = np.array(LINE.encode())
"""Beginning of a file"""


class Journal:
    """A file of places and their residuals, round after round, below the request.

    Args:
        path: of the file.
        asked: by which the same fit is recognized.
        resume: whether to go on from the file.

    Raises:
        InputError: there is no such fit to resume, the file cannot be written, or somebody else's is in its place.
    """

    def __init__(self, path: Path, asked: Mapping[str, Any], resume: bool):
        self._path = path
        head = json.dumps(asked, sort_keys=True, default=str)
        self._known, end = _read(path, head) if resume else ([], 0)
        require_ours(path)
        try:
            self._file = path.open("r+b" if resume else "wb")
            self._file.truncate(end)
            self._file.seek(end)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        if not resume:
            self._write(MARK, np.array(head))

    @property
    def rounds(self) -> int:
        """Return how many rounds the file still has."""
        return len(self._known)

    def remembered(self, forward: Forward) -> Forward:
        """Return the function that answers from the file, and then simulates and writes down."""

        def answer(places: Values) -> Values:
            if self._known:
                asked, residuals = self._known.pop(0)
                if asked.shape == places.shape and (asked == places).all():
                    return residuals
                raise InputError(f"{self._path}: was written by a version with another search; expected the same")
            residuals = forward(places)
            self._write(places, residuals)
            return residuals

        return answer

    def close(self, done: bool) -> None:
        """Close the file, and remove it if the fit is done."""
        self._file.close()
        if done:
            self._path.unlink(missing_ok=True)

    def _write(self, *arrays: NDArray[Any]) -> None:
        for array in arrays:
            np.save(self._file, array, allow_pickle=False)
        self._file.flush()


def _read(path: Path, head: str) -> tuple[list[tuple[Values, Values]], int]:
    """Return the rounds of a file, and where the last whole one ends.

    Raises:
        InputError: it is no such file, or of another fit.
    """
    rounds: list[tuple[Values, Values]] = []
    try:
        file = path.open("rb")
        np.load(file, allow_pickle=False)  # the mark
        told = str(np.load(file, allow_pickle=False))
    except (OSError, EOFError, ValueError):
        raise InputError(f"{path}: has no fit to --resume") from None
    with file:
        if told != head:
            raise InputError(f"{path}: has another fit; --resume needs the same data, scene and options")
        end = file.tell()
        try:
            while True:
                rounds.append((np.load(file, allow_pickle=False), np.load(file, allow_pickle=False)))
                end = file.tell()
        except (OSError, EOFError, ValueError):  # a kill may have cut the last one short
            return rounds, end

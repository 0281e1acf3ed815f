"""Rows of a batch's table as CSV."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.outputs.decimals import PAD, decimals

BLOCK = 4096
"""Number of worlds whose rows are formatted together: more would only fill the memory"""


class CsvRows:
    """Writes rows of a table, frame by frame, as `TableWriter` tells.

    Args:
        path: of the file.
        columns: names of the columns.
        varied: the parameters that differ between the worlds: columns of shape (world_count,), numbers or words.
        world_count: how many worlds there are.
    """

    def __init__(self, path: Path, columns: Sequence[str], varied: Mapping[str, NDArray], world_count: int):
        self._columns, self._world_count = columns, world_count
        self._world_text = _padded([str(world).encode() for world in range(world_count)])
        self._varied_text = _padded(_describe_worlds(varied, world_count))
        self._file = path.open("wb")
        self._write_header()

    def write(self, frame: int, time: float, values: NDArray[np.float32], health: NDArray[np.int32]) -> None:
        """Write a frame: values of shape (measures, world_count), health of shape (world_count,)."""
        # nine digits give back every float32, and repr every float64
        moment = _padded([b",%d,%s" % (frame, repr(time).encode())])
        for begin in range(0, self._world_count, BLOCK):
            worlds = slice(begin, begin + BLOCK)
            kinds, kind = np.unique(health[worlds], return_inverse=True)
            columns = [
                self._world_text[worlds],
                moment,
                self._varied_text[worlds],
                *(part for column in decimals(values[:, worlds]) for part in (_COMMA, column)),
                _padded([b",%d\n" % each for each in kinds.tolist()])[kind],
            ]
            rows = np.concatenate([np.broadcast_to(column, (len(kind), column.shape[1])) for column in columns], axis=1)
            self._file.write(rows[rows != PAD].data)

    def begin_again(self) -> None:
        """Forget the written rows."""
        self._file.seek(0)
        self._file.truncate()
        self._write_header()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write_header(self) -> None:
        self._file.write((",".join(self._columns) + "\n").encode())


def _describe_worlds(varied: Mapping[str, NDArray], world_count: int) -> list[bytes]:
    """Return each world's varied values as CSV, with a comma before each."""
    lines = []
    for values in zip(*(column.tolist() for column in varied.values()), strict=True):
        line = io.StringIO()
        csv.writer(line, lineterminator="").writerow(["", *map(str, values)])
        lines.append(line.getvalue().encode())
    return lines or [b""] * world_count


def _padded(texts: Sequence[bytes]) -> NDArray[np.uint8]:
    """Return the texts below each other, filled up to the longest one, shape (len(texts), width)."""
    width = max(map(len, texts))
    filled = b"".join(text.ljust(width, bytes([PAD])) for text in texts)
    return np.frombuffer(filled, dtype=np.uint8).reshape(len(texts), width)


_COMMA = _padded([b","])

"""A batch's table: a row for each world and frame, as .npz and .csv of the same columns."""

import csv
import io
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.files import whole_file
from balloon_warp.outputs.decimals import PAD, decimals
from balloon_warp.outputs.npz import write_npz

TABLE_NAMES = ("table.npz", "table.csv")
BLOCK = 4096
"""Number of worlds whose rows are formatted together: more would only fill the memory"""


class TableWriter:
    """Writes `table.npz` and `table.csv`, which appear when the `with` block ends well.

    Rows go frame by frame, and within a frame world by world; they may come in any order before their frame is written.

    Args:
        folder: where the files go.
        frame_count: how many frames there will be, the start among them.
        frames_per_second: of the column `time` [s].
        varied: what differs between the worlds: columns of shape (world_count,), numbers or words.
        measures: names of the measured columns.
        world_count: how many worlds there are.
    """

    def __init__(
        self,
        folder: Path,
        frame_count: int,
        frames_per_second: float,
        varied: Mapping[str, NDArray],
        measures: Sequence[str],
        world_count: int,
    ):
        self.folder, self.frames_per_second = folder, frames_per_second
        self.varied, self.measures, self.world_count = dict(varied), list(measures), world_count
        self.values = np.zeros((frame_count, world_count, len(measures)), dtype=np.float32)
        """Measures of each frame and world, shape (frame_count, world_count, len(measures))"""
        self.health = np.zeros((frame_count, world_count), dtype=np.int32)
        """Health of each frame and world, shape (frame_count, world_count)"""
        self._frames_written = 0

    @property
    def columns(self) -> list[str]:
        return ["world", "frame", "time", *self.varied, *self.measures, "health"]

    def __enter__(self) -> Self:
        with ExitStack() as files:
            self._npz = files.enter_context(whole_file(self.folder / TABLE_NAMES[0]))
            files.push(self._save_npz)
            csv_path = files.enter_context(whole_file(self.folder / TABLE_NAMES[1]))
            self._csv = files.enter_context(csv_path.open("wb"))
            self._write_header()
            self._world_text = _padded([str(world).encode() for world in range(self.world_count)])
            self._varied_text = _padded(self._describe_worlds())
            self._files = files.pop_all()
        return self

    def write_frame(self) -> None:
        """Write the next frame, whose rows are all in `values` and `health`."""
        frame = self._frames_written
        self._frames_written += 1
        # nine digits give back every float32, and repr every float64
        moment = _padded([b",%d,%s" % (frame, repr(frame / self.frames_per_second).encode())])
        for begin in range(0, self.world_count, BLOCK):
            worlds = slice(begin, begin + BLOCK)
            kinds, kind = np.unique(self.health[frame, worlds], return_inverse=True)
            columns = [
                self._world_text[worlds],
                moment,
                self._varied_text[worlds],
                *(part for column in decimals(self.values[frame, worlds].T) for part in (_COMMA, column)),
                _padded([b",%d\n" % health for health in kinds.tolist()])[kind],
            ]
            rows = np.concatenate([np.broadcast_to(column, (len(kind), column.shape[1])) for column in columns], axis=1)
            self._csv.write(rows[rows != PAD].data)

    def write_again(self) -> None:
        """Write the frames again that were written already: their rows have changed since."""
        frames, self._frames_written = self._frames_written, 0
        self._csv.seek(0)
        self._csv.truncate()
        self._write_header()
        for _ in range(frames):
            self.write_frame()

    def _write_header(self) -> None:
        self._csv.write((",".join(self.columns) + "\n").encode())

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._files.__exit__(kind, error, traceback)

    def _describe_worlds(self) -> list[bytes]:
        """Return each world's varied values as CSV, with a comma before each."""
        lines = []
        for values in zip(*(column.tolist() for column in self.varied.values()), strict=True):
            line = io.StringIO()
            csv.writer(line, lineterminator="").writerow(["", *map(str, values)])
            lines.append(line.getvalue().encode())
        return lines or [b""] * self.world_count

    def _save_npz(self, kind: type[BaseException] | None, *_: object) -> None:
        """Save the arrays unless the run failed; one column at a time is in memory twice."""
        if kind is None:
            write_npz(self._npz, ((name, self._column(name)) for name in self.columns))

    def _column(self, name: str) -> NDArray:
        frames, worlds = self.health.shape
        match name:
            case "world":
                return np.tile(np.arange(worlds, dtype=np.int32), frames)
            case "frame":
                return np.repeat(np.arange(frames, dtype=np.int32), worlds)
            case "time":
                return np.repeat(np.arange(frames) / self.frames_per_second, worlds)
            case "health":
                return self.health.ravel()
        if name in self.varied:
            return np.tile(self.varied[name], frames)
        return self.values[:, :, self.measures.index(name)].ravel()


def _padded(texts: Sequence[bytes]) -> NDArray[np.uint8]:
    """Return the texts below each other, filled up to the longest one, shape (len(texts), width)."""
    width = max(map(len, texts))
    filled = b"".join(text.ljust(width, bytes([PAD])) for text in texts)
    return np.frombuffer(filled, dtype=np.uint8).reshape(len(texts), width)


_COMMA = _padded([b","])

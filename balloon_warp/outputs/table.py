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
from balloon_warp.outputs.npz import write_npz


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
        """what is measured, of each frame and world, shape (frame_count, world_count, len(measures))"""
        self.health = np.zeros((frame_count, world_count), dtype=np.int32)
        """of each frame and world, shape (frame_count, world_count)"""
        self._frames_written = 0

    @property
    def columns(self) -> list[str]:
        return ["world", "frame", "time", *self.varied, *self.measures, "health"]

    def __enter__(self) -> Self:
        with ExitStack() as files:
            self._npz = files.enter_context(whole_file(self.folder / "table.npz"))
            files.push(self._save_npz)
            csv_path = files.enter_context(whole_file(self.folder / "table.csv"))
            self._csv = files.enter_context(csv_path.open("w", encoding="utf-8", newline=""))
            self._write_header()
            self._varied_text = self._describe_worlds()
            self._files = files.pop_all()
        return self

    def write_frame(self) -> None:
        """Write the next frame, whose rows are all in `values` and `health`."""
        frame = self._frames_written
        self._frames_written += 1
        # nine digits give back every float32, and repr every float64
        form = f"%d,{frame},{frame / self.frames_per_second!r}%s" + ",%.9g" * len(self.measures) + ",%d\n"
        values, health = self.values[frame].tolist(), self.health[frame].tolist()
        rows = zip(range(self.world_count), self._varied_text, values, health, strict=True)
        self._csv.writelines(form % (world, text, *values, health) for world, text, values, health in rows)

    def write_again(self) -> None:
        """Write the frames again that were written already: their rows have changed since."""
        frames, self._frames_written = self._frames_written, 0
        self._csv.seek(0)
        self._csv.truncate()
        self._write_header()
        for _ in range(frames):
            self.write_frame()

    def _write_header(self) -> None:
        self._csv.write(",".join(self.columns) + "\n")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._files.__exit__(kind, error, traceback)

    def _describe_worlds(self) -> list[str]:
        """Each world's varied values as CSV, with a comma before each."""
        lines = []
        for values in zip(*(column.tolist() for column in self.varied.values()), strict=True):
            line = io.StringIO()
            csv.writer(line, lineterminator="").writerow(["", *map(str, values)])
            lines.append(line.getvalue())
        return lines or [""] * self.world_count

    def _save_npz(self, kind: type[BaseException] | None, *_: object) -> None:
        """Unless the run failed; one column at a time is in memory twice."""
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

"""A batch's table: a row for each world and frame, as .npz, and as .csv or .parquet of the same columns."""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from threading import Event
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.files import target_of, whole_file
from balloon_warp.outputs.npz import write_npz
from balloon_warp.outputs.table_csv import CsvRows
from balloon_warp.outputs.table_parquet import ParquetRows, has_parquet, require_pyarrow

KINDS = {"csv": CsvRows, "parquet": ParquetRows}
"""Kinds of the file beside the .npz"""
MOST_CSV_ROWS = 200_000
"""Largest number of rows that are written as text where nobody asks: a second's work"""


def settled_table(asked: str, rows: int) -> str:
    """Return the kind of a table: "auto" is CSV for a small one, and Parquet for others where it can be written.

    Raises:
        InputError: there is no such kind.
        MissingExtraError: it is Parquet, and pyarrow is not installed.
    """
    if asked not in (*KINDS, "auto"):
        raise InputError(f"table {asked}: expected auto, {', '.join(KINDS)}")
    if asked == "parquet":
        require_pyarrow()
    if asked == "auto":
        return "parquet" if rows > MOST_CSV_ROWS and has_parquet() else "csv"
    return asked


def table_names(kind: str) -> tuple[str, str]:
    """Return the names of a table's files."""
    return "table.npz", f"table.{kind}"


class TableWriter:
    """Writes `table.npz` and `table.csv` or `table.parquet`, which appear when the `with` block ends well.

    Rows go frame by frame, and within a frame world by world; they may come in any order before their frame is written.

    Args:
        folder: where the files go.
        frame_count: how many frames there will be, the start among them.
        frames_per_second: of the column `time` [s].
        varied: the parameters that differ between the worlds: columns of shape (world_count,), numbers or words.
        measures: names of the measured columns.
        world_count: how many worlds there are.
        kind: of the file beside the .npz: "csv" or "parquet".
    """

    def __init__(
        self,
        folder: Path,
        frame_count: int,
        frames_per_second: float,
        varied: Mapping[str, NDArray],
        measures: Sequence[str],
        world_count: int,
        kind: str = "csv",
    ):
        self.kind = kind
        self.folder, self.frames_per_second = folder, frames_per_second
        self.varied, self.measures, self.world_count = dict(varied), list(measures), world_count
        self.values = np.zeros((frame_count, len(measures), world_count), dtype=np.float32)
        """Measures of each frame and world, shape (frame_count, len(measures), world_count): columns, as files have"""
        self.health = np.zeros((frame_count, world_count), dtype=np.int32)
        """Health of each frame and world, shape (frame_count, world_count)"""
        self._frames_written = 0
        self._measured, self._failed, self._ended = Event(), False, False

    @property
    def columns(self) -> list[str]:
        return ["world", "frame", "time", *self.varied, *self.measures, "health"]

    def __enter__(self) -> Self:
        with ExitStack() as files:
            npz, rows = table_names(self.kind)
            files.push(self._remove_others)
            self._npz = files.enter_context(whole_file(self.folder / npz))
            files.push(self._save_npz)
            thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="arrays")
            self._arrays = thread.submit(write_npz, self._npz, self._arrays_in_turn())
            self._text = files.enter_context(whole_file(self.folder / rows))
            self._rows = KINDS[self.kind](self._text, self.columns, self.varied, self.world_count)
            files.callback(self.end_rows)
            self._files = files.pop_all()
        return self

    def write_frame(self) -> None:
        """Write the next frame, whose rows are all in `values` and `health`."""
        frame = self._frames_written
        self._frames_written += 1
        self._rows.write(frame, frame / self.frames_per_second, self.values[frame], self.health[frame])

    def write_arrays(self) -> Path:
        """Write the measured columns of all frames, which are there, while others write rows; return the file so far.

        It has its name once the `with` block ends.
        """
        self._measured.set()
        self._arrays.result()
        return self._npz

    def end_rows(self) -> Path:
        """Write the rows that wait; return the file so far, as `write_arrays` does."""
        if not self._ended:
            self._ended = True
            self._rows.close()
        return self._text

    def write_again(self) -> None:
        """Write the frames again that were written already: their rows have changed since; before `write_arrays`."""
        frames, self._frames_written = self._frames_written, 0
        self._rows.begin_again()
        for _ in range(frames):
            self.write_frame()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._files.__exit__(kind, error, traceback)

    def _remove_others(self, kind: type[BaseException] | None, *_: object) -> None:
        """Remove a table of another kind, which an earlier batch has left, unless this one failed."""
        for other in KINDS:
            path = self.folder / f"table.{other}"
            if kind is None and other != self.kind and path.exists():
                target_of(path).unlink()

    def _save_npz(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the arrays unless the run failed, or they are written."""
        if kind is None:
            self.write_arrays()
        else:
            self._failed = True
            self._measured.set()
            self._arrays.exception()  # waits for the thread

    def _arrays_in_turn(self) -> Iterator[tuple[str, NDArray]]:
        """Iterate over columns, once they are known: of two in memory one is a copy. The first are known at once."""
        for name in self.columns:
            if name in (*self.measures, "health"):
                self._measured.wait()
            if self._failed:
                return
            yield name, self._column(name)

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
        return self.values[:, self.measures.index(name)].ravel()

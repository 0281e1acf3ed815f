"""Rows of a batch's table as Parquet, which pandas, Polars, DuckDB and Arrow read."""

import os
from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import MissingExtraError
from balloon_warp.outputs.parquet_parts import ParquetParts

ROWS = 2**20
"""Number of rows that are written together, at least, unless they are the last: a row group of the file"""
THREADS = min(os.cpu_count() or 1, 16)
"""Number of row groups that are encoded side by side: more would only fill the memory"""


def has_parquet() -> bool:
    """Return whether Parquet can be written."""
    return find_spec("pyarrow") is not None


def require_pyarrow() -> tuple[Any, Any]:
    """Return Arrow and its Parquet.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise MissingExtraError("Parquet needs pyarrow: pip install 'balloon-warp[data]'") from None


class ParquetRows:
    """Writes rows of a table, frame by frame, as `TableWriter` tells.

    Args:
        path: of the file.
        columns: names of the columns.
        varied: the parameters that differ between the worlds: columns of shape (world_count,), numbers or words.
        world_count: how many worlds there are.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """

    def __init__(self, path: Path, columns: Sequence[str], varied: Mapping[str, NDArray], world_count: int):
        self._arrow, self._parquet = require_pyarrow()
        self._path, self._columns, self._varied, self._world_count = path, columns, varied, world_count
        measured = columns[3 + len(varied) : -1]
        kinds = {"world": np.int32, "frame": np.int32, "time": np.float64, "health": np.int32}
        types = {name: self._arrow.from_numpy_dtype(kind) for name, kind in kinds.items()}
        types |= {name: self._column(values).type for name, values in varied.items()}
        types |= dict.fromkeys(measured, self._arrow.float32())
        self._repeating = [name for name in columns if name not in measured]  # floats gain nothing by a dictionary
        self._schema = self._arrow.schema([(name, types[name]) for name in columns])
        self._encoders = ThreadPoolExecutor(THREADS, thread_name_prefix="encoder")
        self._encoded: deque[Future[memoryview]] = deque()
        self._open()

    def write(self, frame: int, time: float, values: NDArray[np.float32], health: NDArray[np.int32]) -> None:
        """Write a frame: values of shape (measures, world_count), health of shape (world_count,)."""
        count = self._world_count
        first = [np.arange(count, dtype=np.int32), np.full(count, frame, dtype=np.int32), np.full(count, time)]
        arrays = [*first, *self._varied.values(), *values, health]
        self._waiting.append(self._arrow.record_batch(list(map(self._column, arrays)), schema=self._schema))
        if len(self._waiting) * count >= ROWS:
            self._flush()

    def begin_again(self) -> None:
        """Forget the written rows."""
        self._waiting.clear()
        self._flush(wait_for=0)
        self._parts.close()
        self._open()

    def close(self) -> None:
        """Write the frames that wait, and close the file."""
        self._flush(wait_for=0)
        self._encoders.shutdown()
        self._parts.close()

    def _column(self, values: NDArray[Any]) -> Any:
        """Return values as a column; numbers as they are, since `pyarrow.array` would load pandas, for a second."""
        if values.dtype.kind not in "iuf":
            return self._arrow.array(values)
        numbers = np.ascontiguousarray(values)
        kind = self._arrow.from_numpy_dtype(numbers.dtype)
        return self._arrow.Array.from_buffers(kind, len(numbers), [None, self._arrow.py_buffer(numbers)])

    def _open(self) -> None:
        self._waiting: list[Any] = []
        self._parts = ParquetParts(self._path.open("wb"))

    def _flush(self, wait_for: int = THREADS) -> None:
        """Have the frames that wait encoded as a row group, and write encoded groups, until so many are under way."""
        if self._waiting:
            self._encoded.append(self._encoders.submit(self._encode, self._waiting))
            self._waiting = []
        while len(self._encoded) > wait_for:
            self._parts.append(self._encoded.popleft().result())

    def _encode(self, batches: Sequence[Any]) -> memoryview:
        """Return a Parquet file of a row group."""
        file, options = BytesIO(), {"compression": "zstd", "compression_level": 1, "use_dictionary": self._repeating}
        with self._parquet.ParquetWriter(file, self._schema, **options) as writer:
            writer.write_table(self._arrow.Table.from_batches(batches), row_group_size=2**31 - 1)
        return file.getbuffer()

"""Rows of many arrays, which chosen worlds get back in one launch."""

from collections.abc import Iterable
from typing import Any

import warp as wp

from balloon_warp.kernels.steering import ByteRows, WordRows, copy_bytes, copy_words
from balloon_warp.launching import launch
from balloon_warp.steering.controls import rows_of_words

THREADS = 128
"""Number of threads that copy a world's rows on a GPU"""


class RowCopies:
    """Copies of rows between arrays, for the worlds of a mask.

    It has to live as long as a recorded graph that copies: the addresses of the arrays lie in memory of its own.

    Args:
        arrays: sources and targets, contiguous, with a row a world; a source may have one row for all.
        device: where they are.
    """

    def __init__(self, arrays: Iterable[tuple[wp.array, wp.array]], device: wp.Device):
        self._device = device
        self._arrays = [(rows_of_words(source), rows_of_words(target)) for source, target in arrays if target.size]
        self._tables = [self._table_of(rows) for rows in (WordRows, ByteRows)]

    def _table_of(self, rows: Any) -> wp.array:
        """Return the copies of words, or of bytes where rows do not fill words."""
        copies = []
        word = rows.vars["target"].type.dtype
        for source, target in self._arrays:
            if target.dtype == word:
                copy = rows()
                copy.source, copy.target = source, target
                copies.append(copy)
        return wp.array(copies, dtype=rows, device=self._device)

    def copy(self, mask: wp.array) -> None:
        """Copy the rows of worlds for which a mask is not 0."""
        threads = 1 if self._device.is_cpu else THREADS
        for kernel, table in zip((copy_words, copy_bytes), self._tables, strict=True):
            if table.size:
                shape = (mask.shape[0], threads)
                launch(kernel, shape, [mask, table, threads], device=self._device)

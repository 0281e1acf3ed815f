"""Kernels of frames backwards, for layouts in which threads loop or have particles.

One computes a frame again and notes results of its substeps, the other runs them backwards: so each has the threads and
registers that suit it.
"""

from functools import cache
from typing import Any, NamedTuple

from balloon_warp.kernels.codegen import kernel_from
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.block.again import AgainWriter, HeldAgainWriter
from balloon_warp.kernels.schedules.block.backward import BackwardBlockWriter
from balloon_warp.kernels.schedules.block.backward_held import HeldBackwardWriter
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.rows import RowsWriter
from balloon_warp.kernels.schedules.pieces import Step


class Backwards(NamedTuple):
    """Hold the phases and layouts of both kernels."""

    turned: Step
    """Phases that run backwards"""
    kept: Step
    """Phases forward, which keep the values that the others ask for"""
    layout: Layout
    again: Step
    """Phases of a frame that is computed again, on its own layout"""
    layout_again: Layout


def _writer(of: Backwards, columns: tuple[int, ...]) -> BackwardBlockWriter:
    return (HeldBackwardWriter if of.layout.held else BackwardBlockWriter)(of.turned, of.kept, of.layout, columns)


def _writer_again(of: Backwards) -> AgainWriter:
    back = _writer(of, ())
    if of.layout_again.held:
        return HeldAgainWriter(of.again, of.layout_again, back.noted, back.read_back)
    return AgainWriter(of.again, of.layout_again, back.noted)


def _kernel(writer: RowsWriter, layout: Layout) -> Any:
    unroll = 128 if layout.held or any(layout.slots) else 16
    options = {**OPTIONS, "fast_math": True, "max_unroll": unroll}
    source = writer.source()
    return kernel_from(writer.name, source, writer.names(), cuda_max_registers=layout.registers, module_options=options)


@cache
def kernel_backwards(of: Backwards, columns: tuple[int, ...]) -> Any:
    """Make the kernel of a frame backwards."""
    return _kernel(_writer(of, columns), of.layout)


@cache
def kernel_again(of: Backwards) -> Any:
    """Make the kernel of a frame again."""
    return _kernel(_writer_again(of), of.layout_again)


@cache
def widths_of_rows(of: Backwards) -> dict[str, int]:
    """Return how many numbers or vectors a row of each substep has, by the names of arrays."""
    return _writer(of, ()).widths


@cache
def arguments_backwards(of: Backwards, columns: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of the arguments of the kernel backwards."""
    return _writer(of, columns).arguments()


@cache
def arguments_again(of: Backwards) -> tuple[str, ...]:
    """Return the names of the arguments of the kernel of a frame again."""
    return _writer_again(of).arguments()

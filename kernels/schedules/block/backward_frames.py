"""Kernels of frames backwards, for layouts in which threads loop or have a particle each."""

from functools import cache
from typing import Any

from balloon_warp.kernels.codegen import kernel_from
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.block.backward import BackwardBlockWriter
from balloon_warp.kernels.schedules.block.backward_held import HeldBackwardWriter
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.pieces import Step


def _writer(turned: Step, again: Step, layout: Layout, columns: tuple[int, ...]) -> BackwardBlockWriter:
    return (HeldBackwardWriter if layout.held else BackwardBlockWriter)(turned, again, layout, columns)


@cache
def kernel_backwards(turned: Step, again: Step, layout: Layout, columns: tuple[int, ...]) -> Any:
    """Make the kernel of a frame backwards."""
    writer = _writer(turned, again, layout, columns)
    options = {**OPTIONS, "fast_math": True, "max_unroll": 128 if any(layout.slots) else 16}
    source = writer.source()
    return kernel_from(writer.name, source, writer.names(), cuda_max_registers=layout.registers, module_options=options)


@cache
def widths_of_rows(turned: Step, again: Step, layout: Layout) -> dict[str, int]:
    """Return how many numbers or vectors a row of each substep has, by the names of arrays."""
    return _writer(turned, again, layout, ()).widths


@cache
def arguments_backwards(turned: Step, again: Step, layout: Layout, columns: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of what it takes."""
    return _writer(turned, again, layout, columns).arguments()

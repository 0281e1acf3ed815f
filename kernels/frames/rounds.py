"""Rounds of substeps: recorded once, and replayed so many times in a frame."""

import warp as wp

from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import Clock

wp.set_module_options(OPTIONS)


@wp.kernel
def begin_round(clock: Clock, depth: wp.int32, turns: wp.int32):
    """Set how many turns a round has; one thread."""
    clock.left[depth] = turns


@wp.kernel
def end_turn(clock: Clock, depth: wp.int32, substeps: wp.int32):
    """End a turn of a round: the next is so many substeps later; one thread."""
    clock.left[depth] -= 1
    clock.done[0] += substeps

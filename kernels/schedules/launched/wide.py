"""Points in sixteen bytes each, beside the state, for those that look at others: one load instead of three.

Twelve bytes a point take three loads, and each of a warp's passes over as many bytes as all three ask for.
"""

import warp as wp

from balloon_warp.kernels.memory import put_four_in, vector_in
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.pieces import Step

wp.set_module_options({**OPTIONS, "enable_backward": False})

LOOKING = {"particle", "face"}
"""Items whose threads look at the wide points"""
MOVING_NONE = {"particle", "face", "balloon", "world", "launches"}
"""Items of pieces that move no points but a thread its own particle's"""


@wp.func
def put_wide(wide_points: wp.array2d[wp.vec4], world: wp.int32, particle: wp.int32, point: wp.vec3):
    """Store a point in sixteen bytes."""
    put_four_in(wide_points, world, particle, wp.vec4(point[0], point[1], point[2], 0.0))


@wp.kernel
def widen_points(
    # state in
    points: wp.array2d[wp.vec3],
    # out
    wide_points: wp.array2d[wp.vec4],
):
    """Copy all points; a thread a (world, particle)."""
    world, particle = wp.tid()
    put_wide(wide_points, world, particle, vector_in(points, world, particle))


def may_be_wide(step: Step) -> bool:
    """Return whether nothing but the thread of a particle moves its point."""
    return not step.features.bursts and all(piece.item in MOVING_NONE for piece in step.pieces)

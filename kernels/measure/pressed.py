"""Gas that is pressed harder than its skin bears at the step."""

import warp as wp

from balloon_warp.kernels.laws.gas import most_pressure
from balloon_warp.kernels.tables import row_of_world


@wp.kernel(enable_backward=False)
def note_pressed(
    # model
    bounds: wp.array[float],
    step_seconds: float,
    mass: wp.array2d[float],
    # state in
    frame: wp.array[wp.int32],
    pressures: wp.array2d[float],
    # state out
    pressed: wp.array2d[wp.int32],
):
    """Record the first frame at whose end a gas pushes no harder for that; a thread a (world, balloon)."""
    world, balloon = wp.tid()
    most = most_pressure(bounds[balloon], mass[row_of_world(world, mass.shape[0]), balloon], step_seconds)
    if pressed[world, balloon] == 0 and pressures[world, balloon] >= most:
        pressed[world, balloon] = frame[0]

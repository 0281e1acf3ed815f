"""Kernels of the values that come to a simulation before a frame, from the device itself."""

import warp as wp

from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)


@wp.kernel
def write_control(
    # asked
    values: wp.array[float],
    number: wp.int32,
    low: float,
    high: float,
    ends: wp.int32,
    # parameter out
    target: wp.array[float],
    faults: wp.array[wp.int32],
):
    """Write a control where the kernels read it; a thread a world.

    A value beyond the bounds is clipped, or ends the world where that is asked; one that is not finite always ends it,
    and the parameter stays as it was. `faults` names the first control at fault, from 1; 0 where all is well.
    """
    world = wp.tid()
    value = values[world]
    bad = not wp.isfinite(value)
    if ends == 1 and (value < low or value > high):
        bad = True
    if bad:
        if faults[world] == 0:
            faults[world] = number
    else:
        target[world] = wp.clamp(value, low, high)


@wp.kernel
def read_control(
    # parameter in
    source: wp.array[float],
    # out
    values: wp.array[float],
):
    """Read the present value of a parameter; a thread a world."""
    world = wp.tid()
    values[world] = source[world]


@wp.kernel
def move_obstacles(velocities: wp.array2d[wp.vec3], seconds: float, positions: wp.array2d[wp.vec3]):
    """Move obstacles on by a frame; a thread a (world, obstacle)."""
    world, obstacle = wp.tid()
    positions[world, obstacle] = positions[world, obstacle] + seconds * velocities[world, obstacle]

"""Sums of derivatives by spheres that meet faces as ridges do, and courses that are kept of them."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.exact_sums import add_exactly, note_size, parts_per_unit, sum_at
from balloon_warp.kernels.adjoints.sphere_bars import add_by_sphere
from balloon_warp.kernels.tables import WorldState
from balloon_warp.kernels.warps import block_barrier

OF_BALLS = wp.constant(3)
"""Kind of the first sums of spheres, after those of particles: by velocity, spin and start, by mass and by radius"""
KINDS_OF_BALLS, BALL_SUMS = 5, 11
"""Number of kinds of sums of spheres, and of entries of each sphere"""


@wp.struct
class BallShare:
    """Derivatives by a contact's inputs of a sphere."""

    velocity: wp.vec3
    spin: wp.vec3
    start: wp.vec3  # its place before the substep
    mass: float
    radius: float


@wp.func
def note_ball(bars: Any, world: wp.int32, found: BallShare):
    """Note how large a contact's derivatives by a sphere are."""
    note_size(bars.largest, world, OF_BALLS, wp.max(wp.abs(found.velocity)))
    note_size(bars.largest, world, OF_BALLS + 1, wp.max(wp.abs(found.spin)))
    note_size(bars.largest, world, OF_BALLS + 2, wp.max(wp.abs(found.start)))
    note_size(bars.largest, world, OF_BALLS + 3, wp.abs(found.mass))
    note_size(bars.largest, world, OF_BALLS + 4, wp.abs(found.radius))


@wp.func
def add_ball(bars: Any, world: wp.int32, sphere: wp.int32, found: BallShare):
    """Add a contact's derivatives to the sums of a sphere, by any thread in any order."""
    of_velocities = parts_per_unit(bars.largest, world, OF_BALLS)
    of_spins = parts_per_unit(bars.largest, world, OF_BALLS + 1)
    of_starts = parts_per_unit(bars.largest, world, OF_BALLS + 2)
    for axis in range(3):
        add_exactly(bars.ball_sums, world, sphere, axis, of_velocities, found.velocity[axis])
        add_exactly(bars.ball_sums, world, sphere, axis + 3, of_spins, found.spin[axis])
        add_exactly(bars.ball_sums, world, sphere, axis + 6, of_starts, found.start[axis])
    add_exactly(bars.ball_sums, world, sphere, 9, parts_per_unit(bars.largest, world, OF_BALLS + 3), found.mass)
    add_exactly(bars.ball_sums, world, sphere, 10, parts_per_unit(bars.largest, world, OF_BALLS + 4), found.radius)


@wp.func
def take_ball(bars: Any, world: wp.int32, sphere: wp.int32):
    """Add a sphere's sums to its derivatives, and clear them."""
    velocity = wp.vec3()
    spin = wp.vec3()
    start = wp.vec3()
    for axis in range(3):
        velocity[axis] = sum_at(bars.ball_sums, bars.largest, world, sphere, axis, OF_BALLS)
        spin[axis] = sum_at(bars.ball_sums, bars.largest, world, sphere, axis + 3, OF_BALLS + 1)
        start[axis] = sum_at(bars.ball_sums, bars.largest, world, sphere, axis + 6, OF_BALLS + 2)
    by_mass = sum_at(bars.ball_sums, bars.largest, world, sphere, 9, OF_BALLS + 3)
    by_radius = sum_at(bars.ball_sums, bars.largest, world, sphere, 10, OF_BALLS + 4)
    bars.spheres.velocities[world, sphere] = bars.spheres.velocities[world, sphere] + velocity
    bars.spheres.spins[world, sphere] = bars.spheres.spins[world, sphere] + spin
    bars.spheres.starts[world, sphere] = bars.spheres.starts[world, sphere] + start
    add_by_sphere(bars.spheres, world, sphere, by_mass, by_radius)
    for entry in range(BALL_SUMS):
        bars.ball_sums[world, sphere, entry] = wp.int64(0)


@wp.func
def keep_balls(state: WorldState, bars: Any, world: wp.int32, thread: wp.int32, sweep: wp.int32):
    """Keep the velocities and spins of all spheres before a sweep."""
    for sphere in range(thread, bars.ball_sums.shape[1], wp.block_dim()):
        bars.ball_velocities[sweep, world, sphere] = state.sphere_velocities[world, sphere]
        bars.ball_spins[sweep, world, sphere] = state.sphere_spins[world, sphere]


@wp.func
def restore_balls(state: WorldState, bars: Any, world: wp.int32, thread: wp.int32, sweep: wp.int32):
    """Restore the velocities and spins of all spheres as they were before a sweep."""
    for sphere in range(thread, bars.ball_sums.shape[1], wp.block_dim()):
        state.sphere_velocities[world, sphere] = bars.ball_velocities[sweep, world, sphere]
        state.sphere_spins[world, sphere] = bars.ball_spins[sweep, world, sphere]
    block_barrier()

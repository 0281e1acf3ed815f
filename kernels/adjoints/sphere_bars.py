"""Derivatives by spheres: by their courses and numbers, and the sums of those that particles have found."""

import warp as wp

from balloon_warp.kernels.loops.spheres import Course, course_of
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.working import SphereBars, Working

COLUMNS = ("sphere_mass", "sphere_radius", "sphere_penalty", "sphere_restitution")
"""Parameters of spheres by which is derived, in the order of their columns"""


@wp.struct
class BarsOfSpheres:
    """Derivatives by the spheres of all worlds, shape (W, S)."""

    positions: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    spins: wp.array2d[wp.vec3]
    starts: wp.array2d[wp.vec3]
    """Bars of the places before the substep"""
    totals: wp.array2d[SphereBars]
    """Bars from all particles in a substep"""
    numbers: wp.array3d[wp.float64]
    """Bars of `COLUMNS`, added up over all frames"""
    frictions: wp.array3d[wp.float64]
    """Bars of Coulomb's coefficients between spheres, and on obstacles and the ground, added up over all frames, shape
    (W, things, things)"""
    rubs: wp.array3d[float]
    """Bars of Coulomb's coefficient of each particle on each sphere that exchanges momentum with it, added up over
    frames, shape (W, P, S); empty where none does"""
    fixture_restitutions: wp.array2d[wp.float64]
    """Bars of obstacles' coefficients of restitution, added up over all frames, shape (W, N)"""
    crowded: wp.array[wp.int32]
    """Whether more has met in a substep of a world than there is room for"""


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def sum_sphere_bars(working: Working, bars: BarsOfSpheres):
    """Add up the bars of a sphere that particles have found, and clear them; a block a (world, sphere)."""
    world, sphere, thread = wp.tid()
    total = SphereBars()
    for particle in range(thread, working.sphere_bars.shape[1], wp.block_dim()):
        total += working.sphere_bars[world, particle, sphere]
        working.sphere_bars[world, particle, sphere] = SphereBars()
    found = wp.tile_sum(wp.tile(total, preserve_type=True))[0]
    if thread == 0:
        bars.totals[world, sphere] = found


@wp.func
def bar_of_course(bars: BarsOfSpheres, world: wp.int32, sphere: wp.int32):
    """Return the derivatives by a sphere's course."""
    return course_of(bars.positions[world, sphere], bars.velocities[world, sphere], bars.spins[world, sphere])


@wp.func
def put_bar_of_course(bars: BarsOfSpheres, world: wp.int32, sphere: wp.int32, bar: Course):
    """Store the derivatives by a sphere's course."""
    bars.positions[world, sphere] = bar.position
    bars.velocities[world, sphere] = bar.velocity
    bars.spins[world, sphere] = bar.spin


@wp.func
def add_by_sphere(bars: BarsOfSpheres, world: wp.int32, sphere: wp.int32, by_mass: float, by_radius: float):
    """Add derivatives by a sphere's mass and radius."""
    bars.numbers[world, sphere, 0] = bars.numbers[world, sphere, 0] + wp.float64(by_mass)
    bars.numbers[world, sphere, 1] = bars.numbers[world, sphere, 1] + wp.float64(by_radius)


@wp.func
def add_by_restitution(bars: BarsOfSpheres, world: wp.int32, sphere: wp.int32, more: float):
    """Add a derivative by a sphere's coefficient of restitution."""
    bars.numbers[world, sphere, 3] = bars.numbers[world, sphere, 3] + wp.float64(more)


@wp.func
def add_by_friction(bars: BarsOfSpheres, world: wp.int32, first: wp.int32, second: wp.int32, more: float):
    """Add a derivative by Coulomb's coefficient of two things, where kernels read it."""
    bars.frictions[world, first, second] = bars.frictions[world, first, second] + wp.float64(more)

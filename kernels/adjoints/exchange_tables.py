"""Tables of spheres and particles that exchange momentum, as it is found again, and of the derivatives by it."""

import warp as wp

from balloon_warp.kernels.adjoints.answers import Common
from balloon_warp.kernels.adjoints.sphere_bars import BarsOfSpheres
from balloon_warp.kernels.laws.impulse import Press
from balloon_warp.kernels.loops.spheres import Course

Sums = wp.types.vector(length=18, dtype=wp.float32)
"""Sums over particles of the derivatives by the sphere's change of velocity, its shift, and the mass that it presses;
by its place, velocity, spin, radius and mass"""


@wp.struct
class Met:
    """Findings of a sphere and the particles that it meets."""

    press: Press
    last: wp.vec3  # change of the sphere's velocity before it was settled, which says who is pressed
    change: wp.vec3
    shift: wp.vec3
    rub: wp.spatial_vector  # friction on all particles [N s], and its torque [N m s]


@wp.struct
class Exchanges:
    """Exchanges of all worlds in a substep, one sphere after the other."""

    points: wp.array3d[wp.vec3]
    """Places before each sphere, and after the last, of particles near any, shape (S + 1, W, P)"""
    velocities: wp.array3d[wp.vec3]
    met: wp.array2d[Met]
    """Findings of each sphere, shape (W, S)"""


@wp.struct
class ExchangeBars:
    """Derivatives by spheres and particles that exchange momentum."""

    spheres: BarsOfSpheres
    points: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    masses: wp.array2d[float]
    """Bars of the mass of each particle with its part of the gas, of spheres so far"""
    gas_masses: wp.array2d[float]
    numbers: wp.array3d[float]


@wp.func
def sums_of(common: Common, ball: Course, radius: float, heavy: float):
    """Return derivatives in a row."""
    sums = Sums()
    for axis in range(3):
        sums[axis] = common.change[axis]
        sums[3 + axis] = common.shift[axis]
        sums[7 + axis] = ball.position[axis]
        sums[10 + axis] = ball.velocity[axis]
        sums[13 + axis] = ball.spin[axis]
    sums[6] = common.pressed
    sums[16] = radius
    sums[17] = heavy
    return sums


@wp.func
def put_sums(course: Course, sums: Sums):
    """Add the sums to the derivatives by a sphere's course."""
    course.position += wp.vec3(sums[7], sums[8], sums[9])
    course.velocity += wp.vec3(sums[10], sums[11], sums[12])
    course.spin += wp.vec3(sums[13], sums[14], sums[15])
    return course

"""Adjoint of one contact of a small sphere and a triangle, which Warp derives of the law's own functions.

The time of impact is derived as it is found: each look ahead leads to the next. Frozen is how many looks there are, and
which branches act.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.sphere_courses import worth
from balloon_warp.kernels.contact.faces import changing_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import spin_by
from balloon_warp.kernels.laws.touch import facing_of, impact, longest_way, part_after, seen_at
from balloon_warp.kernels.loops.spheres import Course


@wp.struct
class Coming:
    """A sphere and a triangle as they come to a contact, or derivatives by that; vectors of corners row by row."""

    start: wp.vec3  # of the center
    course: Course
    radius: float
    mass: float
    starts: wp.mat33
    points: wp.mat33
    velocities: wp.mat33
    eases: wp.vec3  # inverse masses of the corners [1/kg]
    friction: float


@wp.struct
class Worth:
    """Derivatives by a sphere's course and by places and velocities of three corners, row by row."""

    course: Course
    points: wp.mat33
    velocities: wp.mat33


@wp.func
def facing_when(coming: Coming):
    """Return the configuration of center and corners before and after a step."""
    return facing_of(coming.start, coming.course.position, coming.radius, coming.starts, coming.points)


@cache
def impact_work(features: Features) -> Any:
    """Return the function of the states of sphere and corners after a contact, times the derivatives by these."""
    change_of = changing_function(features)

    @wp.func
    def work_of_impact(coming: Coming, part: float, step_seconds: float, bar: Worth):
        eases = wp.vec4(1.0 / coming.mass, coming.eases[0], coming.eases[1], coming.eases[2])
        met = impact(
            facing_when(coming), part, coming.course.velocity, coming.velocities, eases, coming.course.spin,
            coming.friction, step_seconds,
        )  # fmt: skip
        spin = coming.course.spin
        if wp.static(features.spheres_rub):
            spin += spin_by(coming.mass, coming.radius, wp.cross(met.arm, met.rub))
        shift, gain = change_of(met, 0)
        work = worth(coming.course.position + shift, coming.course.velocity + gain, spin, bar.course)
        for corner in range(3):
            way, more = change_of(met, corner + 1)
            work += wp.dot(coming.points[corner] + way, bar.points[corner])
            work += wp.dot(coming.velocities[corner] + more, bar.velocities[corner])
        return work

    return work_of_impact


@wp.func
def work_of_look(coming: Coming, part: float, nearest: float, by_part: float):
    """Return until which part of the step they cannot meet, as it is seen at a part before, times its derivative."""
    facing = facing_when(coming)
    _weights, arm = seen_at(facing, part)
    return by_part * part_after(part, wp.length(arm), nearest * facing.radius, longest_way(facing))


@wp.func
def sum_of_comings(one: Coming, other: Coming):
    """Return the sum of derivatives, of which the latter are those of a look."""
    one.start += other.start
    one.course.position += other.course.position
    one.radius += other.radius
    one.starts += other.starts
    one.points += other.points
    return one

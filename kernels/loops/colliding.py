"""Spheres that meet spheres in a step, wherever they are kept: pair after pair, until nothing moves any more."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.collision import collision, mean_restitution, share_of
from balloon_warp.kernels.laws.contact import stop_of
from balloon_warp.kernels.laws.sliding import ease_of_ball, friction_impulse, spin_by
from balloon_warp.kernels.loops.friction import friction_between, number_of_sphere
from balloon_warp.kernels.loops.rolling import (
    BESIDE_GROUND,
    MEETS,
    Course,
    course_at,
    ground_rubbing_function,
    leaving_function,
    put_course,
)
from balloon_warp.kernels.tables import (
    Tables,
    row_of_world,
    sphere_mass,
    sphere_radius,
    sphere_restitution,
)

MOST_SWEEPS = wp.constant(24)
"""Largest number of sweeps over all pairs in a step; a stack of two usually needs one or two"""
SETTLED = wp.constant(1.0e-6)
"""Displacement below which a sphere counts as at rest, over its radius"""


@cache
def beside_function(features: Features, note: Any = None) -> Any:
    """Make the function that puts a sphere that another has moved out of the ground and obstacles.

    Args:
        note: as in `leaving_function`.
    """
    leave_fixtures = leaving_function(features, note) if features.fixtures else None
    rub_on_ground = ground_rubbing_function(features)
    height, ground_restitution = (
        features.columns.places[name] - features.columns.balloon_width
        for name in ("ground_height", "ground_restitution")
    )

    @wp.func
    def put_beside(t: Tables, spheres: Any, world: wp.int32, time: float, sphere: wp.int32, course: Course):
        """Move a sphere that another has pushed out of the ground and obstacles."""
        radius = sphere_radius(t.spheres, world, sphere)
        if wp.static(features.ground):
            row = row_of_world(world, t.world_numbers.shape[0])
            depth = t.world_numbers[row, height] + radius - wp.dot(course.position, t.up)
            if depth > 0.0:
                if wp.static(note is not None):
                    note(spheres, world, BESIDE_GROUND, sphere, sphere, course, course)
                restitution = t.world_numbers[row, ground_restitution]
                coming = -wp.dot(course.velocity, t.up)
                stopped = stop_of(coming, t.step_seconds * coming, coming, restitution, t.step_seconds)
                course.position += depth * t.up
                course.velocity += stopped * t.up
                course = rub_on_ground(t, world, sphere, course, stopped)
        if wp.static(features.fixtures):
            course = leave_fixtures(t, spheres, world, sphere, time, spheres.sphere_starts[world, sphere], course)
        put_course(spheres, world, sphere, course, wp.static(features.spheres_rub))

    return put_beside


@cache
def pair_rubbing_function(features: Features) -> Any:
    """Make the function by which two spheres that meet rub on each other."""

    @wp.func
    def rub_pair(
        t: Tables,
        world: wp.int32,
        first: wp.int32,
        second: wp.int32,
        mine: Course,
        other: Course,
        normal: wp.vec3,
        pushed: float,
        seconds: float,
    ):
        """Return the courses of two spheres after friction on each other, for the rest of the step.

        Args:
            normal: from the first to the second.
            pushed: the impulse along it [N s].
        """
        if wp.static(features.spheres_rub):
            mass = sphere_mass(t.spheres, world, first)
            other_mass = sphere_mass(t.spheres, world, second)
            radius = sphere_radius(t.spheres, world, first)
            other_radius = sphere_radius(t.spheres, world, second)
            arm = radius * normal
            other_arm = -other_radius * normal
            beside = other.velocity + wp.cross(other.spin, other_arm) - mine.velocity - wp.cross(mine.spin, arm)
            ease = ease_of_ball(mass, radius, arm) + ease_of_ball(other_mass, other_radius, other_arm)
            friction = friction_between(t, world, number_of_sphere(t, first), number_of_sphere(t, second))
            rub = friction_impulse(beside, normal, ease, friction * pushed)
            mine.position -= (seconds / mass) * rub
            mine.velocity -= rub / mass
            mine.spin += spin_by(mass, radius, -wp.cross(arm, rub))
            other.position += (seconds / other_mass) * rub
            other.velocity += rub / other_mass
            other.spin += spin_by(other_mass, other_radius, wp.cross(other_arm, rub))
        return mine, other

    return rub_pair


@wp.func
def may_meet(t: Tables, spheres: Any, world: wp.int32, first: wp.int32, second: wp.int32):
    """Return whether two spheres are so near that they may collide in the step."""
    start = spheres.sphere_starts[world, first]
    other_start = spheres.sphere_starts[world, second]
    way = wp.length(spheres.sphere_positions[world, first] - start)
    way += wp.length(spheres.sphere_positions[world, second] - other_start)
    reach = sphere_radius(t.spheres, world, first) + sphere_radius(t.spheres, world, second)
    return wp.length(other_start - start) <= 1.001 * (reach + way)


@cache
def colliding_function(features: Features, note: Any = None) -> Any:
    """Make the function that lets the spheres of a world meet once all have moved: by one thread, in the same order.

    Args:
        note: as in `leaving_function`.
    """
    gravity = features.columns.places["gravity"] - features.columns.balloon_width
    rub_pair, put_beside = pair_rubbing_function(features), beside_function(features, note)

    @wp.func
    def meet_pair(t: Tables, spheres: Any, world: wp.int32, time: float, first: wp.int32, second: wp.int32):
        """Resolve the collision of two spheres, and return whether it has moved them."""
        reach = sphere_radius(t.spheres, world, first) + sphere_radius(t.spheres, world, second)
        mine = course_at(spheres, world, first)
        other = course_at(spheres, world, second)
        before = spheres.sphere_starts[world, second] - spheres.sphere_starts[world, first]
        shift, gain, part = collision(
            before, other.position - mine.position - before, other.velocity - mine.velocity, reach,
            mean_restitution(
                sphere_restitution(t.spheres, world, first), sphere_restitution(t.spheres, world, second)
            ),
            t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity], t.up, t.step_seconds,
        )  # fmt: skip
        moved = wp.length(shift) + t.step_seconds * wp.length(gain) > SETTLED * reach
        if moved:
            if wp.static(note is not None):
                note(spheres, world, MEETS, first, second, mine, other)
            mass = sphere_mass(t.spheres, world, first)
            other_mass = sphere_mass(t.spheres, world, second)
            share = share_of(mass, other_mass)
            others = share_of(other_mass, mass)
            mine.position -= share * shift
            mine.velocity -= share * gain
            other.position += others * shift
            other.velocity += others * gain
            if wp.length_sq(gain) > 0.0:
                mine, other = rub_pair(
                    t, world, first, second, mine, other, wp.normalize(gain), mass * share * wp.length(gain),
                    (1.0 - part) * t.step_seconds,
                )  # fmt: skip
            put_beside(t, spheres, world, time, first, mine)
            put_beside(t, spheres, world, time, second, other)
        return moved

    @wp.func
    def collide(t: Tables, spheres: Any, world: wp.int32, time: float):
        """Resolve collisions of spheres at the end of a step [s]; a sphere of zero radius is absent."""
        count = t.spheres.numbers.shape[1]
        moving = bool(True)
        sweep = wp.int32(0)
        while moving and sweep < MOST_SWEEPS:
            moving = bool(False)
            for second in range(1, count):
                for first in range(second):
                    smallest = wp.min(sphere_radius(t.spheres, world, first), sphere_radius(t.spheres, world, second))
                    if smallest > 0.0:
                        moved = meet_pair(t, spheres, world, time, first, second)
                        moving = moving or moved
            sweep += 1

    return collide

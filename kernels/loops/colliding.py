"""Spheres that meet spheres in a step, wherever they are kept: pair after pair, until nothing moves any more."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.collision import collision, mean_restitution, share_of
from balloon_warp.kernels.laws.contact import bounced, stop_of
from balloon_warp.kernels.laws.sliding import ease_of_ball, friction_impulse, spin_by
from balloon_warp.kernels.loops.friction import friction_between, number_of_sphere
from balloon_warp.kernels.loops.rolling import Course, course_of, ground_rubbing_function, leaving_function
from balloon_warp.kernels.tables import (
    Tables,
    row_of_world,
    sphere_mass,
    sphere_radius,
    sphere_restitution,
)
from balloon_warp.kernels.traits import Traits

MOST_SWEEPS = wp.constant(24)
"""Largest number of sweeps over all pairs in a step; a stack of two usually needs one or two"""
SETTLED = wp.constant(1.0e-6)
"""Displacement below which a sphere counts as at rest, over its radius"""


@wp.struct
class Paths:
    """Spheres that stand in arrays of the shape (world_count, sphere_count)."""

    starts: wp.array2d[wp.vec3]  # where they were before the step; empty where there are no two
    positions: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]


@wp.func
def paths_of(starts: wp.array2d[wp.vec3], positions: wp.array2d[wp.vec3], velocities: wp.array2d[wp.vec3]):
    paths = Paths()
    paths.starts = starts
    paths.positions = positions
    paths.velocities = velocities
    return paths


@wp.func
def path_in_arrays(t: Tables, paths: Paths, world: wp.int32, sphere: wp.int32):
    """Return a sphere's position before the step, its position after it, and its velocity."""
    return paths.starts[world, sphere], paths.positions[world, sphere], paths.velocities[world, sphere]


@wp.func
def put_in_arrays(t: Tables, paths: Paths, world: wp.int32, sphere: wp.int32, position: wp.vec3, velocity: wp.vec3):
    """Store a sphere's position and velocity after the step."""
    paths.positions[world, sphere] = position
    paths.velocities[world, sphere] = velocity


@cache
def spin_function(traits: Traits) -> Any:
    """Make the function that reads a sphere's spin [rad/s]."""

    @wp.func
    def spin_at(spins: wp.array2d[wp.vec3], world: wp.int32, sphere: wp.int32):
        if wp.static(traits.spheres_rub):
            return spins[world, sphere]
        else:
            return wp.vec3()

    return spin_at


@cache
def beside_function(traits: Traits, path_at: Any, put_sphere: Any) -> Any:
    """Make the function that puts a sphere that another has moved out of the ground and obstacles.

    Args:
        path_at, put_sphere: as in `colliding_function`.
    """
    leave_fixtures = leaving_function(traits) if traits.fixtures else None
    rub_on_ground = ground_rubbing_function(traits)
    height, ground_restitution = (
        traits.columns.places[name] - traits.columns.balloon_width for name in ("ground_height", "ground_restitution")
    )

    @wp.func
    def put_beside(
        t: Tables,
        spheres: Any,
        spins: wp.array2d[wp.vec3],
        world: wp.int32,
        time: float,
        sphere: wp.int32,
        course: Course,
    ):
        """Move a sphere that another has pushed out of the ground and obstacles."""
        radius = sphere_radius(t.spheres, world, sphere)
        if wp.static(traits.ground):
            row = row_of_world(world, t.world_numbers.shape[0])
            depth = t.world_numbers[row, height] + radius - wp.dot(course.position, t.up)
            if depth > 0.0:
                restitution = t.world_numbers[row, ground_restitution]
                stopped = stop_of(course.velocity, wp.vec3(), t.up, restitution)
                course.position += depth * t.up
                course.velocity = bounced(course.velocity, wp.vec3(), t.up, restitution)
                course = rub_on_ground(t, world, sphere, course, stopped)
        if wp.static(traits.fixtures):
            start, _end, _motion = path_at(t, spheres, world, sphere)
            course = leave_fixtures(t, world, sphere, time, start, course)
        put_sphere(t, spheres, world, sphere, course.position, course.velocity)
        if wp.static(traits.spheres_rub):
            spins[world, sphere] = course.spin

    return put_beside


@cache
def pair_rubbing_function(traits: Traits) -> Any:
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
        if wp.static(traits.spheres_rub):
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


@cache
def may_meet_function(path_at: Any) -> Any:
    """Make the function that tells whether two spheres may meet in a step.

    Args:
        path_at: as in `colliding_function`.
    """

    @wp.func
    def may_meet(t: Tables, spheres: Any, world: wp.int32, first: wp.int32, second: wp.int32):
        """Return whether two spheres are so near that they may collide in the step."""
        start, end, _velocity = path_at(t, spheres, world, first)
        other_start, other_end, _other_velocity = path_at(t, spheres, world, second)
        reach = sphere_radius(t.spheres, world, first) + sphere_radius(t.spheres, world, second)
        way = wp.length(end - start) + wp.length(other_end - other_start)
        return wp.length(other_start - start) <= 1.001 * (reach + way)

    return may_meet


@cache
def pair_meeting_function(traits: Traits, path_at: Any, put_sphere: Any) -> Any:
    """Make the function that lets two spheres meet.

    Args:
        path_at, put_sphere: as in `colliding_function`.
    """
    gravity = traits.columns.places["gravity"] - traits.columns.balloon_width
    spin_at, rub_pair = spin_function(traits), pair_rubbing_function(traits)
    put_beside = beside_function(traits, path_at, put_sphere)

    @wp.func
    def meet_pair(
        t: Tables,
        spheres: Any,
        spins: wp.array2d[wp.vec3],
        world: wp.int32,
        time: float,
        first: wp.int32,
        second: wp.int32,
    ):
        """Resolve the collision of two spheres, and return whether it has moved them."""
        reach = sphere_radius(t.spheres, world, first) + sphere_radius(t.spheres, world, second)
        start, end, velocity = path_at(t, spheres, world, first)
        other_start, other_end, other_velocity = path_at(t, spheres, world, second)
        before = other_start - start
        shift, gain, part = collision(
            before, other_end - end - before, other_velocity - velocity, reach,
            mean_restitution(
                sphere_restitution(t.spheres, world, first), sphere_restitution(t.spheres, world, second)
            ),
            t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity], t.up, t.step_seconds,
        )  # fmt: skip
        moved = wp.length(shift) + t.step_seconds * wp.length(gain) > SETTLED * reach
        if moved:
            mass = sphere_mass(t.spheres, world, first)
            other_mass = sphere_mass(t.spheres, world, second)
            own = share_of(mass, other_mass)
            others = share_of(other_mass, mass)
            mine = course_of(end - own * shift, velocity - own * gain, spin_at(spins, world, first))
            other = course_of(other_end + others * shift, other_velocity + others * gain, spin_at(spins, world, second))
            if wp.length_sq(gain) > 0.0:
                mine, other = rub_pair(
                    t, world, first, second, mine, other, wp.normalize(gain), mass * own * wp.length(gain),
                    (1.0 - part) * t.step_seconds,
                )  # fmt: skip
            put_beside(t, spheres, spins, world, time, first, mine)
            put_beside(t, spheres, spins, world, time, second, other)
        return moved

    return meet_pair


@cache
def colliding_function(traits: Traits, path_at: Any, put_sphere: Any) -> Any:
    """Make the function that lets the spheres of a world meet once all have moved, and the one that tells if two may.

    One thread does it, in the same order.

    Args:
        path_at: the function that gives a sphere's place before the step, its place after it, and its velocity.
        put_sphere: the function that gives it another place and velocity after the step.
    """
    meet_pair = pair_meeting_function(traits, path_at, put_sphere)

    @wp.func
    def collide(t: Tables, spheres: Any, spins: wp.array2d[wp.vec3], world: wp.int32, time: float):
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
                        moved = meet_pair(t, spheres, spins, world, time, first, second)
                        moving = moving or moved
            sweep += 1

    return collide, may_meet_function(path_at)

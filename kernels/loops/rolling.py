"""Motion of a sphere in a step, wherever its state is kept, before it meets particles."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import stop_of
from balloon_warp.kernels.laws.fixture import MOST_TURNS, is_settled
from balloon_warp.kernels.laws.impulse import fall
from balloon_warp.kernels.laws.sliding import rubbed
from balloon_warp.kernels.loops.fixtures import meeting_function
from balloon_warp.kernels.loops.friction import GROUND, friction_between, number_of_obstacle, number_of_sphere
from balloon_warp.kernels.tables import Tables, row_of_world, sphere_radius

ROLLS, BESIDE_GROUND, BESIDE_OBSTACLE, STUCK, MEETS = (wp.constant(number) for number in range(5))
"""Kinds of changes of a sphere's course in a step: motion, the ground or an obstacle beside it, several obstacles that
leave it no place, and another sphere"""


@wp.struct
class Course:
    """Position and velocities of a sphere."""

    position: wp.vec3
    velocity: wp.vec3
    spin: wp.vec3  # [rad/s]


@wp.func
def course_of(position: wp.vec3, velocity: wp.vec3, spin: wp.vec3):
    course = Course()
    course.position = position
    course.velocity = velocity
    course.spin = spin
    return course


@wp.func
def course_at(spheres: Any, world: wp.int32, sphere: wp.int32):
    """Return the course of a sphere as it is now."""
    return course_of(
        spheres.sphere_positions[world, sphere],
        spheres.sphere_velocities[world, sphere],
        spheres.sphere_spins[world, sphere],
    )


@wp.func
def put_course(spheres: Any, world: wp.int32, sphere: wp.int32, course: Course, spins: bool):
    """Store a sphere's course, with its spin where it has any."""
    spheres.sphere_positions[world, sphere] = course.position
    spheres.sphere_velocities[world, sphere] = course.velocity
    if spins:
        spheres.sphere_spins[world, sphere] = course.spin


@cache
def rubbing_function(features: Features) -> Any:
    """Return the function for the friction of a sphere on something immovable."""

    @wp.func
    def rub(
        t: Tables,
        world: wp.int32,
        sphere: wp.int32,
        course: Course,
        moving: wp.vec3,
        normal: wp.vec3,
        stopped: float,
        friction: float,
        seconds: float,
    ):
        """Return a sphere's course after friction at a contact that has stopped it.

        Args:
            moving: Velocity of the other surface there [m/s].
            stopped: Change of the sphere's velocity along the normal [m/s].
            friction: Coulomb friction coefficient of the pair.
            seconds: Remaining time of the step from the contact [s].
        """
        if wp.static(features.spheres_rub):
            if stopped > 0.0:
                gain, more = rubbed(
                    course.velocity, course.spin, moving, normal, stopped, sphere_radius(t.spheres, world, sphere),
                    friction,
                )  # fmt: skip
                course.position += seconds * gain
                course.velocity += gain
                course.spin += more
        return course

    return rub


@cache
def ground_rubbing_function(features: Features) -> Any:
    """Return the function for the friction of a sphere on the ground."""
    rub = rubbing_function(features)

    @wp.func
    def rub_on_ground(t: Tables, world: wp.int32, sphere: wp.int32, course: Course, stopped: float):
        """Return a sphere's course after friction on the ground, as in `rub`."""
        friction = friction_between(t, world, number_of_sphere(t, sphere), GROUND)
        return rub(t, world, sphere, course, wp.vec3(), t.up, stopped, friction, t.step_seconds)

    return rub_on_ground


@cache
def leaving_function(features: Features, note: Any = None) -> Any:
    """Return the function that moves a sphere out of obstacles.

    Args:
        note: function that is told of each change of a course, and the course before it; none where nobody asks.
    """
    meet = meeting_function(features)
    rub = rubbing_function(features)
    gravity = features.columns.places["gravity"] - features.columns.balloon_width

    @wp.func
    def leave_fixtures(
        t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32, time: float, start: wp.vec3, course: Course
    ):
        """Return a sphere out of obstacles, from which it turns by their restitution, see `stop_of`.

        Args:
            time: at the end of the step [s].
            start: where it was before the step.
        """
        radius = sphere_radius(t.spheres, world, sphere)
        fixtures = t.fixtures.solids.shape[0]
        pull = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity]
        turns = wp.int32(0)
        while turns < MOST_TURNS:
            turns += 1
            end = course.position
            for fixture in range(fixtures):
                met = meet(t, world, fixture, time, start, course.position, radius)
                if wp.length_sq(met.normal) > 0.0:
                    if wp.static(note is not None):
                        note(spheres, world, BESIDE_OBSTACLE, sphere, fixture, course, course)
                    row = row_of_world(world, t.fixtures.restitutions.shape[0])
                    restitution = t.fixtures.restitutions[row, fixture]
                    coming = -wp.dot(course.velocity - met.moving, met.normal)
                    depth = wp.dot(met.let - course.position, met.normal)
                    before = coming - t.step_seconds * pull * wp.dot(met.normal, t.up)
                    stopped = stop_of(coming, depth, before, restitution, t.step_seconds)
                    course.position = met.let + wp.max(t.step_seconds * stopped - depth, 0.0) * met.normal
                    course.velocity += stopped * met.normal
                    friction = friction_between(t, world, number_of_sphere(t, sphere), number_of_obstacle(fixture))
                    left = met.part * t.step_seconds
                    course = rub(t, world, sphere, course, met.moving, met.normal, stopped, friction, left)
            if fixtures == 1 or is_settled(start, end, course.position):
                turns = MOST_TURNS
            elif wp.static(not features.fixtures_move):
                if turns == MOST_TURNS:
                    if wp.static(note is not None):
                        note(spheres, world, STUCK, sphere, sphere, course, course)
                    course.position = start
        return course

    return leave_fixtures


@cache
def rolling_function(features: Features, note: Any = None) -> Any:
    """Return the function that moves a sphere under gravity, beside the ground and obstacles.

    Args:
        note: as in `leaving_function`.
    """
    leave_fixtures = leaving_function(features, note) if features.fixtures else None
    rub_on_ground = ground_rubbing_function(features)

    @wp.func
    def roll(
        t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32, time: float, course: Course, pushed: wp.vec3,
        around: wp.vec3,
    ):  # fmt: skip
        """Return a sphere's course after a step.

        Args:
            time: Time at the end of the step [s].
            pushed: Acceleration by particles, by the paper's rule [m/s^2].
            around: Gravity, the ground's height and its restitution.
        """
        radius = sphere_radius(t.spheres, world, sphere)
        start = course.position
        if wp.static(note is not None):
            note(spheres, world, ROLLS, sphere, sphere, course, course)
        position, velocity, stopped = fall(
            course.position, course.velocity, pushed, radius, around[0], t.up, around[1], around[2], t.step_seconds
        )
        course = rub_on_ground(t, world, sphere, course_of(position, velocity, course.spin), stopped)
        if wp.static(features.fixtures):
            course = leave_fixtures(t, spheres, world, sphere, time, start, course)
        return course

    return roll

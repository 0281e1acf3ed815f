"""Changes of a sphere's course in a step, as functions that Warp derives: motion, ground, obstacles, spheres.

Each returns where a sphere is then, and how fast, times the derivatives by that.
"""

import warp as wp

from balloon_warp.kernels.adjoints.solids import Entry, into, nearest_on_convex, slid_on_convex
from balloon_warp.kernels.laws.collision import collision, share_of
from balloon_warp.kernels.laws.contact import ease_of_ball, friction_impulse, rubbed, spin_by, stop_of
from balloon_warp.kernels.laws.impulse import fall
from balloon_warp.kernels.laws.rigid import carried
from balloon_warp.kernels.loops.fixtures import Pose
from balloon_warp.kernels.loops.spheres import Course
from balloon_warp.kernels.tables import Solid


@wp.struct
class Ball:
    """Sphere's parameters on which its course depends, besides its state."""

    force: wp.vec3
    mass: float
    radius: float
    gravity: float
    ground_height: float
    ground_restitution: float
    friction: float  # on the ground


@wp.func
def worth(position: wp.vec3, velocity: wp.vec3, spin: wp.vec3, bar: Course):
    """Return a course times its derivatives."""
    return wp.dot(position, bar.position) + wp.dot(velocity, bar.velocity) + wp.dot(spin, bar.spin)


@wp.func
def work_of_roll(course: Course, ball: Ball, up: wp.vec3, step: float, bar: Course):
    """Return a sphere's course after a step beside the ground, see `loops.rolling`, times its bars."""
    moved, going, stopped = fall(
        course.position, course.velocity, ball.force / ball.mass, ball.radius, ball.gravity, up, ball.ground_height,
        ball.ground_restitution, step,
    )  # fmt: skip
    gain, more = rubbed(going, course.spin, wp.vec3(), up, stopped, ball.radius, ball.friction)
    return worth(moved + step * gain, going + gain, course.spin + more, bar)


@wp.func
def work_on_ground(course: Course, ball: Ball, up: wp.vec3, step: float, bar: Course):
    """Return the course of a sphere that another has pushed into the ground, see `loops.colliding`, times its bars."""
    depth = ball.ground_height + ball.radius - wp.dot(course.position, up)
    coming = -wp.dot(course.velocity, up)
    stopped = stop_of(coming, step * coming, coming, ball.ground_restitution, step)
    going = course.velocity + stopped * up
    gain, more = rubbed(going, course.spin, wp.vec3(), up, stopped, ball.radius, ball.friction)
    return worth(course.position + depth * up + step * gain, going + gain, course.spin + more, bar)


@wp.func
def worth_of_turn(
    course: Course, place: wp.vec3, normal: wp.vec3, moving: wp.vec3, radius: float, up: wp.vec3, entry: Entry,
    left: float, bar: Course,
):  # fmt: skip
    """Return the course of a sphere that an obstacle lets go to a place, see `loops.rolling`, times its bars.

    Args:
        left: of the step, in which it slides.
    """
    coming = -wp.dot(course.velocity - moving, normal)
    depth = wp.dot(place - course.position, normal)
    before = coming - entry.step * entry.gravity * wp.dot(normal, up)
    stopped = stop_of(coming, depth, before, entry.restitution, entry.step)
    beyond = wp.max(entry.step * stopped - depth, 0.0)
    going = course.velocity + stopped * normal
    gain, more = rubbed(going, course.spin, moving, normal, stopped, radius, entry.friction)
    return worth(place + beyond * normal + left * entry.step * gain, going + gain, course.spin + more, bar)


@wp.func
def work_beside_mesh(
    course: Course, radius: float, let: wp.vec3, normal: wp.vec3, moving: wp.vec3, clear: float, up: wp.vec3,
    entry: Entry, left: float, bar: Course,
):  # fmt: skip
    """Return a sphere's course past a mesh with frozen normal, times its bars.

    Args:
        clear: the radius, as a constant, with which the place was found.
        left: of the step, in which it slides.
    """
    place = course.position + (wp.dot(let - course.position, normal) + radius - clear) * normal
    return worth_of_turn(course, place, normal, moving, radius, up, entry, left, bar)


@wp.func
def work_beside_convex(
    start: wp.vec3, course: Course, radius: float, solid: Solid, pose: Pose, earlier: Pose, up: wp.vec3, entry: Entry,
    bar: Course,
):  # fmt: skip
    """Return a sphere's course past a convex solid, times its bars."""
    here = into(pose, course.position)
    place, normal = nearest_on_convex(here, solid, up, radius)
    left = float(1.0)
    if entry.slides:
        slid, held, more_left = slid_on_convex(into(earlier, start), here, solid, up, radius, entry)
        place = slid
        normal = held
        left = more_left
    arm = wp.quat_rotate(pose.turn, place)
    outward = wp.quat_rotate(pose.turn, normal)
    moving = carried(pose.velocity, pose.spin, arm, -entry.step)
    return worth_of_turn(course, pose.center + arm, outward, moving, radius, up, entry, left, bar)


@wp.struct
class Pair:
    """Constants of two spheres that meet."""

    restitution: float
    friction: float
    gravity: float
    step: float  # [s]


@wp.func
def work_of_pair(
    start: wp.vec3, other_start: wp.vec3, mine: Course, other: Course, mass: float, other_mass: float, radius: float,
    other_radius: float, pair: Pair, up: wp.vec3, bar: Course, other_bar: Course,
):  # fmt: skip
    """Return the courses of two spheres that have met, see `loops.colliding`, times their bars."""
    before = other_start - start
    shift, gain, part = collision(
        before, other.position - mine.position - before, other.velocity - mine.velocity, radius + other_radius,
        pair.restitution, pair.gravity, up, pair.step,
    )  # fmt: skip
    share = share_of(mass, other_mass)
    others = share_of(other_mass, mass)
    going = mine.velocity - share * gain
    other_going = other.velocity + others * gain
    rub = wp.vec3()
    normal = up
    if wp.length_sq(gain) > 0.0:
        normal = wp.normalize(gain)
        arm = radius * normal
        other_arm = -other_radius * normal
        beside = other_going + wp.cross(other.spin, other_arm) - going - wp.cross(mine.spin, arm)
        ease = ease_of_ball(mass, radius, arm) + ease_of_ball(other_mass, other_radius, other_arm)
        rub = friction_impulse(beside, normal, ease, pair.friction * mass * share * wp.length(gain))
    left = (1.0 - part) * pair.step
    spin = mine.spin + spin_by(mass, radius, -wp.cross(radius * normal, rub))
    other_spin = other.spin + spin_by(other_mass, other_radius, wp.cross(-other_radius * normal, rub))
    place = mine.position - share * shift - (left / mass) * rub
    other_place = other.position + others * shift + (left / other_mass) * rub
    return worth(place, going - rub / mass, spin, bar) + worth(
        other_place, other_going + rub / other_mass, other_spin, other_bar
    )

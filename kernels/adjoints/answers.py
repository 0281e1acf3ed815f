"""Answers of a particle and of a sphere that exchange momentum, as functions that Warp derives.

Frozen is which particles a sphere presses, which overlap it, and whether it is pressed to the ground. Each function
returns where something is then, and how fast, times the derivatives by that.
"""

import warp as wp

from balloon_warp.kernels.adjoints.sphere_courses import worth
from balloon_warp.kernels.laws.contact import ease_of_ball, rubbed, spin_by, way_out
from balloon_warp.kernels.laws.impulse import excess_speed, gain_of_particle, way_apart
from balloon_warp.kernels.laws.rigid import rub_on
from balloon_warp.kernels.loops.spheres import Course


@wp.struct
class Common:
    """Findings of a sphere and all particles that it presses together."""

    change: wp.vec3  # of the sphere's velocity
    shift: wp.vec3  # out of overlaps
    pressed: float  # mass of the particles that it presses [kg]


@wp.struct
class Answer:
    """Constants of a particle's answer, and derivatives by it."""

    step: float  # [s]
    friction: float
    is_pressed: bool
    overlaps: bool
    place: wp.vec3  # derivatives by where the particle is, how fast, and by friction on all and its torque
    velocity: wp.vec3
    rub: wp.vec3
    torque: wp.vec3
    by_push: wp.vec3  # derivatives by its momentum along the normal, and by its mass times how far it is moved
    by_overlap: wp.vec3


@wp.func
def work_of_particle(
    point: wp.vec3, velocity: wp.vec3, ball: Course, radius: float, heavy: float, mass: float, common: Common,
    answer: Answer, up: wp.vec3,
):  # fmt: skip
    """Return a particle's gains beside a sphere, see `loops.sphere_contact`, times their bars.

    Args:
        ball: course of the sphere, before it answers.
        heavy: its mass [kg].
        mass: of the particle, with its part of the gas [kg].
    """
    way = answer.step * (velocity - ball.velocity)
    arm = point - ball.position - way
    outward = way_out(arm, wp.vec3(), up)
    gap = wp.dot(arm, outward) - radius
    work = float(0.0)
    if answer.is_pressed:
        excess = excess_speed(gap, -wp.dot(way, outward) / answer.step, answer.step)
        gain = gain_of_particle(outward, excess, common.change)
        beside = velocity + gain - ball.velocity - common.change - wp.cross(ball.spin, arm)
        share = 1.0 / (1.0 + common.pressed * ease_of_ball(heavy, radius, arm))
        rub = rub_on(beside, mass * gain, mass, share, answer.friction)
        moved = gain + rub / mass
        work += wp.dot(moved, answer.velocity + answer.step * answer.place) + mass * wp.dot(gain, answer.by_push)
        work += wp.dot(rub, answer.rub) + wp.dot(wp.cross(arm, rub), answer.torque)
    if answer.overlaps:
        aside = gain_of_particle(outward, way_apart(gap, answer.step), common.shift)
        work += wp.dot(aside, answer.place) + mass * wp.dot(aside, answer.by_overlap)
    return work


@wp.struct
class Load:
    """Friction on a sphere by all particles, and the push of the ground."""

    rub: wp.vec3  # friction on all of them [N s]
    torque: wp.vec3  # of it about the center [N m s]
    push: float  # of the ground [N s]


@wp.func
def work_of_sphere(
    ball: Course, radius: float, heavy: float, common: Common, load: Load, ground_friction: float, step: float,
    up: wp.vec3, bar: Course,
):  # fmt: skip
    """Return a sphere's course once it has answered, see `loops.sphere_contact`, times its bars."""
    gain = -load.rub / heavy
    spin = ball.spin - spin_by(heavy, radius, load.torque)
    going = ball.velocity + common.change + gain
    braked, more = rubbed(going, spin, wp.vec3(), up, load.push / heavy, radius, ground_friction)
    place = ball.position + step * (common.change + gain + braked) + common.shift
    return worth(place, going + braked, spin + more, bar)

"""Coulomb's friction as an impulse, which turns a sphere.

With w the sphere's spin and r the arm from its center to where it touches something, its surface slides there at

    s = u - (u . n) n,    u = V + w x r - (how fast the other moves there),

and an impulse against s stops as much of that as `friction` times the impulse P along n can:

    J = -min(|s| / e, friction P) s / |s|,    e = 1 / M + |r|^2 / I + (the same of the other),    I = 2/5 M R^2.

A sphere is solid, and nothing else brakes its spin. So one that is set down sliding slows down by friction g until it
rolls, at 5/7 of its speed; and down a slope it rolls with 5/7 g sin, unless that is steeper than 7/2 friction.

Particles that a sphere presses are many. Each gets k m |s| at most, see `laws.rigid`, with

    k = 1 / (1 + P e)    P the mass of all that are pressed, e the sphere's at that particle's arm:

then all of them together give no energy, since of two impulses on a sphere each shows at the other's place by no more
than the root of the product of both e. Impulses act where things meet: momentum and angular momentum stay.
"""

import warp as wp

TURNING = wp.constant(2.5)
"""M R^2 / I of a solid ball"""


@wp.func
def friction_impulse(beside: wp.vec3, normal: wp.vec3, ease: float, most: float):
    """Return J [N s].

    Args:
        beside: u [m/s].
        ease: by how much 1 N s slows down the slip [1/kg].
        most: that friction can [N s].
    """
    sliding = beside - wp.dot(beside, normal) * normal
    speed = wp.length(sliding)
    impulse = wp.vec3()
    if speed > 0.0:
        impulse = (-wp.min(speed / ease, most) / speed) * sliding
    return impulse


@wp.func
def ease_of_ball(mass: float, radius: float, arm: wp.vec3):
    """Return the inverse effective mass of a sphere at an arm, perpendicular to the arm [1/kg]."""
    return (1.0 + TURNING * wp.length_sq(arm) / (radius * radius)) / mass


@wp.func
def spin_by(mass: float, radius: float, torque: wp.vec3):
    """Spin that a sphere gains [rad/s] by an angular momentum [N m s]."""
    return (TURNING / (mass * radius * radius)) * torque


@wp.func
def rubbed(
    velocity: wp.vec3, spin: wp.vec3, moving: wp.vec3, normal: wp.vec3, stopped: float, radius: float, friction: float
):
    """Return the gain of a sphere's velocity [m/s] and spin [rad/s] by friction on something immovable.

    Args:
        moving: how fast the other moves there [m/s].
        stopped: by how much the impulse along the normal has changed its velocity [m/s].
    """
    arm = -radius * normal
    beside = velocity + wp.cross(spin, arm) - moving
    gain = friction_impulse(beside, normal, ease_of_ball(1.0, radius, arm), friction * stopped)
    return gain, spin_by(1.0, radius, wp.cross(arm, gain))

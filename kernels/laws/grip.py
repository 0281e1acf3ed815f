"""What holds a point of a free rigid body out of something: an impulse along the normal n, and Coulomb's friction.

With u the point's velocity beside what it meets and g its gap, the impulse P n is the least that makes

    n . u >= -g / h,    or e times the speed of impact, where that is faster than two steps of gravity,

and friction stops as much of u across n as an impulse of friction times P can. Points push one after the other, and
again until they agree, with their impulses so far (projected Gauss-Seidel; Catto 2005, *Iterative dynamics*).
"""

import warp as wp

from balloon_warp.kernels.laws.collision import SLOW


@wp.struct
class Grip:
    """A point of a body at something in a step."""

    normal: wp.vec3  # out of what is met, zero if there is nothing
    arm: wp.vec3  # from the body's center of mass [m]
    moving: wp.vec3  # how fast it moves there, if it goes where it is told [m/s]
    least: float  # that n . u is to be [m/s]
    friction: float
    other: wp.int32  # the body that is met, or -1
    impulse: wp.vec3  # so far [N s]


@wp.func
def least_speed(gap: float, approach: float, restitution: float, gravity: float, step_seconds: float):
    """That n . u is to be [m/s]; with `approach` the point would come nearer without contact."""
    least = -wp.max(gap, 0.0) / step_seconds
    if approach > wp.max(SLOW * step_seconds * wp.abs(gravity), -least):
        least = wp.max(least, restitution * approach)
    return least


@wp.func
def grip_impulse(grip: Grip, beside: wp.vec3, ease: float, friction_ease: float):
    """What is added to its impulse [N s].

    Args:
        beside: u, with the impulse so far [m/s].
        ease: how much n . u gains by 1 N s along n [1/kg].
        friction_ease: the same across n, along what slides.
    """
    before = wp.dot(grip.impulse, grip.normal)
    push = wp.max(before + (grip.least - wp.dot(beside, grip.normal)) / ease, 0.0)
    across = grip.impulse - before * grip.normal
    sliding = beside - wp.dot(beside, grip.normal) * grip.normal
    across -= sliding / friction_ease
    most = grip.friction * push
    length = wp.length(across)
    if length > most:
        across *= most / length
    return push * grip.normal + across - grip.impulse

"""Contact of a point of a free rigid body: a normal impulse and Coulomb friction.

With u the point's velocity beside what it meets and g its gap, the impulse P n is the least that makes

    n . u >= -g / h,    or the speed of the rebound, where it comes faster than two steps of gravity,

and friction stops as much of u across n as an impulse of friction times P can. Points push one after the other, and
again until they agree, with their impulses so far (projected Gauss-Seidel; Catto 2005, *Iterative dynamics*), from
where those of the step before ended. Between two sweeps all go on by a part of what the last has changed, which grows
with their number, until that leads back (Nesterov's acceleration, begun anew; O'Donoghue and Candes 2015; Mazhar et al.
2015). So a light body under one a thousand times as heavy needs a hundred sweeps, not thousands.
"""

import warp as wp

from balloon_warp.kernels.laws.collision import SLOW

OUT_IN_STEP = wp.constant(0.2)
"""Fraction of an overlap that a step removes"""
FASTEST_OUT = wp.constant(3.0)
"""Largest speed at which an overlap is removed [m/s]"""
AGREED = wp.constant(3.0e-5)
"""Largest change in a sweep at convergence, over the fastest approach or a step of gravity"""
LEAST_SWEEPS, MOST_SWEEPS, MOST_PUSHES = wp.constant(50), wp.constant(1000), wp.constant(100_000)
"""Bounds on sweeps over all touching points in a step, and on their product, the number of point updates; one or two
sweeps suffice where things rest"""
BLURRED_SIZE = wp.constant(1.0e-5)
"""Gap or overlap that counts as zero, over a body's extent"""
BLURRED_PLACE = wp.constant(4.0e-7)
"""Gap or overlap that counts as zero, over the distance to the origin, by the resolution of float32"""
MOST_SWEEPS_OUT = wp.constant(16)
"""Largest number of sweeps that remove overlaps"""
APART = wp.constant(0.01)
"""Largest change of an overlap in a sweep at convergence, over the deepest overlap"""
ROUNDING = wp.constant(4.0e-6)
"""Relative resolution of an impulse in float32"""


@wp.struct
class Grip:
    """A point of a body at something in a step."""

    key: wp.int32  # which point at which thing; they ascend in a list
    body: wp.int32
    other: wp.int32  # the body that is met, or -1
    normal: wp.vec3  # out of what is met
    arm: wp.vec3  # from the body's center of mass [m]
    other_arm: wp.vec3  # from that of the other
    moving: wp.vec3  # how fast it moves there, if it goes where it is told [m/s]
    gap: float  # [m]
    least: float  # that n . u is to be [m/s]
    ease: float  # how much n . u gains by 1 N s along n [1/kg]
    friction: float
    restitution: float
    impulse: wp.vec3  # so far [N s]
    added: wp.vec3  # to it in the last sweep
    ahead: wp.vec3  # by which it went on before that


@wp.func
def rebound_speed(gap: float, approach: float, restitution: float, pull: float, step_seconds: float):
    """Return the speed at which a body rebounds from a surface that it would reach in a step [m/s].

    The body turns around where it is, not at the surface.

    The step's own energy, v^2 / 2 + a g + a h v / 2 of a point that is g away and comes at v, is kept to the last bit
    by symplectic Euler. Here it becomes e^2 of what it was: so no energy is gained, and heights are e^2 of those
    before, whatever the step.

    Args:
        approach: v, before gravity acts.
        restitution: e
        pull: a, by which it comes faster [m/s^2].
    """
    kick = step_seconds * pull
    kept = restitution * restitution
    squared = 0.25 * kick * kick + kept * approach * (approach + kick) - 2.0 * (1.0 - kept) * pull * gap
    return wp.sqrt(wp.max(squared, 0.0)) - 0.5 * kick


@wp.func
def least_speed(gap: float, approach: float, restitution: float, pull: float, slow: float, step_seconds: float):
    """Return the least n . u [m/s] at a given `gap`, for an `approach` before gravity acts.

    Args:
        pull: the acceleration by which it comes faster [m/s^2].
        slow: what comes no faster does not rebound [m/s].
    """
    away = wp.max(gap, 0.0)
    least = -away / step_seconds
    if approach > slow and approach + step_seconds * pull > -least:
        least = wp.max(least, rebound_speed(away, approach, restitution, pull, step_seconds))
    return least


@wp.func
def slowest_rebound(gravity: float, step_seconds: float):
    """Return the speed [m/s] up to which nothing rebounds."""
    return SLOW * step_seconds * wp.abs(gravity)


@wp.func
def clear_gap(gap: float, reach: float, place: wp.vec3):
    """Return the gap [m], or none where it is too small to count.

    So rounding of places does not move a body at rest. A larger gap closes all the way, and does not stay at the edge
    of that.
    """
    blurred = BLURRED_SIZE * reach + BLURRED_PLACE * wp.length(place)
    return wp.where(wp.abs(gap) <= blurred, 0.0, gap)


@wp.func
def way_out_of(gap: float, step_seconds: float):
    """Return the growth of a gap in a step [m]: a fraction of an overlap; an open gap may close."""
    if gap < 0.0:
        return wp.min(-OUT_IN_STEP * gap, FASTEST_OUT * step_seconds)
    return -gap


@wp.func
def grip_impulse(grip: Grip, beside: wp.vec3, friction_ease: float, friction: float):
    """Return the increment of the impulse at a grip [N s].

    Args:
        beside: u, with the impulse so far [m/s].
        friction_ease: how much u gains by 1 N s across n, along what slides [1/kg].
    """
    before = wp.dot(grip.impulse, grip.normal)
    speed = wp.dot(beside, grip.normal)
    push = wp.max(before + (grip.least - speed) / grip.ease, 0.0)
    across = grip.impulse - before * grip.normal - (beside - speed * grip.normal) / friction_ease
    most = friction * push
    length = wp.length(across)
    if length > most:
        across *= most / length
    return push * grip.normal + across - grip.impulse


@wp.func
def most_sweeps(count: wp.int32):
    """Return the largest number of sweeps over a number of points."""
    return wp.clamp(MOST_PUSHES // wp.max(count, 1), LEAST_SWEEPS, MOST_SWEEPS)


@wp.func
def has_agreed(grip: Grip, allowed: float):
    """Return whether the last sweep changed no more than a speed [m/s], or than float32 resolves."""
    return wp.length(grip.added) * grip.ease <= allowed + ROUNDING * wp.length(grip.impulse) * grip.ease


@wp.func
def going_on(age: float):
    """Return the momentum factor of Nesterov's acceleration, by the number of sweeps since its restart."""
    return wp.max(age - 1.0, 0.0) / (age + 2.0)

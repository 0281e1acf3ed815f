"""Contact of a point of a free rigid body: a normal impulse and Coulomb friction.

With u the point's velocity beside the surface that it meets and g its gap, the impulse P n is the least that makes

    n . u >= -g / h,    or the speed of the rebound, where it comes faster than two steps of gravity
    and of strings that are tied to it,

and friction stops as much of u across n as an impulse of friction times P can. Points push one after the other, and
again until they agree, with their impulses so far (projected Gauss-Seidel; Catto 2005, *Iterative dynamics*), from
where those of the step before ended. Between two sweeps all go on by a part of the last one's change, which grows with
their number, until that leads back (Nesterov's acceleration, begun anew; O'Donoghue and Candes 2015; Mazhar et al.
2015). So a light body under one a thousand times as heavy needs a hundred sweeps, not thousands.

Friction and rebounds at several points may give energy (Kane's paradox), and so take place in part. With v the velocity
beside that surface before gravity and strings act, and P the impulse there as a vector, bodies that touch gain

    G = sum P . (v + u) / 2

in energy of motion and, as the step has it, of height; things with motion of their own add their work. Without
rebounds, n . u <= 0 where P . n > 0, and friction acts against u: G = sum P . u less the energy of the change of motion
is below zero, but for weight that comes to rest. From those impulses to those with rebounds, P + s (P' - P), all is
linear: they keep momentum, nothing enters anything, friction is as much as Coulomb allows, and G is a square of s. So
it is s = 1, or if that gives energy the largest s that does not. Where impulses without rebound do not agree, as those
of much friction may never do, and give energy, all of them are less by a share, likewise.
"""

import warp as wp

from balloon_warp.kernels.laws.collision import SLOW

OUT_IN_STEP = wp.constant(0.2)
"""Fraction of an overlap that a step removes"""
FASTEST_OUT = wp.constant(3.0)
"""Largest speed at which an overlap is removed [m/s]"""
AGREED = wp.constant(3.0e-6)
"""Largest change in a sweep at convergence, over the fastest approach or a step of gravity"""
LEAST_SWEEPS, MOST_SWEEPS, MOST_PUSHES = wp.constant(50), wp.constant(1000), wp.constant(100_000)
"""Bounds on sweeps over all touching points in a step, and on their product, the number of point updates; one or two
sweeps suffice where things rest"""
BLURRED_SIZE = wp.constant(1.0e-5)
"""Gap or overlap that counts as zero, over a body's extent"""
BLURRED_PLACE = wp.constant(4.0e-7)
"""Gap or overlap that counts as zero, over the distance to the origin, by the resolution of float32"""
APART = wp.constant(0.01)
"""Largest change of an overlap in a sweep at convergence, over the deepest overlap"""


@wp.struct
class Grip:
    """A point of a body at something in a step."""

    key: wp.int32  # which point at which thing; they ascend in a list
    body: wp.int32
    other: wp.int32  # the body that is met, or -1
    normal: wp.vec3  # out of the surface that is met
    arm: wp.vec3  # from the body's center of mass [m]
    other_arm: wp.vec3  # from that of the other
    moving: wp.vec3  # how fast it moves there, if it goes where it is told [m/s]
    gap: float  # [m]
    least: float  # that n . u is to be [m/s]
    closing: float  # likewise without rebound
    ease: float  # how much n . u gains by 1 N s along n [1/kg]
    friction: float
    restitution: float
    impulse: wp.vec3d  # so far [N s]
    added: wp.vec3d  # to it in the last sweep
    ahead: wp.vec3d  # by which it went on before that
    before: wp.vec3d  # velocity beside that surface, before gravity and strings act [m/s]
    rebound: wp.vec3d  # the impulse with all rebounds [N s]
    leaving: wp.vec3d  # u with these [m/s]


@wp.func
def rebound_speed(gap: float, approach: float, restitution: float, pull: float, step_seconds: float):
    """Return the speed at which a body rebounds from a surface that it would reach in a step [m/s].

    The body turns around where it is, not at the surface.

    The step's own energy, v^2 / 2 + a g + a h v / 2 of a point that is g away and comes at v, is kept to the last bit
    by symplectic Euler. Here it becomes e^2 of its value: so no energy is gained, and heights are e^2 of those
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
        slow: a point that comes no faster does not rebound [m/s].
    """
    away = wp.max(gap, 0.0)
    least = -away / step_seconds
    if approach > slow and approach + step_seconds * pull > -least:
        least = wp.max(least, rebound_speed(away, approach, restitution, pull, step_seconds))
    return least


@wp.func
def rebound_share(without: wp.float64, whole: wp.float64, curve: wp.float64):
    """Return the share s of a rebound, from 0 to 1, at which bodies that touch gain no energy.

    Args:
        without: their gain without rebound, G(0) [J].
        whole: with all of it, G(1).
        curve: sum (P' - P) . (u' - u) / 2, the square's: no less than zero.
    """
    share = wp.float64(1.0)
    lost = wp.max(-without, wp.float64(0.0))
    if whole > without + lost:
        slope = whole - without - curve
        root = wp.sqrt(slope * slope + wp.float64(4.0) * curve * lost)
        if slope > wp.float64(0.0):
            share = wp.float64(2.0) * lost / (slope + root)
        else:
            share = (root - slope) / (wp.float64(2.0) * curve)
    return share


@wp.func
def push_share(without: wp.float64, free: wp.float64):
    """Return the share of impulses that do not agree at which bodies that touch gain no energy, from 0 to 1.

    The gain is a square of the share, which begins at none.

    Args:
        without: their gain by all of them, without rebound [J].
        free: sum P . (v + u) / 2, u as it were without impulses.
    """
    share = wp.float64(1.0)
    if without > wp.float64(0.0):
        share = wp.clamp(free / (free - without), wp.float64(0.0), wp.float64(1.0))
    return share


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
def grip_impulse(grip: Grip, beside: wp.vec3d, friction_ease: float, friction: float):
    """Return the increment of the impulse at a grip [N s].

    Args:
        beside: u, with the impulse so far [m/s].
        friction_ease: how much u gains by 1 N s across n, along the slip [1/kg].
    """
    normal = wp.vec3d(grip.normal)
    before = wp.dot(grip.impulse, normal)
    speed = wp.dot(beside, normal)
    push = wp.max(before + (wp.float64(grip.least) - speed) / wp.float64(grip.ease), wp.float64(0.0))
    across = grip.impulse - before * normal - (beside - speed * normal) / wp.float64(friction_ease)
    most = wp.float64(friction) * push
    length = wp.length(across)
    if length > most:
        across *= most / length
    return push * normal + across - grip.impulse


@wp.func
def most_sweeps(count: wp.int32):
    """Return the largest number of sweeps over a number of points."""
    return wp.clamp(MOST_PUSHES // wp.max(count, 1), LEAST_SWEEPS, MOST_SWEEPS)


@wp.func
def has_agreed(grip: Grip, allowed: float):
    """Return whether the last sweep changed no more than a speed [m/s]."""
    return float(wp.length(grip.added)) * grip.ease <= allowed


@wp.func
def going_on(age: float):
    """Return the momentum factor of Nesterov's acceleration, by the number of sweeps since its restart."""
    return wp.max(age - 1.0, 0.0) / (age + 2.0)

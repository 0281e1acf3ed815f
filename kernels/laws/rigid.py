"""Free rigid bodies: rotation, impulses between them and particles, and friction of their points.

Contact of a point of a free rigid body: a normal impulse and Coulomb friction. With u the point's velocity beside the
surface that it meets and g its gap, the impulse P n is the least that makes

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

Free rigid body: its rotation, and what impulses at its points do. Without torque its angular momentum L stays, in the
axes of the world, to the last bit: it is L that is kept, and the spin w = R J^-1 R^T L follows from how the body is
turned, R. A step turns it by the mean of its angular momenta as the body sees them before and after, l = R^T L and l',

    R' = R exp(h W),    W = J^-1 (l + l') / 2,    l' = exp(-h W) l.

So turns remain turns, and energy of motion stays: l' - l is square to W, and E' - E = (l' - l) . J^-1 (l + l') / 2 is
their product. It is solved by Newton's method for M = (l + l') / 2: by half the angle, M + k W x M = l, where k is h /
2 times tan(a) / a at a = h |W| / 2. How it has turned is off by the square of the step.
"""

import warp as wp

from balloon_warp.kernels.laws.contact import SLOW, friction_impulse

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
    inverse_mass: float  # how much n . u gains by 1 N s along n [1/kg]
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
def min_speed(gap: float, approach: float, restitution: float, pull: float, slow: float, step_seconds: float):
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
def gap_growth(gap: float, step_seconds: float):
    """Return the growth of a gap in a step [m]: a fraction of an overlap; an open gap may close."""
    if gap < 0.0:
        return wp.min(-OUT_IN_STEP * gap, FASTEST_OUT * step_seconds)
    return -gap


@wp.func
def grip_impulse(grip: Grip, beside: wp.vec3d, friction_inverse_mass: float, friction: float):
    """Return the increment of the impulse at a grip [N s].

    Args:
        beside: u, with the impulse so far [m/s].
        friction_inverse_mass: how much u gains by 1 N s across n, along the slip [1/kg].
    """
    normal = wp.vec3d(grip.normal)
    before = wp.dot(grip.impulse, normal)
    speed = wp.dot(beside, normal)
    push = wp.max(before + (wp.float64(grip.least) - speed) / wp.float64(grip.inverse_mass), wp.float64(0.0))
    across = grip.impulse - before * normal - (beside - speed * normal) / wp.float64(friction_inverse_mass)
    most = wp.float64(friction) * push
    length = wp.length(across)
    if length > most:
        across *= most / length
    return push * normal + across - grip.impulse


@wp.func
def max_sweeps(count: wp.int32):
    """Return the largest number of sweeps over a number of points."""
    return wp.clamp(MOST_PUSHES // wp.max(count, 1), LEAST_SWEEPS, MOST_SWEEPS)


@wp.func
def sweep_has_converged(grip: Grip, allowed: float):
    """Return whether the last sweep changed no more than a speed [m/s]."""
    return float(wp.length(grip.added)) * grip.inverse_mass <= allowed


@wp.func
def momentum_factor(age: float):
    """Return the momentum factor of Nesterov's acceleration, by the number of sweeps since its restart."""
    return wp.max(age - 1.0, 0.0) / (age + 2.0)


MOST_TURN = wp.constant(0.5)
"""Largest angle that a body turns at once; a step of a larger one has several parts [rad]"""
MOST_PARTS = wp.constant(16)
"""Largest number of such parts"""
AGREED_TURN = wp.constant(1.0e-6)
"""Residual at which Newton's iterations end, over the angular momentum"""
MAX_SPIN_ITERATIONS = wp.constant(8)
"""Largest number of Newton iterations for a turn; two to five usually suffice"""


@wp.func
def spin_of(turn: wp.quat, inverse_inertia: wp.mat33, mass: float, momentum: wp.vec3):
    """Return the angular velocity w [rad/s] of a body from its orientation and angular momentum [kg m^2/s].

    Args:
        inverse_inertia: Inverse of the inertia tensor of 1 kg [1/m^2].
    """
    return wp.quat_rotate(turn, inverse_inertia * wp.quat_rotate_inv(turn, momentum)) / mass


@wp.func
def turned_by(turn: wp.quat, way: wp.vec3):
    """Turn about an axis, by its length [rad]."""
    angle = wp.length(way)
    if angle > 0.0:
        return wp.normalize(wp.quat_from_axis_angle(way / angle, angle) * turn)
    return turn


@wp.func
def carried(velocity: wp.vec3, spin: wp.vec3, arm: wp.vec3, seconds: float):
    """Return the velocity along the chord on which a place goes in a step; along the tangent it would leave its circle.

    The sine of the angle and its cosine are series: to 2e-4 at one radian in a step.

    Args:
        velocity: of the center [m/s].
        spin: [rad/s].
        arm: from the center to the place, as the step begins; or as it ends, if `seconds` are negative.
    """
    angle = wp.length_sq(spin) * seconds * seconds
    along = wp.cross(spin, arm)
    inward = (0.5 * seconds * (1.0 - angle / 12.0 + angle * angle / 360.0)) * wp.cross(spin, along)
    return velocity + (1.0 - angle / 6.0 + angle * angle / 120.0) * along + inward


@wp.func
def carried_along(velocity: wp.vec3, spin: wp.vec3, center_arm: wp.vec3, arm: wp.vec3, normal: wp.vec3, seconds: float):
    """Return the velocity of a surface at a point of a body that may turn with it.

    Along the surface it is that which takes the body's center along its chord: the body's points then go along theirs
    by its own turn. To each of them alone, friction would ask the body to shrink.

    Args:
        velocity: of the center of the carrier [m/s].
        spin: likewise [rad/s].
        center_arm: from there to the body's center, as the step begins [m].
        arm: from the body's center to the point [m].
        normal: of the surface.
    """
    along = carried(velocity, spin, center_arm, seconds) + wp.cross(spin, arm)
    chord = carried(velocity, spin, center_arm + arm, seconds)
    return along + wp.dot(chord - along, normal) * normal


@wp.func
def mean_spin(momentum: wp.vec3, inverse_inertia: wp.mat33, seconds: float):
    """Return the spin by which a body turns for some seconds [rad/s], W, in its own axes.

    Args:
        momentum: angular, as they begin, in its own axes [kg m^2/s].
        inverse_inertia: inverse of the inertia tensor [1/(kg m^2)].
    """
    mean = momentum
    iterations = wp.int32(0)
    while iterations < MAX_SPIN_ITERATIONS:
        iterations += 1
        spin = inverse_inertia * mean
        half = 0.5 * seconds
        angle = half * wp.length(spin)
        if angle > 0.0:
            half *= wp.tan(angle) / angle
        off = mean - momentum + half * wp.cross(spin, mean)
        if wp.length(off) <= AGREED_TURN * wp.length(momentum):
            iterations = MAX_SPIN_ITERATIONS
        else:
            slope = wp.identity(n=3, dtype=float) + half * (wp.skew(spin) - wp.skew(mean) * inverse_inertia)
            mean -= wp.inverse(slope) * off
    return inverse_inertia * mean


@wp.func
def turned(turn: wp.quat, inverse_inertia: wp.mat33, mass: float, momentum: wp.vec3, step_seconds: float):
    """Return a body's orientation after a step."""
    angle = step_seconds * wp.length(spin_of(turn, inverse_inertia, mass, momentum))
    parts = wp.clamp(wp.int32(wp.ceil(wp.min(angle / MOST_TURN, float(MOST_PARTS)))), 1, MOST_PARTS)
    seconds = step_seconds / float(parts)
    for _part in range(parts):
        spin = mean_spin(wp.quat_rotate_inv(turn, momentum), inverse_inertia / mass, seconds)
        turn = turned_by(turn, seconds * wp.quat_rotate(turn, spin))
    return turn


@wp.func
def inertia_in_world(turn: wp.quat, inertia: wp.mat33):
    """Return the inertia in the world, R J R^T."""
    matrix = wp.quat_to_matrix(turn)
    return matrix * inertia * wp.transpose(matrix)


@wp.func
def inverse_mass_along(turn: wp.quat, inverse_inertia: wp.mat33, mass: float, arm: wp.vec3, normal: wp.vec3):
    """Return the inverse effective mass of a body's point along n [1/kg]."""
    torque = wp.cross(arm, normal)
    return 1.0 / mass + wp.dot(torque, spin_of(turn, inverse_inertia, mass, torque))


@wp.func
def rub_on(beside: wp.vec3, pushed: wp.vec3, mass: float, share: float, friction: float):
    """Return the impulse of friction on a particle [N s].

    Args:
        beside: its velocity beside the body's point there.
        pushed: the impulse along n.
    """
    return friction_impulse(beside, wp.normalize(pushed), 1.0 / (share * mass), friction * wp.length(pushed))

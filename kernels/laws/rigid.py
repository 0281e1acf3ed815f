"""Free rigid body: its rotation, and what impulses at its points do.

Without torque its angular momentum L stays, in the axes of the world, to the last bit: it is L that is kept, and the
spin w = R J^-1 R^T L follows from how the body is turned, R. A step turns it by the mean of its angular momenta as the
body sees them before and after, l = R^T L and l',

    R' = R exp(h W),    W = J^-1 (l + l') / 2,    l' = exp(-h W) l.

So turns remain turns, and energy of motion stays: l' - l is square to W, and E' - E = (l' - l) . J^-1 (l + l') / 2 is
their product. It is solved by Newton's method for M = (l + l') / 2: by half the angle, M + k W x M = l, where k is
h / 2 times tan(a) / a at a = h |W| / 2. How it has turned is off by the square of the step.
"""

import warp as wp

from balloon_warp.kernels.laws.sliding import friction_impulse

MOST_TURN = wp.constant(0.5)
"""Largest angle that a body turns at once; a step of a larger one has several parts [rad]"""
MOST_PARTS = wp.constant(16)
"""Largest number of such parts"""
AGREED_TURN = wp.constant(1.0e-6)
"""Residual at which Newton's iterations end, over the angular momentum"""
MOST_LOOKS = wp.constant(8)
"""Largest number of Newton iterations for a turn; two to five usually suffice"""


@wp.func
def spin_of(turn: wp.quat, ease: wp.mat33, mass: float, momentum: wp.vec3):
    """Return the angular velocity w [rad/s] of a body from its orientation and angular momentum [kg m^2/s].

    Args:
        ease: Inverse of the inertia tensor of 1 kg [1/m^2].
    """
    return wp.quat_rotate(turn, ease * wp.quat_rotate_inv(turn, momentum)) / mass


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
def mean_spin(momentum: wp.vec3, ease: wp.mat33, seconds: float):
    """Return the spin by which a body turns for some seconds [rad/s], W, in its own axes.

    Args:
        momentum: angular, as they begin, in its own axes [kg m^2/s].
        ease: inverse of the inertia tensor [1/(kg m^2)].
    """
    mean = momentum
    looks = wp.int32(0)
    while looks < MOST_LOOKS:
        looks += 1
        spin = ease * mean
        half = 0.5 * seconds
        angle = half * wp.length(spin)
        if angle > 0.0:
            half *= wp.tan(angle) / angle
        off = mean - momentum + half * wp.cross(spin, mean)
        if wp.length(off) <= AGREED_TURN * wp.length(momentum):
            looks = MOST_LOOKS
        else:
            slope = wp.identity(n=3, dtype=float) + half * (wp.skew(spin) - wp.skew(mean) * ease)
            mean -= wp.inverse(slope) * off
    return ease * mean


@wp.func
def turned(turn: wp.quat, ease: wp.mat33, mass: float, momentum: wp.vec3, step_seconds: float):
    """Return a body's orientation after a step."""
    angle = step_seconds * wp.length(spin_of(turn, ease, mass, momentum))
    parts = wp.clamp(wp.int32(wp.ceil(wp.min(angle / MOST_TURN, float(MOST_PARTS)))), 1, MOST_PARTS)
    seconds = step_seconds / float(parts)
    for _part in range(parts):
        spin = mean_spin(wp.quat_rotate_inv(turn, momentum), ease / mass, seconds)
        turn = turned_by(turn, seconds * wp.quat_rotate(turn, spin))
    return turn


@wp.func
def inertia_in_world(turn: wp.quat, inertia: wp.mat33):
    """Return the inertia in the world, R J R^T."""
    matrix = wp.quat_to_matrix(turn)
    return matrix * inertia * wp.transpose(matrix)


@wp.func
def ease_along(turn: wp.quat, ease: wp.mat33, mass: float, arm: wp.vec3, normal: wp.vec3):
    """Return the inverse effective mass of a body's point along n [1/kg]."""
    torque = wp.cross(arm, normal)
    return 1.0 / mass + wp.dot(torque, spin_of(turn, ease, mass, torque))


@wp.func
def rub_on(beside: wp.vec3, pushed: wp.vec3, mass: float, share: float, friction: float):
    """Return the impulse of friction on a particle [N s].

    Args:
        beside: its velocity beside the body's point there.
        pushed: the impulse along n.
    """
    return friction_impulse(beside, wp.normalize(pushed), 1.0 / (share * mass), friction * wp.length(pushed))

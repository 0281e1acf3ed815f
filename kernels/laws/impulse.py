"""Contact that keeps momentum and gives no energy, of a body and the particles that it meets: `contact = "impulse"`.

It acts on velocities, before places follow them. A step h lets a particle with the gap g to a body, along the unit
vector n from the body, approach by g at most:

    n . (v_p' - V') >= -g / h

Particles and body take the velocities nearest to those without contact, measured by kinetic energy, at which that
holds for all particles (an inelastic contact). They exchange an impulse along n. So

- momentum stays, and angular momentum, since n passes through both at the step's start and places follow velocities;
- kinetic energy does not grow, whatever the step and the masses: the velocities that are allowed are a convex set which
  has rest in it, and the nearest of a convex set to a given vector is no longer than that;
- nothing is moved against springs: the particle goes to the surface, and not into the body and out again.

With a_p = -n . (v_p - V) - g / h, by how much a particle comes too fast, the body's velocity changes by the D of

    (M I + sum m n n^T) D = -sum m a_p n       over particles that it presses, those with n . D + a_p > 0

and each of those by (n . D + a_p) n. Which those are is found by solving again (Newton's method, of a convex function).

An overlap, at the start or since something else moved the particle, may not grow, and is resolved slowly, by mass, so
that the common center of mass stays, and without speed.
"""

import warp as wp

from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.laws.contact import stop_of, way_out

Press = wp.types.vector(length=18, dtype=wp.float32)
"""Sums over the particles that a body presses: m n n^T [kg], its six different numbers, and m a n [kg m/s]; and over
those that overlap it: the same, and m n times the distance to move each out [kg m]"""
PRESSED, OVERLAPPING = wp.constant(0), wp.constant(9)
"""Offsets of the two sets of numbers in `Press`"""
MOST_ITERATIONS = wp.constant(16)
"""Largest number of Newton iterations; two or three usually suffice"""
NEAR_BODY = wp.constant(65.0 / 64.0)
"""Radius within which particles are considered, over a body's radius"""
APART_RATE = wp.constant(10.0)
"""Rate at which an overlap decays [1/s]"""
MOST_APART = wp.constant(0.2)
"""Largest fraction of an overlap that is removed in a step"""
FREE = wp.constant(-1.0e30)
"""Marker: excess speed of a particle that is not near [m/s]"""
GROUND_MASS = wp.constant(wp.float64(1.0e6))
"""Mass of the ground over the total mass of all that moves"""


@wp.func
def excess_speed(gap: float, approach: float, step_seconds: float):
    """Return the excess approach speed of two things [m/s], beyond the speed that closes the gap in a step."""
    return approach - wp.max(gap, 0.0) / step_seconds


@wp.func
def way_apart(gap: float, step_seconds: float):
    """Return the distance by which two overlapping things are moved apart in a step [m]."""
    return wp.max(-gap, 0.0) * wp.min(APART_RATE * step_seconds, MOST_APART)


@wp.func
def comes_near(start: wp.vec3, way: wp.vec3, radius: float):
    """Return whether a particle may meet a sphere in a step.

    The test doubles the particle's path and enlarges the sphere a little.

    Args:
        start: Position relative to the sphere's center before the step [m].
        way: Displacement relative to the sphere in the step [m].
    """
    nearest = start + wp.clamp(-wp.dot(start, way) / squared_length(way), 0.0, 2.0) * way
    return wp.length_sq(nearest) < (NEAR_BODY * radius) * (NEAR_BODY * radius)


@wp.func
def meet_sphere(start: wp.vec3, way: wp.vec3, radius: float, up: wp.vec3, step_seconds: float):
    """Return the direction from a sphere to a particle, the excess approach speed, and the displacement out.

    Args:
        start: from the sphere's center, before the step.
        way: in the step, beside the sphere, without contact.
    """
    outward = wp.vec3()
    excess = float(FREE)
    out = float(0.0)
    if comes_near(start, way, radius):
        outward = way_out(start, wp.vec3(), up)
        gap = wp.dot(start, outward) - radius
        excess = excess_speed(gap, -wp.dot(way, outward) / step_seconds, step_seconds)
        out = way_apart(gap, step_seconds)
    return outward, excess, out


@wp.func
def is_pressed(outward: wp.vec3, excess: float, change: wp.vec3):
    """Return whether a body with a given velocity change presses a particle."""
    return wp.dot(outward, change) + excess > 0.0


@wp.func
def put_part(press: Press, first: wp.int32, mass: float, outward: wp.vec3, rest: float):
    """Store m n n^T and m `rest` n as nine numbers."""
    towards = mass * outward
    lost = rest * towards
    press[first] = towards[0] * outward[0]
    press[first + 1] = towards[0] * outward[1]
    press[first + 2] = towards[0] * outward[2]
    press[first + 3] = towards[1] * outward[1]
    press[first + 4] = towards[1] * outward[2]
    press[first + 5] = towards[2] * outward[2]
    press[first + 6] = lost[0]
    press[first + 7] = lost[1]
    press[first + 8] = lost[2]
    return press


@wp.func
def press_of_particle(mass: float, outward: wp.vec3, excess: float, out: float, change: wp.vec3):
    """Return a particle's contribution to `Press`, beside a body with a given velocity change."""
    press = Press()
    if is_pressed(outward, excess, change):
        press = put_part(press, PRESSED, mass, outward, excess)
    if out > 0.0:
        press = put_part(press, OVERLAPPING, mass, outward, out)
    return press


@wp.func
def mass_in(press: Press, first: wp.int32):
    """Return the mass of the pressing particles from nine numbers [kg], the trace of the sum of m n n^T."""
    return press[first] + press[first + 3] + press[first + 5]


@wp.func
def is_met(press: Press):
    """Return whether any particle presses a body or overlaps it."""
    return mass_in(press, PRESSED) + mass_in(press, OVERLAPPING) > 0.0


@wp.func
def common_inertia(press: Press, first: wp.int32, mass: float, ground: wp.float64, up: wp.vec3):
    """Return M I + sum m n n^T of a body and the particles that it meets [kg], from nine numbers."""
    m = wp.float64(mass)
    xy = wp.float64(press[first + 1])
    xz = wp.float64(press[first + 2])
    yz = wp.float64(press[first + 4])
    xx = m + wp.float64(press[first])
    yy = m + wp.float64(press[first + 3])
    zz = m + wp.float64(press[first + 5])
    high = wp.vec3d(up)
    return wp.mat33d(xx, xy, xz, xy, yy, yz, xz, yz, zz) + ground * wp.outer(high, high)


@wp.func
def common_gain(press: Press, first: wp.int32, mass: float, ground: wp.float64, up: wp.vec3, sinking: float):
    """Return the solution D of (M I + sum m n n^T) D = -sum m a n.

    The sums are nine numbers; the ground counts as one more particle of its own mass.
    """
    lost = wp.vec3d(wp.float64(press[first + 6]), wp.float64(press[first + 7]), wp.float64(press[first + 8]))
    lost -= (ground * wp.float64(sinking)) * wp.vec3d(up)
    return -wp.vec3(wp.inverse(common_inertia(press, first, mass, ground, up)) * lost)


@wp.func
def ground_beside(press: Press, mass: float, up: wp.vec3, sinking: float, change: wp.vec3):
    """Return the mass of the ground [kg], where a body with a given velocity change is pressed to it, or 0."""
    if is_pressed(-up, sinking, change):
        return GROUND_MASS * wp.float64(mass + mass_in(press, PRESSED))
    return wp.float64(0.0)


@wp.func
def change_of_body(press: Press, mass: float, up: wp.vec3, sinking: float, change: wp.vec3):
    """Return the change of a body's velocity by the particles that it presses [m/s].

    Args:
        sinking: Excess approach speed toward the ground [m/s], see `excess_speed`.
        change: Velocity change for which the pressed particles were found; the ground's contact is found here.
    """
    ground = ground_beside(press, mass, up, sinking, change)
    return common_gain(press, PRESSED, mass, ground, up, sinking)


@wp.func
def push_of_ground(press: Press, mass: float, up: wp.vec3, change: wp.vec3):
    """Return the impulse of the ground on a body that particles press to it [N s]."""
    lost = wp.vec3(press[PRESSED + 6], press[PRESSED + 7], press[PRESSED + 8])
    of_particles = wp.vec3(
        press[PRESSED] * change[0] + press[PRESSED + 1] * change[1] + press[PRESSED + 2] * change[2],
        press[PRESSED + 1] * change[0] + press[PRESSED + 3] * change[1] + press[PRESSED + 4] * change[2],
        press[PRESSED + 2] * change[0] + press[PRESSED + 4] * change[1] + press[PRESSED + 5] * change[2],
    )
    return wp.max(wp.dot(up, mass * change + of_particles + lost), 0.0)


@wp.func
def shift_of_body(press: Press, mass: float, up: wp.vec3):
    """Return the displacement of a body out of the particles that overlap it [m]."""
    return common_gain(press, OVERLAPPING, mass, wp.float64(0.0), up, 0.0)


@wp.func
def is_converged(change: wp.vec3, last: wp.vec3):
    """Return whether another iteration changed nothing."""
    return wp.length_sq(change - last) <= 1.0e-12 * wp.length_sq(change)


@wp.func
def gain_of_particle(outward: wp.vec3, excess: float, change: wp.vec3):
    """Return the velocity change of a pressed particle for that of its body [m/s].

    Or how far one is moved out of an overlap [m], beside a body that is moved itself.
    """
    return (wp.dot(outward, change) + excess) * outward


@wp.func
def fall(
    position: wp.vec3,
    velocity: wp.vec3,
    pushed: wp.vec3,
    radius: float,
    gravity: float,
    up: wp.vec3,
    ground_height: float,
    ground_restitution: float,
    step_seconds: float,
):
    """Return a sphere's position and velocity after a step of gravity beside the ground.

    Also the velocity change by the ground [m/s].

    It has not met particles yet, or has the acceleration by their forces, `pushed` [m/s^2].

    It turns beside the ground as `stop_of` has it.
    """
    gap = wp.dot(position, up) - radius - ground_height
    rise = wp.dot(velocity, up)
    velocity += step_seconds * (pushed - gravity * up)
    coming = -wp.dot(velocity, up)
    stopped = stop_of(coming, step_seconds * coming - gap, -rise, ground_restitution, step_seconds)
    velocity += stopped * up
    position += step_seconds * velocity + way_apart(gap, step_seconds) * up
    return position, velocity, stopped


@wp.func
def sinking_of_sphere(
    position: wp.vec3, velocity: wp.vec3, radius: float, up: wp.vec3, ground_height: float, step_seconds: float
):
    """Return the excess approach speed of a moved sphere toward the ground [m/s], at most 0."""
    start = position - step_seconds * velocity
    return excess_speed(wp.dot(start, up) - radius - ground_height, -wp.dot(velocity, up), step_seconds)

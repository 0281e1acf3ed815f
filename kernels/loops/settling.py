"""Impulses at all points at which free bodies touch, from sweep to sweep until they agree, see `laws.grip`.

They act on how bodies move in working memory: as fast as they are, or as far as they are to be moved out of overlaps in
a step of one second. A light body between heavy ones gets large impulses from both sides, of which little is left: so
they are in float64."""

import warp as wp

from balloon_warp.kernels.laws.grip import Grip, going_on, grip_impulse, has_agreed
from balloon_warp.kernels.working import Working


@wp.func
def ease_of(working: Working, world: wp.int32, body: wp.int32, arm: wp.vec3, direction: wp.vec3):
    """Return the inverse effective mass of a body's point along a unit vector [1/kg]."""
    torque = wp.vec3d(wp.cross(arm, direction))
    return 1.0 / working.body_masses[world, body] + float(wp.dot(torque, working.body_eases[world, body] * torque))


@wp.func
def ease_at(working: Working, world: wp.int32, grip: Grip, direction: wp.vec3):
    """Return the inverse effective mass of a contact along a unit vector [1/kg]."""
    ease = ease_of(working, world, grip.body, grip.arm, direction)
    if grip.other >= 0:
        ease += ease_of(working, world, grip.other, grip.other_arm, direction)
    return ease


@wp.func
def speed_at(working: Working, world: wp.int32, body: wp.int32, arm: wp.vec3):
    """Return the velocity of a body's point [m/s]."""
    spin = working.body_eases[world, body] * working.body_turning[world, body]
    return working.body_going[world, body] + wp.cross(spin, wp.vec3d(arm))


@wp.func
def beside_at(working: Working, world: wp.int32, grip: Grip):
    """Return the relative velocity at a contact [m/s]."""
    speed = speed_at(working, world, grip.body, grip.arm) - wp.vec3d(grip.moving)
    if grip.other >= 0:
        speed -= speed_at(working, world, grip.other, grip.other_arm)
    return speed


@wp.func
def tug_at(working: Working, world: wp.int32, grip: Grip):
    """Return the part of the relative velocity at a contact that strings add in this substep [m/s]."""
    tug = wp.vec3d()
    if working.body_tugs.shape[1] > 0:
        tug = tug_of(working, world, grip.body, grip.arm)
        if grip.other >= 0:
            tug -= tug_of(working, world, grip.other, grip.other_arm)
    return tug


@wp.func
def tug_of(working: Working, world: wp.int32, body: wp.int32, arm: wp.vec3):
    """Return the velocity of a body's point that strings add in this substep [m/s]."""
    spin = working.body_eases[world, body] * wp.vec3d(working.body_twists[world, body])
    return wp.vec3d(working.body_tugs[world, body]) + wp.cross(spin, wp.vec3d(arm))


@wp.func
def along_normal(grip: Grip, velocity: wp.vec3d):
    """Return the part of a velocity along a contact's normal [m/s]."""
    return wp.dot(wp.vec3d(grip.normal), velocity)


@wp.func
def push(working: Working, world: wp.int32, body: wp.int32, arm: wp.vec3, impulse: wp.vec3d):
    """Apply an impulse at a body's point [N s]."""
    mass = wp.float64(working.body_masses[world, body])
    working.body_going[world, body] = working.body_going[world, body] + impulse / mass
    working.body_turning[world, body] = working.body_turning[world, body] + wp.cross(wp.vec3d(arm), impulse)


@wp.func
def push_apart(working: Working, world: wp.int32, grip: Grip, impulse: wp.vec3d):
    """Apply an impulse at a contact, and the opposite one on the other thing [N s]."""
    push(working, world, grip.body, grip.arm, impulse)
    if grip.other >= 0:
        push(working, world, grip.other, grip.other_arm, -impulse)


@wp.func
def added_at(working: Working, world: wp.int32, grip: Grip, beside: wp.vec3d, rubs: bool):
    """Return the increment of a contact's impulse for the current velocities [N s]."""
    across = grip.ease
    friction = float(0.0)
    if rubs:
        friction = grip.friction
        sliding = wp.vec3(beside - along_normal(grip, beside) * wp.vec3d(grip.normal))
        if wp.length_sq(sliding) > 0.0:
            across = ease_at(working, world, grip, wp.normalize(sliding))
    return grip_impulse(grip, beside, across, friction)


@wp.func
def settle(working: Working, world: wp.int32, count: wp.int32, rubs: bool, allowed: float, most: wp.int32):
    """Iterate the contact impulses of a world's list to convergence, and return the number of sweeps.

    Args:
        count: Number of contacts.
        rubs: Whether there is friction.
        allowed: Largest change of a speed in a sweep at convergence [m/s].
        most: Largest number of sweeps.
    """
    for number in range(count):
        grip = working.grips[world, number]
        push_apart(working, world, grip, grip.impulse)
        grip.ahead = wp.vec3d()
        working.grips[world, number] = grip
    sweeps = wp.int32(0)
    age = float(0.0)
    before = float(wp.inf)
    agreed = bool(False)
    while not agreed and sweeps < most:
        agreed = bool(True)
        along = float(0.0)
        changed = float(0.0)
        for number in range(count):
            grip = working.grips[world, number]
            beside = beside_at(working, world, grip)
            grip.added = added_at(working, world, grip, beside, rubs)
            grip.impulse += grip.added
            push_apart(working, world, grip, grip.added)
            agreed = agreed and has_agreed(grip, allowed)
            along += grip.ease * float(wp.dot(grip.added, grip.ahead + grip.added))
            changed += grip.ease * float(wp.length_sq(grip.added))
            working.grips[world, number] = grip
        sweeps += 1
        age = wp.where(along < 0.0 or changed > 2.0 * before, 0.0, age + 1.0)
        before = changed
        if not agreed and sweeps < most:
            for number in range(count):
                grip = working.grips[world, number]
                grip.ahead = wp.float64(going_on(age)) * (grip.ahead + grip.added)
                grip.impulse += grip.ahead
                push_apart(working, world, grip, grip.ahead)
                working.grips[world, number] = grip
    return sweeps

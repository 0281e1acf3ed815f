"""Impulses at all points at which free bodies touch, from sweep to sweep until they agree, see `laws.grip`.

They act on how bodies move in working memory: as fast as they are, or as far as they are to be moved out of overlaps in
a step of one second. A light body between heavy ones gets large impulses from both sides, of which little is left: so
that is kept in float64."""

import warp as wp

from balloon_warp.kernels.laws.grip import Grip, going_on, grip_impulse, has_agreed


@wp.func
def ease_of(masses: wp.array[float], eases: wp.array[wp.mat33d], body: wp.int32, arm: wp.vec3, direction: wp.vec3):
    """Return the inverse effective mass of a body's point along a unit vector [1/kg]."""
    torque = wp.vec3d(wp.cross(arm, direction))
    return 1.0 / masses[body] + float(wp.dot(torque, eases[body] * torque))


@wp.func
def ease_at(masses: wp.array[float], eases: wp.array[wp.mat33d], grip: Grip, direction: wp.vec3):
    """Return the inverse effective mass of a contact along a unit vector [1/kg]."""
    ease = ease_of(masses, eases, grip.body, grip.arm, direction)
    if grip.other >= 0:
        ease += ease_of(masses, eases, grip.other, grip.other_arm, direction)
    return ease


@wp.func
def beside_at(eases: wp.array[wp.mat33d], going: wp.array[wp.vec3d], turning: wp.array[wp.vec3d], grip: Grip):
    """Return the relative velocity at a contact [m/s]."""
    speed = going[grip.body] + wp.cross(eases[grip.body] * turning[grip.body], wp.vec3d(grip.arm))
    speed -= wp.vec3d(grip.moving)
    if grip.other >= 0:
        speed -= going[grip.other] + wp.cross(eases[grip.other] * turning[grip.other], wp.vec3d(grip.other_arm))
    return wp.vec3(speed)


@wp.func
def push(
    masses: wp.array[float],
    going: wp.array[wp.vec3d],
    turning: wp.array[wp.vec3d],
    body: wp.int32,
    arm: wp.vec3,
    impulse: wp.vec3,
):
    """Apply an impulse at a body's point [N s]."""
    whole = wp.vec3d(impulse)
    going[body] = going[body] + whole / wp.float64(masses[body])
    turning[body] = turning[body] + wp.cross(wp.vec3d(arm), whole)


@wp.func
def push_apart(
    masses: wp.array[float], going: wp.array[wp.vec3d], turning: wp.array[wp.vec3d], grip: Grip, impulse: wp.vec3
):
    """Apply an impulse at a contact, and the opposite one on the other thing [N s]."""
    push(masses, going, turning, grip.body, grip.arm, impulse)
    if grip.other >= 0:
        push(masses, going, turning, grip.other, grip.other_arm, -impulse)


@wp.func
def added_at(masses: wp.array[float], eases: wp.array[wp.mat33d], grip: Grip, beside: wp.vec3, rubs: bool):
    """Return the increment of a contact's impulse for the current velocities [N s]."""
    across = grip.ease
    friction = float(0.0)
    if rubs:
        friction = grip.friction
        sliding = beside - wp.dot(beside, grip.normal) * grip.normal
        if wp.length_sq(sliding) > 0.0:
            across = ease_at(masses, eases, grip, wp.normalize(sliding))
    return grip_impulse(grip, beside, across, friction)


@wp.func
def settle(
    masses: wp.array[float],
    eases: wp.array[wp.mat33d],
    going: wp.array[wp.vec3d],
    turning: wp.array[wp.vec3d],
    grips: wp.array[Grip],
    count: wp.int32,
    rubs: bool,
    allowed: float,
    most: wp.int32,
):
    """Iterate the contact impulses of a list to convergence, and return the number of sweeps.

    Args:
        masses: Masses of the bodies of a world [kg].
        eases: Inverses of their inertia tensors [1/(kg m^2)].
        going: Their velocities [m/s].
        turning: Their angular momenta [kg m^2/s].
        grips: List of contacts.
        rubs: Whether there is friction.
        allowed: Largest change of a speed in a sweep at convergence [m/s].
        most: Largest number of sweeps.
    """
    for number in range(count):
        grip = grips[number]
        push_apart(masses, going, turning, grip, grip.impulse)
        grip.ahead = wp.vec3()
        grips[number] = grip
    sweeps = wp.int32(0)
    age = float(0.0)
    before = float(wp.inf)
    agreed = bool(False)
    while not agreed and sweeps < most:
        agreed = bool(True)
        along = float(0.0)
        changed = float(0.0)
        for number in range(count):
            grip = grips[number]
            beside = beside_at(eases, going, turning, grip)
            grip.added = added_at(masses, eases, grip, beside, rubs)
            grip.impulse += grip.added
            push_apart(masses, going, turning, grip, grip.added)
            agreed = agreed and has_agreed(grip, allowed)
            along += grip.ease * wp.dot(grip.added, grip.ahead + grip.added)
            changed += grip.ease * wp.length_sq(grip.added)
            grips[number] = grip
        sweeps += 1
        age = wp.where(along < 0.0 or changed > 2.0 * before, 0.0, age + 1.0)
        before = changed
        if not agreed and sweeps < most:
            for number in range(count):
                grip = grips[number]
                grip.ahead = going_on(age) * (grip.ahead + grip.added)
                grip.impulse += grip.ahead
                push_apart(masses, going, turning, grip, grip.ahead)
                grips[number] = grip
    return sweeps

"""Bodies that push each other in a step and rebound, as far as energy allows, see `laws.grip`."""

import warp as wp

from balloon_warp.kernels.laws.grip import most_sweeps, push_share, rebound_share
from balloon_warp.kernels.loops.settling import beside_at, push_apart, settle, tug_at
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working

NO_GAIN = wp.constant(wp.float64(1.0e-5))
"""Gain of energy that counts as none, over the work that contacts exchange"""
JAMMED = wp.constant(wp.float64(1.0e-2))
"""Gain of energy, over the work that contacts exchange, below which impulses that do not agree are so large that bodies
have jammed: they do without friction then, since that agrees, and without rebound"""
NOT, DOES, JAMS = (wp.constant(number) for number in range(3))
"""Whether contacts give energy, and whether bodies have jammed"""


@wp.func
def let_fall(t: Tables, state: WorldState, working: Working, world: wp.int32, pull: float):
    """Give all bodies the velocities that they have without contact, by a step of gravity [m/s^2]."""
    fallen = wp.vec3d((t.step_seconds * pull) * t.up)
    for body in range(state.body_positions.shape[1]):
        working.body_going[world, body] = wp.vec3d(state.body_velocities[world, body]) - fallen
        working.body_turning[world, body] = wp.vec3d(state.body_momenta[world, body])


@wp.func
def group_of(working: Working, world: wp.int32, body: wp.int32):
    """Return the least number of the bodies that touch a body, or that touch these."""
    while working.body_groups[world, body] != body:
        body = working.body_groups[world, body]
    return body


@wp.func
def find_groups(working: Working, world: wp.int32, count: wp.int32):
    """Group bodies that touch each other."""
    for body in range(working.body_groups.shape[1]):
        working.body_groups[world, body] = body
    for number in range(count):
        grip = working.grips[world, number]
        if grip.other >= 0:
            one = group_of(working, world, grip.body)
            other = group_of(working, world, grip.other)
            working.body_groups[world, wp.max(one, other)] = wp.min(one, other)


@wp.func
def work_of(impulse: wp.vec3d, before: wp.vec3d, after: wp.vec3d):
    """Return the work of an impulse at a contact, beside the surface that is met [J]."""
    return wp.float64(0.5) * wp.dot(impulse, before + after)


@wp.func
def gains_energy(working: Working, world: wp.int32, count: wp.int32, agrees: bool):
    """Return how contacts have given groups of bodies energy, which is noted: `NOT`, `DOES` or `JAMS`.

    Args:
        agrees: Whether impulses have converged.
    """
    least = wp.where(agrees, NO_GAIN, wp.float64(0.0))
    gains = wp.int32(NOT)
    find_groups(working, world, count)
    for body in range(working.body_groups.shape[1]):
        working.body_gains[world, body] = wp.vec4d()
    for number in range(count):
        grip = working.grips[world, number]
        group = group_of(working, world, grip.body)
        grip.rebound = grip.impulse
        grip.leaving = beside_at(working, world, grip)
        working.grips[world, number] = grip
        whole = work_of(grip.impulse, grip.before, grip.leaving)
        exchanged = wp.abs(work_of(grip.impulse, grip.before, wp.vec3d()))
        more = wp.vec4d(whole, exchanged, wp.float64(0.0), wp.float64(0.0))
        working.body_gains[world, group] = working.body_gains[world, group] + more
    for body in range(working.body_groups.shape[1]):
        found = working.body_gains[world, body]
        if found[0] > least * found[1]:
            gains = wp.max(gains, wp.where(agrees or found[0] > JAMMED * found[1], DOES, JAMS))
    return gains


@wp.func
def swap_least(working: Working, world: wp.int32, number: wp.int32):
    """Ask a contact for no rebound, or for the one that it was asked for before."""
    grip = working.grips[world, number]
    least = grip.least
    grip.least = grip.closing
    grip.closing = least
    working.grips[world, number] = grip


@wp.func
def push_less(working: Working, world: wp.int32, count: wp.int32, jams: bool, fallen: wp.vec3):
    """Set impulses between those without rebound, which act, and those with, so that no group gains energy.

    Args:
        jams: Whether a group takes all of those with rebounds, or none.
        fallen: Change of velocity by a step of gravity, downward positive [m/s].
    """
    for body in range(working.body_groups.shape[1]):
        whole = working.body_gains[world, body][0]
        working.body_gains[world, body] = wp.vec4d(whole, wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    for number in range(count):
        grip = working.grips[world, number]
        group = group_of(working, world, grip.body)
        now = beside_at(working, world, grip)
        free = grip.before + tug_at(working, world, grip)
        if grip.other < 0:
            free -= wp.vec3d(fallen)
        without = work_of(grip.impulse, grip.before, now)
        curve = work_of(grip.rebound - grip.impulse, grip.leaving, -now)
        more = wp.vec4d(wp.float64(0.0), without, curve, work_of(grip.impulse, grip.before, free))
        working.body_gains[world, group] = working.body_gains[world, group] + more
    for number in range(count):
        grip = working.grips[world, number]
        gains = working.body_gains[world, group_of(working, world, grip.body)]
        share = rebound_share(gains[1], gains[0], gains[2])
        if jams and gains[0] > wp.float64(0.0):
            share = wp.float64(0.0)
        grip.impulse += share * (grip.rebound - grip.impulse)
        grip.impulse *= push_share(gains[1], gains[3])
        working.grips[world, number] = grip


@wp.func
def push_each_other(
    t: Tables, state: WorldState, working: Working, world: wp.int32, count: wp.int32, pull: float, allowed: float
):
    """Set velocities of bodies after gravity [m/s^2] and all contacts of the list.

    Args:
        allowed: Largest change of a speed in a sweep at convergence [m/s].
    """
    let_fall(t, state, working, world, pull)
    agrees = settle(working, world, count, True, allowed, most_sweeps(count)) < most_sweeps(count)
    rebounds = bool(False)
    for number in range(count):
        rebounds = rebounds or working.grips[world, number].least > 0.0
    if rebounds or not agrees:
        gains = gains_energy(working, world, count, agrees)
        if gains != NOT:
            if rebounds:
                for number in range(count):
                    swap_least(working, world, number)
                    grip = working.grips[world, number]
                    grip.impulse = state.body_impulses[world, number]
                    working.grips[world, number] = grip
                let_fall(t, state, working, world, pull)
                settle(working, world, count, gains != JAMS, allowed, most_sweeps(count))
                for number in range(count):
                    swap_least(working, world, number)
            push_less(working, world, count, gains == JAMS, (t.step_seconds * pull) * t.up)
            let_fall(t, state, working, world, pull)
            for number in range(count):
                push_apart(working, world, working.grips[world, number], working.grips[world, number].impulse)

"""Kernels of environments: the work before a step and after it, beside the task."""

import warp as wp

from balloon_warp.kernels.measure.health import HEALTHY
from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)

WELL = wp.constant(0)
BAD_ACTION = wp.constant(1)
BAD_CONTROL = wp.constant(2)
BLEW_UP = wp.constant(3)


@wp.kernel
def take_actions(
    given: wp.array2d[float],
    # out
    actions: wp.array2d[float],
    causes: wp.array[wp.int32],
):
    """Take actions, each within -1 and 1; one that is not finite does nothing, and ends its world. A thread a world."""
    world = wp.tid()
    cause = WELL
    for number in range(given.shape[1]):
        action = given[world, number]
        if not wp.isfinite(action):
            cause = BAD_ACTION
            action = 0.0
        actions[world, number] = wp.clamp(action, -1.0, 1.0)
    causes[world] = cause


@wp.func
def bounded(value: float, limit: float):
    """Return an observation within its limits; 0 if it is not finite."""
    if not wp.isfinite(value):
        return 0.0
    return wp.clamp(value, -limit, limit)


@wp.kernel
def finish_step(
    faults: wp.array[wp.int32],
    first_bad: wp.array[wp.int32],
    most_steps: wp.int32,
    limits: wp.array[float],
    begun: wp.array[wp.int32],
    # in and out
    steps: wp.array[wp.int32],
    causes: wp.array[wp.int32],
    observations: wp.array2d[float],
    rewards: wp.array[float],
    terminated: wp.array[wp.int32],
    # out
    truncated: wp.array[wp.int32],
    over: wp.array[wp.int32],
):
    """Count a step, and find which worlds are over; a thread a world.

    Worlds that have just restarted have neither reward nor end. A world that ended by a bad action, a bad control or a
    blow-up has no reward. Observations are within their limits.
    """
    world = wp.tid()
    truncated[world] = 0
    if begun[world] != 0:
        steps[world] = 0
        causes[world] = WELL
        rewards[world] = 0.0
        terminated[world] = 0
    else:
        steps[world] = steps[world] + 1
        if faults[world] > 0:
            causes[world] = BAD_CONTROL
        if first_bad[world] != HEALTHY:
            causes[world] = BLEW_UP
        if causes[world] != WELL:
            rewards[world] = 0.0
            terminated[world] = 1
        elif steps[world] >= most_steps:
            truncated[world] = 1
    for number in range(observations.shape[1]):
        observations[world, number] = bounded(observations[world, number], limits[number])
    over[world] = wp.max(terminated[world], truncated[world])


@wp.kernel
def bound_observations(
    limits: wp.array[float],
    # in and out
    observations: wp.array2d[float],
):
    """Keep observations within their limits; a thread a world."""
    world = wp.tid()
    for number in range(observations.shape[1]):
        observations[world, number] = bounded(observations[world, number], limits[number])


@wp.kernel
def restart_steps(
    begun: wp.array[wp.int32],
    # out
    steps: wp.array[wp.int32],
    over: wp.array[wp.int32],
):
    """Count the steps of worlds that have begun anew from 0: they are not over; a thread a world."""
    world = wp.tid()
    if begun[world] != 0:
        steps[world] = 0
        over[world] = 0

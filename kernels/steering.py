"""Kernels of environments: worlds that begin anew, controls from the device, and the work around a step."""

from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.tables import HEALTHY, row_of_world

wp.set_module_options(OPTIONS)
LOG_UNIFORM = wp.constant(1)
NORMAL = wp.constant(2)


@wp.func
def random_of(seed: wp.int32, world: wp.int32, episode: wp.int32, number: wp.int32):
    """Return the generator of one value of one episode of one world, whatever the number of worlds."""
    of_world = wp.rand_init(seed, world)
    of_episode = wp.rand_init(wp.int32(of_world), episode)
    return wp.rand_init(wp.int32(of_episode), number)


@wp.func
def drawn(state: wp.uint32, kind: wp.int32, first: float, second: float):
    """Draw a value: uniform, or its logarithm uniform, between both; or normal of that mean and deviation."""
    value = first
    if kind == NORMAL:
        value = first + second * wp.randn(state)
    elif kind == LOG_UNIFORM:
        value = first * wp.exp(wp.randf(state) * wp.log(second / first))
    else:
        value = wp.lerp(first, second, wp.randf(state))
    return value


@wp.kernel
def begin_episodes(mask: wp.array[wp.int32], faults: wp.array[wp.int32], episodes: wp.array[wp.int32]):
    """Count the episodes of worlds that begin anew; a thread a world."""
    world = wp.tid()
    if mask[world] != 0:
        episodes[world] = episodes[world] + 1
        faults[world] = 0


@wp.kernel
def draw_values(
    mask: wp.array[wp.int32],
    seed: wp.array[wp.int32],
    episodes: wp.array[wp.int32],
    first_world: wp.int32,
    number: wp.int32,
    kind: wp.int32,
    first: float,
    second: float,
    # out
    values: wp.array[float],
):
    """Draw a value for worlds that begin anew; a thread a world. Their numbers begin with `first_world`."""
    world = wp.tid()
    if mask[world] != 0:
        values[world] = drawn(random_of(seed[0], first_world + world, episodes[world], number), kind, first, second)


@wp.kernel
def shift_balloon(
    mask: wp.array[wp.int32],
    positions: wp.array[float],
    placed: wp.float64,
    first_center: wp.array[wp.float64],
    # out
    shifts: wp.array[wp.float64],
    centers: wp.array[wp.float64],
):
    """Shift where a balloon starts, and its center, along an axis; a thread a world."""
    world = wp.tid()
    if mask[world] != 0:
        shift = wp.float64(positions[world]) - placed
        shifts[world] = shift
        centers[world] = first_center[world] + shift


@wp.struct
class WordRows:
    """Rows of 32-bit words to copy: one a world, or a source of one row for all."""

    source: wp.array2d[wp.uint32]
    target: wp.array2d[wp.uint32]


@wp.struct
class ByteRows:
    """Rows of bytes to copy: one a world, or a source of one row for all."""

    source: wp.array2d[wp.uint8]
    target: wp.array2d[wp.uint8]


@wp.func
def copy_rows(mask: wp.array[wp.int32], copies: Any, threads: wp.int32, world: wp.int32, thread: wp.int32):
    """Copy the rows of a world, if a mask chooses it, of any number of arrays: every n-th place of each."""
    if mask[world] != 0:
        for number in range(copies.shape[0]):
            rows = copies[number]
            row = row_of_world(world, rows.source.shape[0])
            for place in range(thread, rows.target.shape[1], threads):
                rows.target[world, place] = rows.source[row, place]


# Two kernels and no generic one: Warp replays all forms of a kernel in a graph of a CPU as the last that it recorded.
@wp.kernel
def copy_words(mask: wp.array[wp.int32], copies: wp.array[WordRows], threads: wp.int32):
    """Copy rows of words, see `copy_rows`; a thread a (world, thread)."""
    world, thread = wp.tid()
    copy_rows(mask, copies, threads, world, thread)


@wp.kernel
def copy_bytes(mask: wp.array[wp.int32], copies: wp.array[ByteRows], threads: wp.int32):
    """Copy rows of bytes, see `copy_rows`; a thread a (world, thread)."""
    world, thread = wp.tid()
    copy_rows(mask, copies, threads, world, thread)


@wp.kernel
def begin_ages(mask: wp.array[wp.int32], ages: wp.array[wp.int32]):
    """Let the time of worlds begin anew; a thread a world."""
    world = wp.tid()
    if mask[world] != 0:
        ages[world] = 0


@wp.kernel
def count_ages(ages: wp.array[wp.int32]):
    """Count a frame of each world; a thread a world."""
    world = wp.tid()
    ages[world] = ages[world] + 1


@wp.kernel
def let_appear(
    mask: wp.array[wp.int32],
    ages: wp.array[wp.int32],
    frames: wp.array[wp.int32],
    sizes: wp.array[float],
    first: float,
    # parameter out
    target: wp.array[float],
):
    """Let a thing appear or end in the frame that a world begins; a thread a world.

    Where a mask is not 0, it gets its values until then, too.
    """
    world = wp.tid()
    if mask[world] != 0:
        target[world] = first
    for turn in range(frames.shape[0]):
        if frames[turn] == ages[world] or (mask[world] != 0 and frames[turn] < ages[world]):
            target[world] = sizes[turn]


@wp.kernel
def follow_plan(
    ages: wp.array[wp.int32],
    frames: wp.array[wp.int32],
    planned: wp.array[float],
    # out
    values: wp.array[float],
):
    """Write the value that is planned for the frame which a world begins, if one is; a thread a world."""
    world = wp.tid()
    for turn in range(frames.shape[0]):
        if frames[turn] == ages[world]:
            values[world] = planned[turn]


@wp.kernel
def write_control(
    # asked
    values: wp.array[float],
    number: wp.int32,
    low: float,
    high: float,
    ends: wp.int32,
    # parameter out
    target: wp.array[float],
    faults: wp.array[wp.int32],
):
    """Write a control where the kernels read it; a thread a world.

    A value beyond the bounds is clipped, or ends the world where that is asked; one that is not finite always ends it,
    and the parameter stays as it was. `faults` names the first control at fault, from 1; 0 where all is well.
    """
    world = wp.tid()
    value = values[world]
    bad = not wp.isfinite(value)
    if ends == 1 and (value < low or value > high):
        bad = True
    if bad:
        if faults[world] == 0:
            faults[world] = number
    else:
        target[world] = wp.clamp(value, low, high)


@wp.kernel
def read_control(
    # parameter in
    source: wp.array[float],
    # out
    values: wp.array[float],
):
    """Read the present value of a parameter; a thread a world."""
    world = wp.tid()
    values[world] = source[world]


@wp.kernel
def move_obstacles(velocities: wp.array2d[wp.vec3], seconds: float, positions: wp.array2d[wp.vec3]):
    """Move obstacles on by a frame; a thread a (world, obstacle)."""
    world, obstacle = wp.tid()
    positions[world, obstacle] = positions[world, obstacle] + seconds * velocities[world, obstacle]


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

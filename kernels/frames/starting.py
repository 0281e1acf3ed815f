"""Kernels that begin some worlds anew, by a mask, with values drawn for each."""

from typing import Any

import warp as wp

from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import row_of_world

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

"""Sums over all patches of a balloon: each block adds up its part, publishes it, and adds up all parts."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.schedules.block.sums import WORDS
from balloon_warp.kernels.schedules.patches.halo import publish_sums, wait_for_sums
from balloon_warp.kernels.schedules.patches.memory import PatchMemory, PatchSeat
from balloon_warp.kernels.warp_sums import Five, put_warp_sums, sum_of_warp_sums
from balloon_warp.kernels.warps import WARP_THREADS, block_barrier, shared_words


@cache
def sums_of(name: str, dtype: Any, warps: int) -> Any:
    """Return the function that adds up a number, or five, over a balloon, once a substep."""
    params, others = (shared_words(f"{name} of {each}", WORDS * warps) for each in ("a patch", "patches"))

    @wp.func
    def sum_in_balloon(memory: PatchMemory, seat: PatchSeat, substep: wp.int32, part: Five):
        """Return the sum over a balloon, which is bitwise reproducible; called by all threads of all its blocks."""
        warp = WORDS * (seat.thread // WARP_THREADS)
        row = ((substep & 1) * seat.slots + seat.slot) * seat.patches
        put_warp_sums(params(), warp, part, False)
        block_barrier()
        if seat.thread < WARP_THREADS:
            of_patch = sum_of_warp_sums(params(), 0, warps)
            if seat.thread == 0:
                publish_sums(memory.sums, row + seat.patch, substep + 1, of_patch)
        other = wait_for_sums(memory.sums, row + seat.begin + seat.thread, substep + 1, seat.thread < seat.count)
        put_warp_sums(others(), warp, other, False)
        block_barrier()
        return sum_of_warp_sums(others(), 0, warps)

    @wp.func
    def sum_of_number(memory: PatchMemory, seat: PatchSeat, substep: wp.int32, part: float):
        """Return the sum of a number over a balloon; called by all threads of all its blocks."""
        return sum_in_balloon(memory, seat, substep, Five(part, 0.0, 0.0, 0.0, 0.0))[0]

    return sum_of_number if dtype is float else sum_in_balloon

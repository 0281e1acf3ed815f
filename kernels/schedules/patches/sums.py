"""Sums over all patches of a balloon: each block adds up its own part, tells the others, and adds up what all tell."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.schedules.block.gas import NUMBERS_OF_WARP
from balloon_warp.kernels.schedules.patches.halo import hear_sums, tell_sums
from balloon_warp.kernels.schedules.patches.memory import PatchMemory, PatchSeat
from balloon_warp.kernels.warp_sums import Five, put_warp_sums, sum_of_warp_sums
from balloon_warp.kernels.warps import WARP_THREADS, block_barrier, shared_words


@cache
def sums_of(warps: int) -> Any:
    """The function that adds up five numbers over a balloon, once a substep."""
    own, others = (shared_words(f"sums of {each}", NUMBERS_OF_WARP * warps) for each in ("a patch", "patches"))

    @wp.func
    def sum_in_balloon(memory: PatchMemory, seat: PatchSeat, substep: wp.int32, part: Five):
        """By all threads of all its blocks, which get the same to the last bit every time."""
        warp = NUMBERS_OF_WARP * (seat.thread // WARP_THREADS)
        row = ((substep & 1) * seat.slots + seat.slot) * seat.patches
        put_warp_sums(own(), warp, part, False)
        block_barrier()
        if seat.thread < WARP_THREADS:
            of_patch = sum_of_warp_sums(own(), 0, warps)
            if seat.thread == 0:
                tell_sums(memory.sums, row + seat.patch, substep + 1, of_patch)
        other = hear_sums(memory.sums, row + seat.begin + seat.thread, substep + 1, seat.thread < seat.count)
        put_warp_sums(others(), warp, other, False)
        block_barrier()
        return sum_of_warp_sums(others(), 0, warps)

    return sum_in_balloon

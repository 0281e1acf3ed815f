"""The areas of balloons that many blocks have a part of, for the aims of normal forces in every substep."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.areas import area_vector_between
from balloon_warp.kernels.memory import four_ints_at
from balloon_warp.kernels.schedules.block.refresh import Refresh
from balloon_warp.kernels.schedules.patches.memory import PatchMemory, PatchSeat, PatchTable
from balloon_warp.kernels.schedules.patches.sums import sums_of
from balloon_warp.kernels.warp_sums import Five
from balloon_warp.kernels.warps import put_word, shared_words, word_at


@cache
def patch_aims(warps: int) -> Refresh:
    """As for a block, for quads: `measure` takes (patches, memory, seat, substep, points)."""
    known, sum_in_balloon = shared_words("area of a balloon", 1), sums_of(warps)

    @wp.func
    def measure(patches: PatchTable, memory: PatchMemory, seat: PatchSeat, substep: wp.int32, points: Any):
        """Faces, each by the patch of its first corner; every thread knows the area of the balloon then."""
        part = float(0.0)
        begin = patches.face_offsets[seat.patch]
        for face in range(begin + seat.thread, patches.face_offsets[seat.patch + 1], wp.block_dim()):
            part += wp.length(area_vector_between(points, four_ints_at(patches.faces, face)))
        total = sum_in_balloon(memory, seat, substep, Five(part, 0.0, 0.0, 0.0, 0.0))
        put_word(known(), 0, total[0])  # the same by all
        return total[0]

    @wp.func
    def area(balloon: wp.int32):
        return word_at(known(), 0)

    return Refresh(measure, area, None)

"""A list of phases as one kernel of patches: parts of a world that blocks of a GPU move at once, for all of a frame.

For few large worlds. Each particle stays in the registers of a thread, and the points of its patch in the block's
shared memory, with a rim of those outside that its springs and faces lead to. After each substep a block tells others
where those of its particles are that they need, and hears where its rim is. So a substep takes no launch. All blocks
must run at once: no more are launched than the multiprocessors have registers for.
"""

from functools import cache
from typing import Any

from balloon_warp.kernels.codegen import kernel_from
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.source import BlockWriter
from balloon_warp.kernels.schedules.patches.halo import exchange
from balloon_warp.kernels.schedules.patches.memory import PatchMemory, PatchTable, take_patch
from balloon_warp.kernels.schedules.patches.sums import sums_of
from balloon_warp.kernels.schedules.pieces import Piece, Step


class PatchWriter(BlockWriter):
    """Write the source of the kernel: that of a block, which hears from others where its rim is."""

    def __init__(self, step: Step, layout: Layout):
        super().__init__(step, layout, alone=True)  # a patch has particles of one balloon

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "advance_patches"

    @property
    def remark(self) -> str:
        """Return a sentence on the kernel."""
        threads = self.layout.threads
        return f"A block for each patch of each world, for a frame; each of {threads} threads keeps a particle."

    def _arguments(self) -> dict[str, str]:
        of_patches = {
            "patches": "PatchTable", "memory": "PatchMemory", "first_world": "wp.int32", "worlds_at_work": "wp.int32",
            "inflation_directions": "wp.array2d[wp.vec3]",
        }  # fmt: skip
        return super()._arguments() | of_patches

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        of_patches = {
            "PatchTable": PatchTable, "PatchMemory": PatchMemory, "take_patch": take_patch, "exchange": exchange,
        }  # fmt: skip
        for phase in self.phases:
            if phase.sums:
                (value,) = phase.writes
                of_patches[f"sum_of_{value}"] = sums_of(value, phase.writes[value], self.layout.warps)
        return super().names() | of_patches

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        if name == "origin_place":
            return "", "patches.origins[patch]"
        if name == "balloon":
            return "", "patches.balloons[patch]"
        if name == "ramp":
            return "balloon", "state.inflation_ramp[world, balloon]"
        return super().found(name)

    def _find_world(self) -> None:
        self.line("slot, patch, thread = wp.tid()")
        self.line("world = first_world + slot")
        self.line("seat = take_patch(patches, worlds_at_work, slot, patch, thread)")

    def _find_particle(self, number: int) -> None:
        self.line("place = thread")
        self.line("is_there = patches.numbers[patch, thread] < count")
        self.line("particle = wp.min(patches.numbers[patch, thread], count - 1)")
        if "inflation_direction" not in {value for phase in self.phases for value in phase.writes}:
            self.line("inflation_direction = vector_in(inflation_directions, world, particle)")
            self.known.add("inflation_direction")
        self.line("if seat.halo >= 0:")
        self.line(f"    put_in_tile(points, {self.layout.threads} + thread, state.points[world, seat.halo])")

    def _exchange(self, piece: Piece) -> None:
        if "point" in piece.moves:
            self.line("if substep + 1 < t.substeps:")
            self.line(f"    exchange(memory, seat, substep, count, particle, point, points, {self.layout.threads})")

    def _end_sum(self, summed: Phase | None) -> None:
        """Write a barrier, and the sum over all patches of the balloon."""
        if summed is None:
            super()._end_sum(summed)
            return
        (value,) = summed.writes
        self.line(f"{value} = sum_of_{value}(memory, seat, substep, part_of_{value})")
        self.known.add(value)

    def _items_of(self, item: str) -> tuple[str, str]:
        if item == "face":
            return "patches.face_offsets[patch]", "patches.face_offsets[patch + 1]"
        return super()._items_of(item)

    def _is_noting(self) -> str:
        return "thread == 0 and patch == seat.begin"


@cache
def kernel_of_patches(step: Step, layout: Layout) -> Any:
    """Make the kernel of a list."""
    writer = PatchWriter(step, layout)
    options = {**OPTIONS, "fast_math": True, "max_unroll": 128}
    return kernel_from(
        writer.name, writer.source(), writer.names(), cuda_max_registers=layout.registers, module_options=options
    )


@cache
def arguments_of_patches(step: Step, layout: Layout) -> tuple[str, ...]:
    """Return the names of the arguments of a list's kernel."""
    return PatchWriter(step, layout).arguments()

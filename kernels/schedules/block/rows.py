"""Code of a block that has a row for each substep of a frame: to note a substep's results, or to read them again."""

from collections.abc import Iterable

from balloon_warp.kernels.phase import Item
from balloon_warp.kernels.schedules.block.source import BlockWriter


class RowsWriter(BlockWriter):
    """Write the common parts of kernels with rows."""

    def _arguments(self) -> dict[str, str]:
        return super()._arguments() | {
            "slot_pairs": "wp.array2d[wp.vec2]", "notes": "wp.array2d[float]", "all_velocities": "wp.array2d[wp.vec3]",
        }  # fmt: skip

    def _kept_of(self, item: Item) -> list[str]:
        """Return the values of particles, or of the balloon, that each substep notes."""
        return [value for value in self.step.kept if self.step.owner(value) == item]

    def _places_of_rows(self, tiles: Iterable[str]) -> None:
        """Write where all of a world's values are.

        Args:
            tiles: vectors of particles in shared memory.
        """
        for tile in tiles:
            self.line(f'{tile} = wp.tile_empty(shape={self.layout.capacity}, dtype=wp.vec3, storage="shared")')
        self._places_of_membrane_faces()
        self.line("count = state.points.shape[1]")
        self.line("first_row = world * (t.substeps + 1)")
        self.line("frame_begin = time_of(t, state.frame, 0.0)")
        self.line("time_in_frame = float(0.0)")
        self.known.add("time_in_frame")

    def _begin_frame(self) -> None:
        """Write the lines before all substeps."""
        self.line("# Particles come from the state.")
        self._take_particles()
        self.line("block_barrier()")
        self._write_pieces(piece for piece in self.step.pieces if piece.once)
        self._keep_once()
        self._forget_times()

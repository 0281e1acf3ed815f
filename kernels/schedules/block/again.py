"""A frame again as one kernel: from its beginning, to note results of its substeps for those that run backwards.

The beginning of each substep is noted, and the values that its particles see of each other.
"""

from collections.abc import Collection
from typing import Any

from balloon_warp.kernels.memory import put_vector_in
from balloon_warp.kernels.phase import STATE
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.notes import Notes
from balloon_warp.kernels.schedules.block.rows import RowsWriter
from balloon_warp.kernels.schedules.pieces import Piece, Step


class AgainWriter(RowsWriter):
    """Write the kernel of a frame again, for threads that loop: values wait where they are noted.

    Args:
        noted: places of the particles' notes.
    """

    velocity_row = "row"
    """Row of the velocities that are read"""

    def __init__(self, step: Step, layout: Layout, noted: Notes):
        super().__init__(step, layout)
        self.noted = noted
        self.velocities = ("velocities", "velocities")

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "advance_worlds_again"

    @property
    def remark(self) -> str:
        """Return a sentence on the kernel."""
        return super().remark.replace("for a frame;", "for a frame again, with notes of its substeps;")

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        return {**super().names(), **self.noted.names(), "put_vector_in": put_vector_in}

    def _body(self) -> None:
        self._find_world()
        self._places_of_rows(self.points[: 2 if "point" in self.step.doubled else 1])
        self._begin_frame()
        self._note_beginning()
        self._clear_lists()
        self._substeps()

    def _note_beginning(self) -> None:
        with self._over("particle"):
            self.line(self.noted.write("point", "first_row", "in_tile(points, particle)"))
            self.line(self.noted.write("velocity", "first_row", "state.velocities[world, particle]"))

    def _clear_lists(self) -> None:
        for name in self._compacted:
            self.line("if thread == 0:")
            self.line(f"    clear_{name}(0)")
            self.line(f"    clear_{name}(1)")
        self.line("block_barrier()")

    def _substeps(self) -> None:
        self.line("for substep in range(t.substeps):")
        with self.indented():
            self.turn, self.next_turn = "substep % 2", "1 - substep % 2"
            self.line("row = first_row + substep")
            self.line("time_in_frame = float(substep) * t.step_seconds")
            if self.shows_velocities:
                self.line("velocities = all_velocities[row]")
                self.line("next_velocities = all_velocities[row + 1]")
            self.velocity_row = "row"
            self._begin_substep()
            self._write_pieces(piece for piece in self.step.pieces if not piece.once and not piece.last)
            self._end_substep()

    def _begin_substep(self) -> None:
        """Write nothing: where a substep begins, the one before has noted."""

    def _end_substep(self) -> None:
        """Write the notes of the balloon, and bring points back to the tile that the next substep begins with."""
        if of_balloon := self._kept_of("balloon"):
            self.line("if thread == 0:")
            for value in of_balloon:
                self.line(f"    all_{value}[row, 0] = {value}")
        if self.points[0] != "points":
            with self._over("particle"):
                self.line(f"put_in_tile(points, particle, in_tile({self.points[0]}, particle))")
            self.line("block_barrier()")
        self.points, self.velocities = ("points", "new_points"), ("velocities", "velocities")

    def _switch(self, piece: Piece) -> None:
        super()._switch(piece._replace(doubles=tuple(name for name in piece.doubles if name == "point")))
        if "velocity" in piece.moves:
            self.velocities = ("next_velocities", "next_velocities")
            self.velocity_row = "row + 1"

    def read(self, name: str) -> str:
        """Return how a value of a particle is read from where it was noted."""
        return self.noted.read(name, self.velocity_row if name == "velocity" else "row")

    def write(self, name: str, target: str) -> str:
        """Return the statement that notes a value of a particle."""
        return self.noted.write(name, "row + 1" if name == "velocity" else "row", name)

    def _put_particle(self, piece: Piece) -> None:
        super()._put_particle(piece)
        if "point" in piece.moves:
            self.line(self.noted.write("point", "row + 1", "point"))


class HeldAgainWriter(AgainWriter):
    """Write the kernel of a frame again, for threads that keep particles.

    Args:
        names: of the values noted of particles, besides their state.
    """

    def __init__(self, step: Step, layout: Layout, noted: Notes, names: Collection[str]):
        super().__init__(step, layout, noted)
        self._names = names

    def _note_beginning(self) -> None:
        """Write nothing: each substep notes where it begins."""

    def _begin_substep(self) -> None:
        for place in self.places:
            with self.about(place):
                self._note_its(STATE)

    def _show_held(self, piece: Piece) -> None:
        super()._show_held(piece)
        if noted := [name for name in piece.leaves if name in self._names]:
            self._note_its(noted)

    def _note_its(self, names: Collection[str]) -> None:
        """Write how the particle at hand notes its values."""
        b = self.bound
        self.line(f"if {b('is_there')}:")
        for name in names:
            self.line(f"    {self.noted.write(name, 'row', b(name), b('particle'))}")

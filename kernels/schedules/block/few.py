"""Code of a block for phases that few particles go through, which all threads share, see `compaction`."""

from collections.abc import Sequence

from balloon_warp.kernels.phase import STATE, Phase
from balloon_warp.kernels.schedules.block.names import NamesInBlock
from balloon_warp.kernels.schedules.pieces import Piece


class FewInBlock(NamesInBlock):
    """Write the list of few particles, and the phases for them."""

    def compacted(self, piece: Piece) -> int | None:
        """Return which phase of particles, and all after it, only those go through that it acts on; None if all do.

        The phases read nothing but state that earlier ones have written, and values derived from the point that a
        particle had, see `_from_start`; and items keep nothing.
        """
        if piece.item != "particle" or self.layout.held or piece.leaves or piece.keeps or piece.phases[-1].sums:
            return None
        written: set[str] = set()
        for number, phase in enumerate(piece.phases):
            of_others = {name for each in piece.phases[number:] for name in self.reads(each)} & written
            of_others -= {name for each in self._from_start(piece) for name in each.writes}
            if phase.rare and phase.asked(self.features, self.step.look) and of_others <= STATE.keys():
                return number
            written |= phase.writes.keys()
        return None

    def _from_start(self, piece: Piece) -> tuple[Phase, ...]:
        """Return the phases that read nothing but the point before it moves, which the other tile still has."""
        moving = next((number for number, phase in enumerate(piece.phases) if "point" in phase.writes), 0)
        again = "point" in piece.doubles
        return tuple(phase for phase in piece.phases[:moving] if again and set(self.reads(phase)) == {"point"})

    def _few_items(self, piece: Piece, starts: Sequence[Phase]) -> None:
        """Write the work of threads for the particles that were noted.

        Args:
            starts: phases whose values follow from the points that they had.
        """
        name, threads = piece.phases[0].name, self.layout.threads
        self.line(f"for noted in range(thread, count_of_{name}({self.turn}), {threads}):")
        with self.indented():
            self.line(f"particle = item_of_{name}(noted)")
            self.known.add("particle")
            if starts:
                self.line(f"point = in_tile({self.points[1]}, particle)")
                self.known.add("point")
                self.calls(starts)
                self.known.discard("point")
            self.calls(piece.phases)
            self._put_particle(piece)
        self.line("if thread == 0:")
        self.line(f"    clear_{name}({self.next_turn})")
        self.line("block_barrier()")

    def _note_or_go_on(self, phases: Sequence[Phase]) -> None:
        """Write how an item is noted, if the first of phases may act on it, and otherwise goes through the others."""
        phase, *others = phases
        self.line(f"if {self.may_act(phase)}:")
        self.line(f"    note_{phase.name}({self.turn}, particle)")
        if others:
            self.line("else:")
            with self.indented():
                self.calls(others)

    def _put_particle(self, piece: Piece) -> None:
        """Write the velocity and point that a piece has moved to where they wait."""
        if "velocity" in piece.moves:
            self.line(self.write("velocity", self._target(piece, "velocity")))
        if "point" in piece.moves:
            self.line(f"put_in_tile({self._target(piece, 'point')}, particle, point)")

    def _target(self, piece: Piece, name: str) -> str:
        """Return where a piece writes points, or velocities."""
        places = self.points if name == "point" else self.velocities
        return places[1 if name in piece.doubles else 0]

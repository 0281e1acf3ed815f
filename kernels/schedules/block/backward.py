"""A frame backwards as one kernel: a block of threads has a world of one balloon.

The block computes the frame again from its beginning, and notes where each substep begins and what its particles have
seen of each other. Then its substeps run backwards.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import constants_of
from balloon_warp.kernels.memory import put_vector_in
from balloon_warp.kernels.phase import STATE
from balloon_warp.kernels.schedules.block.backward_items import TurnsInBlock
from balloon_warp.kernels.schedules.block.backward_turns import TurnsBesideParticles
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.notes import Notes
from balloon_warp.kernels.schedules.block.sums import block_sum
from balloon_warp.kernels.schedules.launched.backward import writers_backwards
from balloon_warp.kernels.schedules.launched.trace import arguments_of, is_bar, looks_around, traces_of
from balloon_warp.kernels.schedules.pieces import Piece, Step
from balloon_warp.kernels.schedules.writer import written_types
from balloon_warp.kernels.warp_sums import Five


class BackwardBlockWriter(TurnsBesideParticles):
    """Write the kernel of a frame backwards.

    Args:
        turned: phases that run backwards.
        again: the same as they are computed again, with what the others ask for kept.
    """

    derived = True
    velocity_row = "row"
    """Row of the velocities that are read"""

    def __init__(self, turned: Step, again: Step, layout: Layout, columns: tuple[int, ...]):
        super().__init__(again, layout)
        self.turned, self.columns = turned, columns
        self.velocities = ("velocities", "velocities")
        adjoints = [each for trace in traces_of(turned) for entry in trace.entries for each in entry.adjoints]
        seen = {name for each in adjoints for name in arguments_of(each) if is_bar(name) and name.endswith("_bars")}
        self.seen = tuple(sorted(name.removesuffix("_bars") for name in seen))
        """Values whose bars particles see of each other"""
        self.noted = Notes("notes", layout.capacity, self._noted_types())
        self.bars_of_particles = Notes("bars_of_particles", layout.capacity, self._types_of_bars())

    @property
    def widths(self) -> dict[str, int]:
        """Return how many numbers a row has in each array, by its name."""
        return {"notes": self.noted.words, "bars_of_particles": self.bars_of_particles.words}

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "turn_worlds_back"

    @property
    def remark(self) -> str:
        """Return what the kernel is."""
        return f"A block for each world, for a frame backwards; its {self.layout.threads} threads loop over particles."

    def _arguments(self) -> dict[str, str]:
        bars = dict.fromkeys(STATE, "vec3")
        return {
            **super()._arguments(), "slot_pairs": "wp.array2d[wp.vec2]",
            "notes": "wp.array2d[float]", "bars_of_particles": "wp.array2d[float]",
            "all_velocities": "wp.array2d[wp.vec3]",
            **{f"all_{value}_bar": f"wp.array2d[{value}_type]" for value in written_types(self.step)},
            **{f"all_{name}_bar": f"wp.array2d[wp.{kind}]" for name, kind in bars.items()},
            "all_load_bar": "wp.array2d[wp.vec2]", "all_pressure_bar": "wp.array2d[float]",
            "all_gas_mass_bar": "wp.array2d[float]", "all_keyed_bar_of_balloons": "wp.array2d[wp.vec2]",
            "all_gas_bar": "wp.array2d[wp.vec2]", "number_bars_of_balloons": "wp.array3d[float]",
        }  # fmt: skip

    def names(self) -> dict[str, Any]:
        """Return what the text refers to."""
        self._written()
        loads, totals = (block_sum(name, Five, 1, self.layout.warps) for name in ("load_bar", "bars"))
        return {
            **super().names(), **self.called, "constants_of": constants_of, "Five": Five,
            "put_vector_in": put_vector_in, **self.noted.names(),
            **self.bars_of_particles.names(), "put_load_bar": loads.put, "total_load_bar": loads.total,
            "put_bars": totals.put, "total_bars": totals.total,
        }  # fmt: skip

    # ---- the frame

    def _body(self) -> None:
        self._find_world()
        self._places_of_values()
        self.line("# Particles come from the state.")
        self._take_particles()
        self._note_beginning()
        self._clear_lists()
        self.line("block_barrier()")
        self._write_pieces(piece for piece in self.step.pieces if piece.once)
        self._keep_once()
        self._forget_times()
        self._substeps()
        self._begin_sums()
        self._substeps_back()
        self._end_sums()

    def _places_of_values(self) -> None:
        tiles = [*self.points[: 2 if "point" in self.step.doubled else 1], *(f"{name}_bars" for name in self.seen)]
        for tile in tiles:
            self.line(f'{tile} = wp.tile_empty(shape={self.layout.capacity}, dtype=wp.vec3, storage="shared")')
        self._places_of_membrane_faces()
        self.line("count = state.points.shape[1]")
        self.line("first_row = world * (t.substeps + 1)")
        self.line("frame_begin = time_of(t, state.frame, 0.0)")
        self.line("time_in_frame = float(0.0)")
        self.line("is_first = wp.where(thread == 0, 1.0, 0.0)")
        self.known.add("time_in_frame")

    def _note_beginning(self) -> None:
        with self._over("particle"):
            self.line(self.noted.write("point", "first_row", "in_tile(points, particle)"))
            self.line(self.noted.write("velocity", "first_row", "state.velocities[world, particle]"))

    def _noted_types(self) -> dict[str, Any]:
        """Return the types of the numbers and vectors of particles that rows hold, unless others look at them there."""
        types: dict[str, Any] = {**dict.fromkeys(STATE, wp.vec3), **written_types(self.step)}
        names = [name for name in STATE if not (name == "velocity" and self.shows_velocities)]
        return {name: types[name] for name in (*names, *self._kept_of("particle")) if types[name] in (float, wp.vec3)}

    def _types_of_bars(self) -> dict[str, Any]:
        """Return the types of the bars of particles that no other particle sees."""
        types = {**dict.fromkeys(STATE, wp.vec3), **written_types(self.step)}
        names = (*STATE, *(name for name in self._kept_of("particle") if name not in self.seen))
        return {name: types[name] for name in names if types[name] in (float, wp.vec3)}

    def _clear_lists(self) -> None:
        for name in self._compacted:
            self.line("if thread == 0:")
            self.line(f"    clear_{name}(0)")
            self.line(f"    clear_{name}(1)")

    # ---- forward

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
        """Write what is noted of the balloon, and bring points back to the tile that the next substep begins with."""
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

    # ---- backwards

    def _substeps_back(self) -> None:
        make = partial(TurnsInBlock, self.layout, self.seen, self.noted, self.bars_of_particles)
        turns = [(writer, writer.written()) for writer in writers_backwards(self.turned, self.columns, make)]
        self._begin_bars()
        self._begin_kinds(turns)
        self.line("for back in range(t.substeps):")
        with self.indented():
            self.line("row = first_row + (t.substeps - 1 - back)")
            self.line("time_in_frame = float(t.substeps - 1 - back) * t.step_seconds")
            if self.features.gas:
                self._find_loads()
            for number, (writer, lines) in enumerate(turns):
                if writer.of_balloon:
                    self._turn_balloon(writer, lines)
                else:
                    self._turn_particles(writer, lines, first=not number)
                self.called |= writer.called
            self.line("block_barrier()")
        self._end_kinds()
        with self._over("particle"):
            for name in STATE:
                bar = self.bars_of_particles.read(name, "world")
                self.line(f"put_vector_in(all_{name}_bar, world, particle, {bar})")

    def _begin_bars(self) -> None:
        """Write what the bars of particles are at the end of a frame."""
        with self._over("particle"):
            for name in STATE:
                bar = f"vector_in(all_{name}_bar, world, particle)"
                self.line(self.bars_of_particles.write(name, "world", bar))

    def _turn_particles(self, writer: TurnsInBlock, lines: Sequence[str], first: bool) -> None:
        """Write turns of particles; the first put points where others see them."""
        if any(looks_around(adjoint) for _, adjoint in writer.turns):
            self.line("block_barrier()")
            self._turn_faces(writer, "first.n")
            self._turn_eights(writer)
        if len(lines) == 1 and not first:
            return
        self.lines.append(lines[0])
        if first:
            self.line(f"    put_in_tile(points, particle, {self.noted.read('point', 'row')})")
        self.lines += lines[1:]

"""A frame backwards as one kernel: a block of threads has a world of one balloon.

Rows have the beginning of each substep and the values that its particles saw of each other, see `again`.
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
from balloon_warp.kernels.schedules.pieces import Step
from balloon_warp.kernels.schedules.writer import written_types
from balloon_warp.kernels.warp_sums import Five


class BackwardBlockWriter(TurnsBesideParticles):
    """Write the kernel of a frame backwards.

    Args:
        turned: phases that run backwards.
        kept: the same forward, which keep the values that the others ask for.
    """

    derived = True

    def __init__(self, turned: Step, kept: Step, layout: Layout, columns: tuple[int, ...]):
        super().__init__(kept, layout)
        self.turned, self.columns = turned, columns
        adjoints = [each for trace in traces_of(turned) for entry in trace.entries for each in entry.adjoints]
        seen = {name for each in adjoints for name in arguments_of(each) if is_bar(name) and name.endswith("_bars")}
        self.seen = tuple(sorted(name.removesuffix("_bars") for name in seen))
        """Values whose bars particles see of each other"""
        self.noted = Notes("notes", layout.capacity, self._noted_types())
        self.bars_of_particles = Notes("bars_of_particles", layout.capacity, self._types_of_bars())

    @property
    def read_back(self) -> list[str]:
        """Return the values of a particle that are noted, besides its state."""
        return self._kept_of("particle")

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
        """Return a sentence on the kernel."""
        return f"A block for each world, for a frame backwards; its {self.layout.threads} threads loop over particles."

    def _arguments(self) -> dict[str, str]:
        bars = dict.fromkeys(STATE, "vec3")
        return {
            **super()._arguments(), "bars_of_particles": "wp.array2d[float]",
            **{f"all_{value}_bar": f"wp.array2d[{value}_type]" for value in written_types(self.step)},
            **{f"all_{name}_bar": f"wp.array2d[wp.{kind}]" for name, kind in bars.items()},
            "all_load_bar": "wp.array2d[wp.vec2]", "all_pressure_bar": "wp.array2d[float]",
            "all_gas_mass_bar": "wp.array2d[float]", "all_keyed_bar_of_balloons": "wp.array2d[wp.vec2]",
            "all_gas_bar": "wp.array2d[wp.vec2]", "number_bars_of_balloons": "wp.array3d[float]",
        }  # fmt: skip

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        self._written()
        loads, totals = (block_sum(name, Five, 1, self.layout.warps) for name in ("load_bar", "bars"))
        return {
            **super().names(), **self.called, "constants_of": constants_of, "Five": Five,
            "put_vector_in": put_vector_in, **self.noted.names(), **self.bars_of_particles.names(),
            "put_load_bar": loads.put, "total_load_bar": loads.total,
            "put_bars": totals.put, "total_bars": totals.total,
        }  # fmt: skip

    # ---- the frame

    def _body(self) -> None:
        self._find_world()
        self._places_of_values()
        self._begin_frame()
        self._begin_sums()
        self._substeps_back()
        self._end_sums()

    def _places_of_values(self) -> None:
        tiles = ("points", *(f"{name}_bars" for name in self.seen))
        self._places_of_rows(tiles)
        self.line("is_first = wp.where(thread == 0, 1.0, 0.0)")

    def _noted_types(self) -> dict[str, Any]:
        """Return the types of the numbers and vectors of particles that rows hold, unless others look at them there."""
        types: dict[str, Any] = {**dict.fromkeys(STATE, wp.vec3), **written_types(self.step)}
        names = [name for name in STATE if not (name == "velocity" and self.shows_velocities)]
        return {name: types[name] for name in (*names, *self.read_back) if types[name] in (float, wp.vec3)}

    def _types_of_bars(self) -> dict[str, Any]:
        """Return the types of the bars of particles that no other particle sees."""
        types = {**dict.fromkeys(STATE, wp.vec3), **written_types(self.step)}
        names = (*STATE, *(name for name in self._kept_of("particle") if name not in self.seen))
        return {name: types[name] for name in names if types[name] in (float, wp.vec3)}

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
        """Write the bars of particles at the end of a frame."""
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

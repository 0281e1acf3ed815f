"""A frame backwards as one kernel: a block of threads has a world of one balloon.

The block computes the frame again from its beginning, and notes where each substep begins and what its particles have
seen of each other. Then its substeps run backwards.
"""

from collections.abc import Sequence
from functools import cache, partial
from typing import Any

from balloon_warp.kernels.adjoints.derived import constants_of
from balloon_warp.kernels.codegen import kernel_from
from balloon_warp.kernels.memory import put_vector_in
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phase import STATE, Item
from balloon_warp.kernels.schedules.block.backward_items import OVER_FRAME, TurnsInBlock
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.source import BlockWriter
from balloon_warp.kernels.schedules.block.sums import block_sum
from balloon_warp.kernels.schedules.launched.backward import writers_backwards
from balloon_warp.kernels.schedules.launched.trace import arguments_of, is_bar, looks_around, traces_of
from balloon_warp.kernels.schedules.pieces import Piece, Step
from balloon_warp.kernels.schedules.writer import written_types
from balloon_warp.kernels.warp_sums import Five

FIVE = 5
"""Numbers that threads add up together"""


class BackwardBlockWriter(BlockWriter):
    """Write the kernel of a frame backwards."""

    def __init__(self, step: Step, layout: Layout, columns: tuple[int, ...]):
        super().__init__(step, layout)
        self.columns = columns
        self.called: dict[str, Any] = {}
        self.velocities = ("velocities", "velocities")
        adjoints = [each for trace in traces_of(step) for entry in trace.entries for each in entry.adjoints]
        seen = {name for each in adjoints for name in arguments_of(each) if is_bar(name) and name.endswith("_bars")}
        self.seen = tuple(sorted(name.removesuffix("_bars") for name in seen))
        """Values whose bars particles see of each other"""

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "turn_worlds_back"

    @property
    def remark(self) -> str:
        """Return what the kernel is."""
        return f"A block for each world, for a frame backwards; its {self.layout.threads} threads loop over particles."

    def _arguments(self) -> dict[str, str]:
        vectors, bars = dict.fromkeys(STATE.values(), "vec3"), dict.fromkeys(STATE, "vec3")
        return {
            **super()._arguments(),
            **{f"all_{view}": f"wp.array2d[wp.{kind}]" for view, kind in vectors.items()},
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
            "put_vector_in": put_vector_in, "put_load_bar": loads.put, "total_load_bar": loads.total,
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
        self.line("count = state.points.shape[1]")
        self.line("first_row = world * (t.substeps + 1)")
        self.line("frame_begin = time_of(t, state.frame, 0.0)")
        self.line("time_in_frame = float(0.0)")
        self.line("is_first = wp.where(thread == 0, 1.0, 0.0)")
        self.known.add("time_in_frame")

    def _note_beginning(self) -> None:
        with self._over("particle"):
            self.line("put_vector_in(all_points, first_row, particle, in_tile(points, particle))")
            self.line("put_vector_in(all_velocities, first_row, particle, state.velocities[world, particle])")

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
            for name, array, row in (
                *(("velocities", "velocities", "row"), ("next_velocities", "velocities", "row + 1")),
                *(("next_points", "points", "row + 1"),),
                *((f"each_{value}", value, "row") for value in self._kept_of("particle")),
            ):
                self.line(f"{name} = all_{array}[{row}]")
            self._write_pieces(piece for piece in self.step.pieces if not piece.once and not piece.last)
            self._end_substep()

    def _kept_of(self, item: Item) -> list[str]:
        """Return the values of particles, or of the balloon, that each substep notes."""
        return [value for value in self.step.kept if self.step.owner(value) == item]

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

    def _target(self, piece: Piece, name: str) -> str:
        return "next_velocities" if name == "velocity" else super()._target(piece, name)

    def _put_particle(self, piece: Piece) -> None:
        super()._put_particle(piece)
        if "point" in piece.moves:
            self.line("put_vector(next_points, particle, point)")

    # ---- backwards

    def _begin_sums(self) -> None:
        """Write where what adds up begins, in each thread."""
        self.line("block_barrier()")  # one thread has noted what the balloon was last
        self.line("# Substeps run backwards.")
        for place in range(len(self.columns)):
            self.line(f"number_{place} = float(0.0)")
        for name, size in OVER_FRAME.items():
            self.line(f"over_{name} = {'wp.vec2()' if size == 2 else 'float(0.0)'}")
        self.line("load_part = is_first * all_load_bar[world, 0]")
        self.line("load_before = wp.vec2()")
        self.line("load_after = wp.vec2()")
        self.line("found_pressure_bar = float(0.0)")
        for value in self._kept_of("balloon"):
            self.line(f"found_{value}_bar = {value}_type()")

    def _substeps_back(self) -> None:
        self.line("for back in range(t.substeps):")
        with self.indented():
            self.line("row = first_row + (t.substeps - 1 - back)")
            self.line("time_in_frame = float(t.substeps - 1 - back) * t.step_seconds")
            with self._over("particle"):
                self.line("put_in_tile(points, particle, vector_in(all_points, row, particle))")
            if self.features.gas:
                self._find_loads()
            make = partial(TurnsInBlock, self.layout, self.seen)
            for writer in writers_backwards(self.step, self.columns, make):
                if any(looks_around(adjoint) for _, adjoint in writer.turns):
                    self.line("block_barrier()")
                self.lines += writer.written()
                self.called |= writer.called
            self.line("block_barrier()")

    def _find_loads(self) -> None:
        """Write what the gas presses with in this substep, and in the one before."""
        self.line("load_now = all_gas_load[row, 0]")
        self.line("load_after = wp.vec2(load_now[1], load_now[2])")
        self.line("load_before = two_in(state.inflation_loads, world, 0)")
        self.line("if back + 1 < t.substeps:")
        self.line("    load_then = all_gas_load[row - 1, 0]")
        self.line("    load_before = wp.vec2(load_then[1], load_then[2])")
        self.line("found_pressure_bar = wp.where(back == 0, all_pressure_bar[world, 0], 0.0)")

    def _end_sums(self) -> None:
        """Write the sums over all threads, and where they go."""
        of_frame = {
            "load_part": ("all_load_bar[world, 0]", 2), "over_keyed": ("all_keyed_bar_of_balloons[world, 0]", 2),
            "over_gas": ("all_gas_bar[world, 0]", 2), "over_gas_mass": ("all_gas_mass_bar[world, 0]", 1),
        }  # fmt: skip
        parts = [f"{name}[{n}]" if size > 1 else name for name, (_, size) in of_frame.items() for n in range(size)]
        parts += [f"number_{place}" for place in range(len(self.columns))]
        found = self._summed(parts)
        self.line("if thread == 0:")
        with self.indented():
            self.line("all_pressure_bar[world, 0] = 0.0")
            for place, size in of_frame.values():
                its, found = found[:size], found[size:]
                self.line(f"{place} = {its[0] if size == 1 else f'wp.vec2({its[0]}, {its[1]})'}")
            for place, total in enumerate(found):
                self.line(f"number_bars_of_balloons[world, 0, {place}] = {total}")

    def _summed(self, parts: Sequence[str]) -> list[str]:
        """Write sums over all threads, and return their names."""
        names = []
        for begin in range(0, len(parts), FIVE):
            some = parts[begin : begin + FIVE]
            self.line(f"put_bars(thread, Five({', '.join([*some, *['0.0'] * (FIVE - len(some))])}))")
            self.line("block_barrier()")
            self.line(f"sums_{begin} = total_bars(0)")
            self.line("block_barrier()")
            names += [f"sums_{begin}[{place}]" for place in range(len(some))]
        return names


@cache
def kernel_backwards(step: Step, layout: Layout, columns: tuple[int, ...]) -> Any:
    """Make the kernel of a frame backwards."""
    writer = BackwardBlockWriter(step, layout, columns)
    options = {**OPTIONS, "fast_math": True, "max_unroll": 16}
    source = writer.source()
    return kernel_from(writer.name, source, writer.names(), cuda_max_registers=layout.registers, module_options=options)


@cache
def arguments_backwards(step: Step, layout: Layout, columns: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of what it takes."""
    return BackwardBlockWriter(step, layout, columns).arguments()

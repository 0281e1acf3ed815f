"""A frame backwards as one kernel: a thread has eight worlds of one balloon each, or one, and all goes side by side.

The frame is computed again from its beginning. Each substep has a row of its own, for places, velocities and the values
that particles see of each other. Then substeps run backwards. Both ways, a particle's sums have the same order for
eight worlds and for eight particles of one.
"""

from functools import cache, partial
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import constants_of
from balloon_warp.kernels.algebra import times
from balloon_warp.kernels.codegen import kernel_from
from balloon_warp.kernels.lanes import IN_LANES, Lanes, Lanes2
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phase import STATE
from balloon_warp.kernels.schedules.lanes.backward_items import TurnsInLanes
from balloon_warp.kernels.schedules.lanes.bars import bar_functions, load_in, own_function
from balloon_warp.kernels.schedules.lanes.layouts import Layout
from balloon_warp.kernels.schedules.lanes.places import places_of
from balloon_warp.kernels.schedules.lanes.source import FrameWriter
from balloon_warp.kernels.schedules.lanes.sums import OVER_ITEMS, Sums, sum_functions
from balloon_warp.kernels.schedules.launched.backward import writers_backwards
from balloon_warp.kernels.schedules.launched.trace import arguments_of, is_bar, traces_of
from balloon_warp.kernels.schedules.pieces import Piece, Step
from balloon_warp.kernels.schedules.writer import head, named_in, written_types


class BackwardLanesWriter(FrameWriter):
    """Write the kernel of a frame backwards."""

    row, place = "row", "slot"

    def __init__(self, step: Step, layout: Layout, columns: tuple[int, ...]):
        super().__init__(step, layout)
        self.columns, self.sums = columns, Sums(len(columns))
        self.called: dict[str, Any] = {}
        adjoints = [each for trace in traces_of(step) for entry in trace.entries for each in entry.adjoints]
        told = {name for each in adjoints for name in arguments_of(each) if is_bar(name) and name.endswith("_bars")}
        self.bars_seen = tuple(sorted(name.removesuffix("_bars") for name in told))
        """Values whose bars items see of each other"""

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "turn_worlds_back" if self.layout.worlds else "turn_octets_back"

    @property
    def doubled(self) -> list[str]:
        """Return the views of state that each substep has a row of: all."""
        return list(STATE.values())

    @staticmethod
    def _flips(piece: Piece, view: str) -> int:
        return sum(STATE[name] == view for name in piece.moves)

    @property
    def bars(self) -> dict[str, Any]:
        """Return the types of the bars of items, by the names of the values."""
        types = written_types(self.step)
        of_items = {name: types[name] for name in self.step.kept if self.step.owner(name) == "particle"}
        return {
            name: self.layout.vector if name in self.bars_seen else IN_LANES[dtype]
            for name, dtype in ({**dict.fromkeys(STATE, wp.vec3), **of_items}).items()
        }

    def arguments(self) -> dict[str, str]:
        """Return the names of the kernel's arguments, as it needs them, and their types."""
        more = {
            "slot": "wp.int32", "sums": "wp.array3d[Lanes]",
            **{f"all_{name}_bars": f"wp.array2d[{name}_bar_lanes]" for name in self.bars},
            "all_point_bar": "wp.array2d[wp.vec3]", "all_velocity_bar": "wp.array2d[wp.vec3]",
            "all_load_bar": "wp.array2d[wp.vec2]", "all_pressure_bar": "wp.array2d[float]",
            "all_gas_mass_bar": "wp.array2d[float]", "all_keyed_bar_of_balloons": "wp.array2d[wp.vec2]",
            "all_gas_bar": "wp.array2d[wp.vec2]", "number_bars_of_balloons": "wp.array3d[float]",
        }  # fmt: skip
        return super().arguments() | named_in(self.lines, more)

    def source(self) -> str:
        """Return the text of the kernel."""
        if not self.lines:
            self._frame()
        remark = f"A thread for each {'eight worlds' if self.layout.worlds else 'world'}: a frame backwards."
        return "\n".join([*head(self.name, self.arguments(), remark), *self.lines, ""])

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        self.source()
        places = places_of(self.layout)
        bar_types = {f"{name}_bar_lanes": dtype for name, dtype in self.bars.items()}
        read_bars, write_bars = bar_functions(self.layout)
        own_of = own_function(self.step.features.columns.places["mass"], self.layout)
        return {
            **super().names(), **self.called, **bar_types, **sum_functions(self.layout),
            "Lanes": Lanes, "Lanes2": Lanes2, "constants_of": constants_of, "own_of": own_of, "read_bars": read_bars,
            "write_bars": write_bars, "worlds_of": places.worlds, "first_world": places.first_world,
            "load_in": load_in, "times": times,
        }  # fmt: skip

    # ---- the frame

    def _frame(self) -> None:
        self.line("group = first_group + wp.tid()")
        self.line("first_row = slot * (tables.substeps + 1)")
        for view in STATE.values():
            self.line(f"{view} = all_{view}[first_row]")
        self.line("read_frame(t, state, working, group, points, velocities)")
        if self.carries_loads:
            self.line("load_at_start = loads_of(t, state, group, 0)")
        self.substeps()
        self._begin_back()
        self.line("for back in range(tables.substeps):")
        with self.deeper():
            self._substep_back()
        self._end_back()

    def _begin_substep(self) -> None:
        self._times("substep")
        for view in STATE.values():
            self.line(f"{view} = all_{view}[row]")
            self.line(f"new_{view} = all_{view}[row + 1]")

    def _times(self, substep: str) -> None:
        """Write which substep it is, and when."""
        self.line(f"row = first_row + {substep}")
        self.line(f"time_in_frame = float({substep}) * t.step_seconds")
        self.line("time = time_of(tables, state.frame, time_in_frame)")
        self.line("end = time_in_frame + t.step_seconds")

    def _begin_back(self) -> None:
        self.line("# Substeps run backwards.")
        self.line("constants = constants_of(tables)")
        self.line("balloon = int(0)")
        for name in self.bars:
            self.line(f"{name}_bars = all_{name}_bars[slot]")
        self.line("read_bars(t, group, all_point_bar, all_velocity_bar, point_bars, velocity_bars)")
        self.line(f"for number in range({self.sums.total}):")
        self.line("    clear_sum(sums, slot, number)")
        for name in self._of_balloon:
            self.line(f"found_{name}_bar = {name}_lanes()")
        if self.carries_loads:
            self.line("for place in range(worlds_of(group, t.world_count)):")
            self.line("    carried = all_load_bar[first_world(group) + place, 0]")
            for part, place in enumerate(self.sums.places("load")):
                self.line(f"    add_to(sums, slot, {place}, 0, set_lane(Lanes(), place, carried[{part}]))")

    @property
    def carries_loads(self) -> bool:
        """Return whether the pressure of one substep is read in the next."""
        return self.step.features.gas and self.step.features.obstacles

    @property
    def _of_balloon(self) -> list[str]:
        return [name for name in self.step.kept if self.step.owner(name) == "balloon"]

    def _substep_back(self) -> None:
        self._times("(tables.substeps - 1 - back)")
        for view in STATE.values():
            self.line(f"{view} = all_{view}[row]")
        if self.step.features.gas:
            self.line("load_after = load_in(all_gas_load[row, balloon])")
        if self.carries_loads:
            self.line("load_before = load_at_start")
            self.line("if row > first_row:")
            self.line("    load_before = load_in(all_gas_load[row - 1, balloon])")
        make = partial(TurnsInLanes, self.layout, (self.seen, self.bars_seen), self.sums)
        for writer in writers_backwards(self.step, self.columns, make):
            self.lines += writer.written()
            self.called |= writer.called

    def _end_back(self) -> None:
        """Write the bars of where the frame begins, and sums over the frame."""
        self.line("write_bars(t, group, all_point_bar, all_velocity_bar, point_bars, velocity_bars)")
        for place in range(self.sums.total):
            self.line(f"total_{place} = total_of(sums, slot, {place})")
        self.line("for place in range(worlds_of(group, t.world_count)):")
        with self.deeper():
            self.line("world = first_world(group) + place")
            self.line("all_pressure_bar[world, 0] = 0.0")
            for name, target in (
                ("load", "all_load_bar"), ("keyed", "all_keyed_bar_of_balloons"), ("gas_mass", "all_gas_mass_bar"),
            ):  # fmt: skip
                parts = [f"total_{place}[place]" for place in self.sums.places(name)]
                text = parts[0] if OVER_ITEMS[name] == 1 else f"wp.vec2({', '.join(parts)})"
                sign = "+=" if name == "keyed" else "="
                self.line(f"{target}[world, 0] {sign} {text}")
            for number in range(len(self.columns)):
                total = f"total_{self.sums.of_number(number)}[place]"
                self.line(f"number_bars_of_balloons[world, 0, {number}] += {total}")


@cache
def kernel_backwards(step: Step, layout: Layout, columns: tuple[int, ...]) -> Any:
    """Make the kernel of a frame backwards."""
    writer = BackwardLanesWriter(step, layout, columns)
    return kernel_from(writer.name, writer.source(), writer.names(), module_options=OPTIONS)


@cache
def arguments_backwards(step: Step, layout: Layout, columns: tuple[int, ...]) -> dict[str, str]:
    """Return the names of its arguments, in order, and their types."""
    writer = BackwardLanesWriter(step, layout, columns)
    writer.source()
    return writer.arguments()


@cache
def bars_backwards(step: Step, layout: Layout) -> dict[str, Any]:
    """Return the types of the bars of items, by the names of the values."""
    return BackwardLanesWriter(step, layout, ()).bars

"""A frame backwards as one kernel: a thread has eight worlds of one balloon each, or one.

All goes side by side. The frame is computed again from its beginning. Each substep has a row of its own, for places,
velocities and the values that particles see of each other. Then substeps run backwards. Both ways, a particle's sums
have the same order for eight worlds and for eight particles of one.
"""

import inspect
import re
from collections.abc import Collection, Iterable
from functools import cache, partial
from typing import Any, ClassVar

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.algebra import times
from balloon_warp.kernels.compose import kernel_from
from balloon_warp.kernels.lanes import IN_LANES, Lanes, Lanes2, Lanes3, Lanes4, of_lane, set_lane
from balloon_warp.kernels.phase import STATE, Adjoint, constants_of
from balloon_warp.kernels.schedules.lanes import OFFSETS, OVER_ITEMS, FrameWriter, Sums, sum_functions
from balloon_warp.kernels.schedules.lanes_layouts import OF_BALLOON, Layout, of_item, places_of, put_item
from balloon_warp.kernels.schedules.lanes_state import lane_structs
from balloon_warp.kernels.schedules.launched_backward import BackwardWriter, writers_backwards
from balloon_warp.kernels.schedules.writer import (
    Entry,
    Piece,
    Step,
    arguments_of,
    head,
    is_bar,
    named_in,
    traces_of,
    written_types,
)


@wp.func
def load_in(noted: Lanes4):
    """Return the pressures at height 0 [Pa], and their rises with height [Pa/m], of the note of a gas."""
    load = Lanes2()
    load[0] = noted[1]
    load[1] = noted[2]
    return load


@cache
def bar_functions(layout: Layout) -> tuple[Any, Any]:
    """Return the functions that read the bars of where a frame ends, and that write those of where it begins."""
    LaneTables, places = lane_structs(layout).tables, places_of(layout)  # noqa: N806 - a type

    @wp.func
    def read_of_item(t: LaneTables, group: wp.int32, item: wp.int32, bars: wp.array2d[wp.vec3]):
        """Return the bars of an item, zero in lanes that hold nothing of their own."""
        bar = Lanes3()
        for lane in range(t.lane_count):
            if places.is_there(t, group, item, lane):
                world = places.world(group, lane, t.world_count)
                bar = set_lane(bar, lane, bars[world, places.particle(t, item, lane)])
        return bar

    @wp.func
    def write_of_item(t: LaneTables, group: wp.int32, item: wp.int32, bars: wp.array2d[wp.vec3], bar: Lanes3):
        """Write the bars of an item."""
        for lane in range(t.lane_count):
            if places.is_there(t, group, item, lane):
                world = places.world(group, lane, t.world_count)
                bars[world, places.particle(t, item, lane)] = of_lane(bar, lane)

    @wp.func
    def read_bars(
        t: LaneTables, group: wp.int32, all_point_bar: wp.array2d[wp.vec3], all_velocity_bar: wp.array2d[wp.vec3],
        point_bars: Any, velocity_bars: Any,
    ):  # fmt: skip
        for item in range(t.item_offsets[0], t.item_offsets[1]):
            put_item(point_bars, item, read_of_item(t, group, item, all_point_bar))
            put_item(velocity_bars, item, read_of_item(t, group, item, all_velocity_bar))

    @wp.func
    def write_bars(
        t: LaneTables, group: wp.int32, all_point_bar: wp.array2d[wp.vec3], all_velocity_bar: wp.array2d[wp.vec3],
        point_bars: Any, velocity_bars: Any,
    ):  # fmt: skip
        for item in range(t.item_offsets[0], t.item_offsets[1]):
            write_of_item(t, group, item, all_point_bar, of_item(point_bars, item))
            write_of_item(t, group, item, all_velocity_bar, of_item(velocity_bars, item))

    return read_bars, write_bars


@cache
def own_function(mass: int, layout: Layout) -> Any:
    """Return the function that reads the parameters of an item, without the numbers of its balloon.

    Args:
        mass: column of the mass.
    """
    LaneTables, Number = lane_structs(layout).tables, layout.number  # noqa: N806 - types

    @wp.struct
    class LaneOwn:
        """Indices, share and mass of an item: a type by which phases are derived has no arrays."""

        group: wp.int32
        number: wp.int32
        balloon: wp.int32
        kind: wp.int32
        share: Number
        mass: Lanes

    @wp.func
    def own_of(t: LaneTables, group: wp.int32, balloon: wp.int32, item: wp.int32):
        own = LaneOwn()
        own.group = group
        own.number = item
        own.balloon = balloon
        own.kind = t.all.inflation_kind[balloon]
        own.share = t.shares[item]
        own.mass = times(own.share, t.numbers[group, balloon, mass])
        return own

    return own_of


ITEM = "item"
"""Variable of the loop over items"""
ALIKE = {"t": "tables", "state": "state", "working": "working", "time": "time", "end": "end"}
"""Arguments that are the same in all lanes, and their variables"""


class TurnsOneByOne(BackwardWriter):
    """Write the turns of rare phases."""

    def _takes_eight(self, entry: Entry) -> bool:
        return entry.phase.takes_eight(self.step.features, self.step.access)

    def _call_one_by_one(self, entry: Entry) -> None:
        """Write the call of a rare phase for each lane, where any needs it."""
        phase = entry.phase
        self.called[phase.name] = phase.function(self.step.features, self.step.access)
        texts = [self._of_one(name, variable) for name, variable in entry.reads.items()]
        results = dict(zip(entry.writes.values(), entry.writes, strict=True))
        for variable, name in results.items():
            self.line(f"{variable} = {self.have(entry.reads[name]) if name in entry.reads else self._zero(name)}")
        self._in_lanes(entry, f"{phase.name}({', '.join(texts)})", list(results))
        self.known |= set(results)

    def _turn_one_by_one(self, entry: Entry, adjoint: Adjoint) -> None:
        """Write the call of a rare phase's adjoint for each lane, where any needs it, and add up its results."""
        phase, function = entry.phase, f"{entry.phase.name}_adjoint_{entry.adjoints.index(adjoint) + 1}"
        self.called[function] = adjoint.function
        self.line(f"# Backwards, one by one: {phase.summary}")
        texts = []
        for name in arguments_of(adjoint):
            texts.append(self._of_one(name, "" if is_bar(name) else entry.seen[name], self._told(entry, name)))
        results = {name: f"{function}_{name}" for name in adjoint.of}
        for name, result in results.items():
            if name == "params":
                for place in range(len(self.columns)):
                    self.line(f"{result}_{place} = Lanes()")
            else:
                stays = name in phase.writes and name in phase.reads(self.step.features, self.step.access)
                self.line(f"{result} = {self._bar(entry.writes[name], name) if stays else self._zero(name)}")
        self._in_lanes(entry, f"{function}({', '.join(texts)})", list(results.values()))
        for name, result in results.items():
            if name == "params":
                for place in range(len(self.columns)):
                    self.add_to_number(place, f"{result}_{place}")
            else:
                self._add_one_by_one(entry, name, result)

    def _add_one_by_one(self, entry: Entry, name: str, result: str) -> None:
        """Add to a bar: it is in place of that of a value that the phase has written."""
        self._add(entry.seen[name] if name not in entry.writes else entry.reads[name], name, result)

    def _of_one(self, name: str, variable: str, bar: str = "") -> str:
        """Return the text of an argument of a call for one lane."""
        if is_bar(name):
            return f"of_lane({bar}, lane)"
        if name == "params":
            return "params_of_one(t, lane_params, lane)"
        return ALIKE.get(name) or f"of_lane({self.have(variable)}, lane)"

    def _in_lanes(self, entry: Entry, call: str, results: list[str]) -> None:
        """Write a call for each lane, if any needs it."""
        phase = entry.phase
        if "lane_params" not in self.known:
            self.known.add("lane_params")
            self.line(f"lane_params = params_of(t, group, balloon, {ITEM})")
        asked = phase.asked(self.step.features, self.step.access)
        told = inspect.signature(asked.func).parameters
        given = {"params": "lane_params", "t": "t", "solids": "solids"}
        self.called[f"{phase.name}_may_act"] = asked
        texts = [given.get(name) or self.have(entry.reads[name]) for name in told]
        self.line(f"if {phase.name}_may_act({', '.join(texts)}):")
        self.line("    for lane in range(t.lane_count):")
        self.line(f"        if is_there(t, group, {ITEM}, lane):")
        ones = [f"one_{result}" for result in results]
        self.line(f"            {', '.join(ones)} = {call}")
        mass = self.step.features.columns.places["mass"]
        for result, one in zip(results, ones, strict=True):
            if not result.endswith("_params"):
                self.line(f"            {result} = set_lane({result}, lane, {one})")
                continue
            for place, column in enumerate(self.columns):
                more = f" + {one}.mass * of_lane(lane_params.share, lane)" if column == mass else ""
                number = f"{result}_{place}"
                self.line(f"            {number} = set_lane({number}, lane, {one}.n[{column}]{more})")


KNOWN = (
    *("t", "tables", "state", "working", "group", "slot", "back", "balloon", "points", "velocities", "constants"),
    *("time", "end", "time_in_frame", "solids"),
)
"""Names that the kernel has bound before"""


class TurnsInLanes(TurnsOneByOne):
    """Write turns between two waits.

    Args:
        seen: values that items see of each other on the way forward, and those whose bars they see.
        sums: places of the sums over items.
    """

    row: ClassVar[str] = "row"

    def __init__(self, layout: Layout, seen: tuple[Collection[str], Collection[str]], sums: Sums, *of_turns: Any):
        super().__init__(*of_turns)
        self.layout, self._sums = layout, sums
        self._values_seen, self._bars_seen = seen
        self.before: list[str] = []
        """Lines before the loop over items"""
        self.results: dict[str, str] = {}
        """Bars of the balloon's values that its turns find"""
        self.known |= {*KNOWN, *(f"{name}_bars" for name in self._bars_seen)}
        self.indent = "        "
        self._adjoint: Adjoint | None = None

    @property
    def of_balloon(self) -> bool:
        """Return whether worlds go by, each with its balloon."""
        return self.trace.item == "balloon"

    @property
    def of_quad(self) -> bool:
        """Return whether quads go by, each of which adds to the bars of its corners."""
        return self.trace.item == "quad"

    def written(self) -> tuple[str, ...]:
        """Return the lines; values of a world have other names than those of eight on the way forward."""
        lines = [*super().written(), *self._results_put()]
        own = {"params"} if self.trace.item == "particle" else set[str]()
        if self.of_balloon:
            own = _assigned(lines) - {f"found_{name}_bar" for name in self.results}
        words = re.compile(rf"(?<![.\w])({'|'.join(sorted(own))})\b")
        return *self.before, *(line if "#" in line or not own else words.sub(r"its_\1", line) for line in lines)

    def _results_put(self) -> list[str]:
        """Return the lines that put the results of a world's turns where items read them."""
        lines, where = [], self.indent
        for name, text in self.results.items():
            kept = f"found_{name}_bar"
            if self.layout.worlds:
                lines.append(f"{where}{kept} = set_lane({kept}, place, {text})")
            else:
                lines += [
                    f"{where}for lane in range(LANE_COUNT):",
                    f"{where}    {kept} = set_lane({kept}, lane, {text})",
                ]
        return lines

    def open(self) -> None:
        """Write a loop over items, or over the group's worlds."""
        if not self.of_balloon:
            offsets = OFFSETS["quad" if self.of_quad else "particle"]
            self.line(f"for {ITEM} in range({offsets}[0], {offsets}[1]):")
            self.indent += "    "
            self.known.add(ITEM)
            return
        for part, place in enumerate(self._sums.places("load")):
            self.line(f"load_bars_{part} = total_of(sums, slot, {place})")
            self.line(f"clear_sum(sums, slot, {place})")
        self.line("for place in range(worlds_of(group, t.world_count)):")
        self.indent += "    "
        self.line("world = first_world(group) + place")
        self.line("load_bar = wp.vec2(load_bars_0[place], load_bars_1[place])")
        self.known |= {"place", "world", "load_bar"}
        self.sinks.begun.discard("load")

    # ---- names

    def need(self, name: str) -> None:
        """Bind a name: one of the balloon before the loop over items."""
        if self.of_balloon or name in self.known or not (text := self._of_balloon(name)):
            super().need(name)
            return
        self.known.add(name)
        self.before.append(f"        {name} = {text}")

    def _of_balloon(self, name: str) -> str:
        """Return the text that finds a value of the balloon, in all lanes; "" where it is of an item."""
        if name == "load":
            return "load_after" if self.after_note else "load_before"
        if name == "numbers":
            return "t.numbers[group, balloon]"
        return "" if name in self.step.kept else OF_BALLOON.get(name, "").format(points="points")

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        if self.of_balloon:
            texts = {
                "numbers": "read_numbers(tables, world, balloon)",
                "pressure_bar": "wp.where(back == 0, all_pressure_bar[world, balloon], 0.0)",
            }
        else:
            own = "params_of_quad" if self.of_quad else "own_of"
            texts = {"params": f"{own}(t, group, balloon, {ITEM})"}
            texts |= {name: f"of_item({view}, {ITEM})" for name, view in STATE.items()}
            if name in self.step.features.columns.places:
                return "numbers", f"numbers[{self.step.features.columns.places[name]}]"
        if name in self.step.kept:
            return "", self.noted(name, self._owner(name))
        return ("", texts[name]) if name in texts else super().found(name)

    def have(self, variable: str) -> str:
        """Bind a variable, and return it."""
        entry = self.trace.writer(variable)
        if self.of_balloon and variable == "t":
            return "tables"
        if entry is None or variable in self.known or self.of_balloon or self._takes_eight(entry):
            return super().have(variable)
        if not entry.phase.light and entry.phase.writes.keys() <= set(self.step.kept):
            return super().have(variable)  # as it was noted
        self._call_one_by_one(entry)
        return variable

    def noted(self, name: str, owner: str) -> str:
        """Return the text that finds a note of the way forward on an item or its balloon."""
        if self.of_balloon:
            return f"of_lane(all_{name}[row, balloon], place)"
        if owner == "balloon":
            return f"all_{name}[row, balloon]"
        return f"of_item(all_{name}[row], {ITEM})" if name in self._values_seen else f"all_{name}[row, {ITEM}]"

    # ---- bars

    def _turn(self, entry: Entry, adjoint: Adjoint) -> None:
        self._adjoint = adjoint
        if self.of_balloon or self._takes_eight(entry):
            super()._turn(entry, adjoint)
        else:
            self._turn_one_by_one(entry, adjoint)

    def _zero(self, name: str) -> str:
        if self.of_balloon:
            return super()._zero(name)
        return "Lanes3()" if name in STATE else f"{name}_lanes()"

    def _add(self, variable: str, name: str, result: str) -> None:
        if self.of_balloon or name not in ("params", "numbers"):
            super()._add(variable, name, result)
        elif name == "params":
            mass = self.step.features.columns.places["mass"]
            if mass in self.columns:
                self.add_to_number(self.columns.index(mass), f"times(params.share, {result}.mass)")
        else:
            for place, column in enumerate(self._adjoint.columns if self._adjoint else ()):
                if column in self.columns:
                    self.add_to_number(self.columns.index(column), f"{result}[{place}]")

    def bar_at(self, name: str, owner: str) -> str:
        """Return the text that finds a bar that others have found."""
        if owner == "balloon":
            found = f"found_{name}_bar"
            if self.of_balloon:
                return f"of_lane({found}, place)"
            return found if self.layout.worlds else f"scaled({found}, t.present[{ITEM}])"
        vector = name in STATE or name in self._bars_seen
        return f"of_item({name}_bars, {ITEM})" if vector else f"{name}_bars[{ITEM}]"

    def put_bar(self, name: str, owner: str, sign: str, text: str) -> None:
        """Write a bar to where others find it, or add to it."""
        if name == "load":
            self._add_up(name, *(f"{text}[{part}]" for part in range(2)))
        elif owner == "balloon":
            self.results[name] = f"{self.results[name]} + {text}" if sign == "+=" else text
        else:
            before = f"{self.bar_at(name, owner)} + " if sign == "+=" else ""
            vector = name in STATE or name in self._bars_seen
            put = (
                f"put_item({name}_bars, {ITEM}, {before}{text})" if vector else f"{name}_bars[{ITEM}] = {before}{text}"
            )
            self.line(put)

    def add_to_number(self, place: int, text: str) -> None:
        """Add to the bar of a number that is asked for."""
        if self.of_balloon:
            super().add_to_number(place, text)
        else:
            self.line(f"add_to(sums, slot, {self._sums.of_number(place)}, {ITEM}, {text})")

    def add_over_frame(self, name: str, text: str) -> None:
        """Add to the bar of a value that stays the same in a frame."""
        if self.of_balloon:
            super().add_over_frame(name, text)
        else:
            self._add_up(name, text)

    def add_keyed(self, bar: str) -> None:
        """Add to the bar of a keyframed value."""
        if self.of_balloon:
            super().add_keyed(bar)
        else:
            self._add_up("keyed", bar, f"{bar} * time_in_frame")

    def _add_up(self, name: str, *texts: str) -> None:
        for place, text in zip(self._sums.places(name), texts, strict=True):
            self.line(f"add_to(sums, slot, {place}, {ITEM}, {text})")


def _assigned(lines: Iterable[str]) -> set[str]:
    """Return the variables that lines assign."""
    found = (re.match(r"\s*([\w, ]+) = ", line) for line in lines)
    return {name for each in found if each for name in each[1].split(", ")}


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

"""Phases backwards, eight items side by side: between two waits, items go by one after the other, or worlds do."""

import re
from collections.abc import Collection, Iterable
from typing import Any, ClassVar

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.phase import STATE
from balloon_warp.kernels.schedules.lanes.backward_rare import ITEM, TurnsOneByOne
from balloon_warp.kernels.schedules.lanes.items import OFFSETS
from balloon_warp.kernels.schedules.lanes.layouts import Layout
from balloon_warp.kernels.schedules.lanes.names import OF_BALLOON
from balloon_warp.kernels.schedules.lanes.sums import Sums
from balloon_warp.kernels.schedules.launched.trace import Entry

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

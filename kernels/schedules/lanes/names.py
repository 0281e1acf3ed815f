"""Names that phases read in eight lanes, and their calls: eight at once, or one lane or world at a time.

A rare phase is called only where something in the lanes needs it.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar

from balloon_warp.kernels.phase import STATE, VIEWS, Phase
from balloon_warp.kernels.schedules.lanes.layouts import Layout
from balloon_warp.kernels.schedules.pieces import Step
from balloon_warp.kernels.schedules.writer import Writer

OF_BALLOON: Mapping[str, str] = {
    "keyed": "ramps_of(t, state, group, balloon, time_in_frame)",
    "load": "loads_of(t, state, group, balloon)",
    "gas_mass": "gas_masses_of(t, working, group, balloon)",
    "way": "ways_of(t, working, group)",
    "forces": "t.forces[group]",
    "origin": "of_particle({points}, t.places, volume_origin(tables, balloon))",
}
"""Expressions for values of a balloon, or of all"""
HANDLES = ("t", "tables", "state", "working", "solids", "spheres", "group", "substep", "time_in_frame", "time", "end")
SAME = {"state", "working", "spheres", "time_in_frame", "time", "end"}
"""Names that a phase for one item gets unchanged"""


class NamesInLanes(Writer):
    """Find names, and write calls."""

    aliases: ClassVar[Mapping[str, str]] = {"springs": "working"}
    tables = "tables"
    row = "group"
    """Row in which values are kept"""
    place = "group"
    """Row of values that are used up within a substep"""

    def __init__(self, step: Step, layout: Layout):
        super().__init__(step, (*HANDLES, *STATE.values(), *(f"new_{view}" for view in STATE.values())))
        self.layout = layout
        self.item = "item"
        """Variable of the loop over items at hand"""
        self.lane = "lane"
        """Variable of the loop over lanes or worlds"""
        self.single: dict[str, str] = {}
        """Variables that hold values of the world at hand alone"""
        self.flips = dict.fromkeys(STATE.values(), 0)
        """Number of times that the state of particles has changed buffers in this substep"""
        self.shown = False
        """Whether the lanes have the current spheres"""
        self.of_balloon: list[str] = []
        """Lines before the loop over a balloon's items"""

    @property
    def seen(self) -> set[str]:
        """Return the names that particles or faces read of others: views of state, and values."""
        read = {
            name
            for piece in self.step.pieces
            for phase in piece.phases
            for name in phase.reads(self.step.features, self.step.look)
        }
        return {name for name in read if name in STATE.values()} | {VIEWS[name] for name in read if name in VIEWS}

    @property
    def doubled(self) -> list[str]:
        """Return the views of state that have two places."""
        return [STATE[name] for name in self.step.doubled]

    @contextmanager
    def deeper(self, levels: int = 1) -> Iterator[None]:
        """Write the block below the line before."""
        self.indent += "    " * levels
        yield
        self.indent = self.indent[: len(self.indent) - 4 * levels]

    def calls(self, phases: Iterable[Phase]) -> None:
        """Write calls of phases: of eight side by side, or lane by lane."""
        for phase in phases:
            if self.lane == "place":
                call = self._call_of_one(phase)
                self.line(f"# {phase.summary}")
                self._bind_of_one(phase, call)
            elif phase.takes_eight(self.step.features, self.step.look):
                super().calls((phase,))
            else:
                self._lane_by_lane(phase)

    def need(self, name: str) -> None:
        """Bind a name: one of a balloon before the loop over its items."""
        light = next((phase for phase in self.step.light if name in phase.writes), None)
        if self.bound(name) in self.known:
            return
        if light and not light.takes_eight(self.step.features, self.step.look):
            self._lane_by_lane(light)
        elif not light and (text := self.found_of_balloon(name)):
            self.known.add(name)
            self.of_balloon.append(f"{self.indent[4:]}{name} = {text}")
        else:
            super().need(name)

    def found_of_balloon(self, name: str) -> str:
        """Return the text that finds a value of a balloon or of all, or "" where it is of an item."""
        if name in self.step.kept and self.step.owner(name) == "balloon":
            return f"all_{name}[{self.row}, balloon]"
        if name in VIEWS and VIEWS[name] in self.step.kept:
            return f"all_{VIEWS[name]}[{self.row}]"
        features = self.step.features
        if name in features.kept and features.kept[name].item == "balloon":
            return f"{name}_of(t, kept_{name}, group, balloon)"
        return OF_BALLOON.get(name, "").format(points=self.bound("points"))

    def bound(self, name: str) -> str:
        """Return the variable of a phase's argument or result."""
        if name in self.flips:
            return self.place_of(name, self.flips[name])
        return self.item if name == "particle" else name

    @staticmethod
    def place_of(view: str, flips: int) -> str:
        """Return the variable for one of the two places of a view."""
        return f"new_{view}" if flips % 2 else view

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        kept, row = self.step.kept, self.row
        if name in kept:
            return (
                "",
                f"of_item(all_{name}[{row}], {self.item})" if name in self.seen else f"all_{name}[{row}, {self.item}]",
            )
        if name in STATE:
            return "", f"of_item({self.bound(STATE[name])}, {self.item})"
        if name == "params":
            return "", f"{'params_of_quad' if self.item == 'quad' else 'params_of'}(t, group, balloon, {self.item})"
        if name in self.step.features.kept:
            return "", f"{name}_of(t, kept_{name}, group, {self.item})"
        if kept := self.step.features.kept_views.get(name):
            return "", f"kept_{kept}"
        return self.number_at(name)

    def _call_of_one(self, phase: Phase) -> str:
        """Return the call of a phase for one lane or world."""
        reads = phase.reads(self.step.features, self.step.look)
        return f"{phase.name}({', '.join(self._of_one(name) for name in reads)})"

    def _bind_of_one(self, phase: Phase, call: str) -> None:
        """Write a call, whose results hold for the world at hand alone."""
        its = {name: f"its_{name}" for name in phase.writes}
        self.line(f"{', '.join(its.values())} = {call}" if its else call)
        self.single |= its

    def _of_one(self, name: str) -> str:
        """Return the text that finds an argument of a phase for one."""
        lane = self.lane
        light = next((phase for phase in self.step.light if name in phase.writes and phase.item == "balloon"), None)
        if light and name not in self.single:
            self._bind_of_one(light, self._call_of_one(light))
        if name in self.single or name in SAME or name == "balloon":
            return self.single.get(name, name)
        texts = {
            "t": "tables", "thread": "0",
            "numbers": f"t.rows[group, {lane}, balloon]", "params": f"params_of_one(t, params, {lane})",
            "world": f"world_in_lane(group, {lane}, t.world_count)", "particle": f"particle_in_lane(t, item, {lane})",
        }  # fmt: skip
        if name in self.step.features.kept_views or (lane == "place" and name in self.step.features.kept):
            return self.kept_at(name, "world" if lane == "place" else texts["world"])
        if "sphere" in self.single and (number := self.number_at(name)):
            return number[1]
        if name == "params":
            self.need(name)
        if name in texts:
            return texts[name]
        if name in STATE.values():
            return f"view_of({self.bound(name)}, {lane}, t.places)"
        if name == "forces":
            return f"view_of({OF_BALLOON[name]}, {lane}, t.places)"
        if lane == "place" and (text := self.found_of_balloon(name)) and name not in self.known:
            return f"of_lane({text}, {lane})"
        self.need(name)
        return f"of_lane({self.bound(name)}, {lane})"

    def keep_of_one(self, names: Iterable[str]) -> None:
        """Write the kept values of an item of one world to where they stay."""
        for name in names:
            self.line(f"{self.kept_at(name)} = {self.single[name]}")

    def _lane_by_lane(self, phase: Phase) -> None:
        """Write the call of a phase for one in each lane, if it is rare once it is known that any needs it."""
        features, look = self.step.features, self.step.look
        reads = phase.reads(features, look)
        call = self._call_of_one(phase)
        begins = {name: name if name in self.known or name in STATE else "" for name in phase.writes}
        for name, start in begins.items():
            if start:
                self.need(name)
            else:
                self.line(f"{name} = {name}_lanes()")
        self.line(f"# {phase.summary}")
        asked = self._question(phase)
        guarded = bool(asked) or not phase.writes or {"state", "working", "spheres"} & set(reads)
        with self.deeper(int(bool(asked))):
            self.line(f"for lane in range({'t.lane_count' if guarded else 'LANE_COUNT'}):")
            with self.deeper():
                if guarded:
                    self.line(f"if is_there(t, group, {self.item}, lane):")
                with self.deeper(int(bool(guarded))):
                    its = [f"its_{name}" for name in phase.writes]
                    self.line(f"{', '.join(its)} = {call}" if its else call)
                    for name in phase.writes:
                        self.line(f"{name} = set_lane({name}, lane, its_{name})")
        self.known |= phase.writes.keys()

    def _question(self, phase: Phase) -> bool:
        """Write whether a rare phase has anything to do."""
        if not phase.asked(self.step.features, self.step.look):
            return False
        self.line(f"if {self.may_act(phase)}:")
        return True

    @staticmethod
    def names_of(function: Any) -> list[str]:
        """Return the names of the arguments of a function of Warp."""
        return list(function.input_types) if function else []

"""Base of all writers of kernels: the call of a phase, once all values that it reads are bound."""

import inspect
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any

from balloon_warp.kernels.clock import Clock, ramp_at, time_in_frame_of, time_of
from balloon_warp.kernels.loops.areas import volume_origin
from balloon_warp.kernels.memory import put_vector_in, two_in, vector_in
from balloon_warp.kernels.params import numbers_reader, params_functions
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.pieces import Step, values_of
from balloon_warp.kernels.spheres import spheres_in_state
from balloon_warp.kernels.tables import Tables, WorldState, sphere_number
from balloon_warp.kernels.working import Working

SCOPE: Mapping[str, Any] = {
    "Tables": Tables, "WorldState": WorldState, "Working": Working, "Clock": Clock,
    "time_of": time_of, "time_in_frame_of": time_in_frame_of,
    "ramp_at": ramp_at, "vector_in": vector_in, "put_vector_in": put_vector_in, "two_in": two_in,
    "volume_origin": volume_origin, "spheres_in_state": spheres_in_state,
    "sphere_number": sphere_number,
}  # fmt: skip
"""Names that a source may refer to, besides its phases"""


class Writer(ABC):
    """Write phases as source, line by line; a schedule says where it finds their inputs."""

    aliases: Mapping[str, str] = {}
    """Handles that phases know by another name"""
    tables = "t"
    """Variable of the tables that all schedules have"""

    def __init__(self, step: Step, known: Iterable[str]):
        self.step = step
        self.lines: list[str] = []
        self.known: set[str] = set(known)
        """Names that a line above has bound"""
        self.indent = "    "

    @abstractmethod
    def found(self, name: str) -> tuple[str, str] | None:
        """Return the names that the text takes itself, and the text that finds a phase's argument; or None."""

    def bound(self, name: str) -> str:
        """Return the variable of a phase's argument or result."""
        return name

    def line(self, text: str) -> None:
        """Write a line."""
        self.lines.append(self.indent + text)

    def calls(self, phases: Iterable[Phase]) -> None:
        """Write calls of phases, each with its summary as a remark."""
        for phase in phases:
            call = self.call(phase)
            self.line(f"# {phase.summary}")
            writes = ", ".join(self.bound(name) for name in phase.writes)
            self.line(f"{writes} = {call}" if writes else call)
            self.known |= {self.bound(name) for name in phase.writes}

    def call(self, phase: Phase) -> str:
        """Return the call of a phase, once its inputs are at hand."""
        for name in self.reads(phase):
            self.need(name)
        return f"{phase.name}({', '.join(self.bound(name) for name in self.reads(phase))})"

    def may_act(self, phase: Phase) -> str:
        """Return the call that asks whether a rare phase has anything to do, once its inputs are at hand."""
        asked = inspect.signature(phase.asked(self.step.features, self.step.look).func).parameters
        for name in asked:
            self.need(name)
        return f"{phase.name}_may_act({', '.join(map(self.bound, asked))})"

    def reads(self, phase: Phase) -> list[str]:
        """Return the names that a phase reads, by the writer's own names."""
        return [self.aliases.get(name, name) for name in phase.reads(self.step.features, self.step.look)]

    def need(self, name: str) -> None:
        """Bind a name."""
        variable = self.bound(name)
        if variable in self.known:
            return
        self.known.add(variable)
        for phase in self.step.light:
            if name in phase.writes:
                self.known |= {self.bound(each) for each in phase.writes}
                self.line(f"{', '.join(self.bound(each) for each in phase.writes)} = {self.call(phase)}")
                return
        where = self.found(name)
        if where is None:
            raise TypeError(f"{self.name}: a phase reads {name}, which nothing before it writes")
        takes, text = where
        for each in takes.split():
            self.need(each)
        self.line(f"{variable} = {text}")

    @property
    @abstractmethod
    def name(self) -> str:
        """Return the name of the kernel."""

    @property
    def kept_arrays(self) -> dict[str, str]:
        """The arguments that hold the kept values of items, and their types."""
        return {f"kept_{name}": f"wp.array2d[{name}_type]" for name in self.step.features.kept}

    def kept_at(self, name: str, world: str = "world") -> str:
        """Return the text that finds a kept value of an item, or of all of a world; "" where it is none of these."""
        features = self.step.features
        if name in features.kept_views:
            return f"kept_{features.kept_views[name]}[{world}]"
        if name not in features.kept:
            return ""
        item = features.kept[name].item
        return f"kept_{name}[{world}, {'0' if item == 'world' else item}]"

    def found_kept(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a kept value depends on, and the text that reads it; None where it is none."""
        kept, text = self.step.features.kept, self.kept_at(name)
        return ("balloon" if name in kept and kept[name].item == "balloon" else "", text) if text else None

    def number_at(self, name: str, params: str = "params") -> tuple[str, str] | None:
        """Return the arguments of a parameter, and the text that reads it for the particle or sphere at hand."""
        columns = self.step.features.columns
        if "sphere" in self.known and name in columns.places_of_spheres:
            return "", f"sphere_number({self.tables}.spheres, world, sphere, {columns.places_of_spheres[name]})"
        if name not in columns.places:
            return None
        parts = [f"{params}.n[{columns.places[name] + place}]" for place in range(columns.sizes[name])]
        return params, parts[0] if len(parts) == 1 else f"wp.vec3({', '.join(parts)})"

    def scope(self, phases: Iterable[Phase]) -> dict[str, Any]:
        """Return the objects that the text refers to for its phases, by name."""
        step = self.step
        called = {phase.name: phase.function(step.features, step.look) for phase in (*phases, *step.light)}
        types = {f"{value}_type": dtype for value, dtype in written_types(step).items()}
        _, read_params = params_functions(step.features.columns, step.features.balloons)
        return {
            **SCOPE, "read_params": read_params, "read_numbers": numbers_reader(step.features.columns),
            **types, **called,
        }  # fmt: skip


def head(name: str, arguments: Mapping[str, str], remark: str) -> list[str]:
    """Return the lines with which a kernel begins."""
    return [f"def {name}(", *(f"    {each}: {kind}," for each, kind in arguments.items()), "):", f'    """{remark}"""']


def named_in(lines: Iterable[str], arguments: Mapping[str, str]) -> dict[str, str]:
    """Return the arguments that lines name."""
    named = set(re.findall(r"\w+", "\n".join(lines)))
    return {name: kind for name, kind in arguments.items() if name in named}


def written_types(step: Step) -> dict[str, Any]:
    """Return the types of all values."""
    written = {value: dtype for piece in step.pieces for phase in piece.phases for value, dtype in phase.writes.items()}
    return values_of(step) | {each.name: each.type for each in step.features.keeps} | written

"""Writers of kernels: a list of phases cut into pieces at barriers, the call of a phase, and traces of calls.

The few items of a block that a rare phase acts on are a list that all threads share. Otherwise a warp in which one
particle touches an obstacle takes as long as if all did. Two lengths take turns, so that one can be cleared while the
other is read.

A trace has the phases between two barriers in single assignment. A value that is written again, such as a velocity, has
a name of its own each time: `velocity`, as it is before, `velocity_1`, `velocity_2`. So it can be told by which of them
each phase is derived.
"""

import inspect
import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.compose import Clock, numbers_reader, params_functions, ramp_at, time_in_frame_of, time_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.areas import volume_origin
from balloon_warp.kernels.loops.spheres import spheres_in_state
from balloon_warp.kernels.memory import put_vector_in, two_in, vector_in
from balloon_warp.kernels.phase import STATE, VIEWS, Access, Adjoint, Item, NoAdjointError, Phase
from balloon_warp.kernels.tables import NAMED, Tables, WorldState, sphere_number
from balloon_warp.kernels.warps import count_at, next_in_block, put_count, shared_words
from balloon_warp.kernels.working import Working

LENGTHS = wp.constant(2)


class Compaction(NamedTuple):
    """Hold the functions of a list; `turn` says which length counts, 0 or 1."""

    clear: Any
    """(turn)"""
    note: Any
    """(turn, item): in any order"""
    count: Any
    """(turn): how many are noted, once a barrier has come"""
    at: Any
    """(place): the item there"""


@cache
def compaction(name: str, capacity: int) -> Compaction:
    """Return the functions of a list of up to so many items."""
    words = shared_words(f"items of {name}", capacity + int(LENGTHS))

    @wp.func
    def clear(turn: wp.int32):
        put_count(words(), turn, 0)

    @wp.func
    def note(turn: wp.int32, item: wp.int32):
        put_count(words(), LENGTHS + next_in_block(words(), turn), item)

    @wp.func
    def count(turn: wp.int32):
        return count_at(words(), turn)

    @wp.func
    def at(place: wp.int32):
        return count_at(words(), LENGTHS + place)

    return Compaction(clear, note, count, at)


class Piece(NamedTuple):
    """Hold phases that one thread executes, one after the other."""

    phases: tuple[Phase, ...]
    once: bool
    """Whether the pieces are for the first substep of a frame only"""
    takes: tuple[str, ...]
    """Values that the piece reads and earlier pieces have written"""
    leaves: tuple[str, ...]
    """Values that the piece writes and later ones read"""
    moves: tuple[str, ...]
    """State of a particle that the piece writes"""
    keeps: tuple[str, ...]
    """Values that the piece writes and items keep"""
    doubles: tuple[str, ...]
    """State that others read meanwhile: it is double-buffered, one buffer to read and one to write"""

    @property
    def name(self) -> str:
        """Return the name of its kernel."""
        first, last = self.phases[0].name, self.phases[-1].name
        whose = "balloon" if self.sums else "world" if self.item == "team" else self.item
        return f"{whose}s_{first}" if first == last else f"{whose}s_{first}_to_{last}"

    @property
    def item(self) -> Item:
        """Return the kind of item that the piece belongs to."""
        return self.phases[0].item

    @property
    def last(self) -> bool:
        """Return whether the piece is executed only at a frame's end."""
        return self.phases[0].last

    @property
    def sums(self) -> bool:
        """Return whether a block sums the results of its items over their balloon."""
        return self.phases[0].sums


class Step(NamedTuple):
    """Hold the phases that a scene has, in pieces, for a schedule that launches them."""

    features: Features
    access: Access
    pieces: tuple[Piece, ...]
    light: tuple[Phase, ...]
    """Phases that are recomputed wherever their values are read"""
    apart: frozenset[str] = frozenset()
    """Names of phases that begin a piece anyway"""

    def owner(self, value: str) -> Item:
        """Return the kind of items that have a value."""
        phase = self.writer(value)
        return "balloon" if phase.sums else phase.item

    def writer(self, value: str) -> Phase:
        """Return the first phase that writes a value."""
        return next(phase for piece in self.pieces for phase in piece.phases if value in phase.writes)

    @property
    def kept(self) -> tuple[str, ...]:
        """Return the values that live from one piece to another."""
        return tuple(dict.fromkeys(value for piece in self.pieces for value in piece.leaves))

    @property
    def doubled(self) -> tuple[str, ...]:
        """Return the state of particles that has two places."""
        return tuple(dict.fromkeys(name for piece in self.pieces for name in piece.doubles))


def cut(
    phases: Sequence[Phase],
    features: Features,
    access: Access,
    *,
    doubles: bool = True,
    apart: Collection[str] = (),
    sums_along: bool = False,
    shown: Collection[str] = (),
) -> Step:
    """Cut the phases that a scene has into pieces.

    Args:
        doubles: whether state may have a second place, where otherwise a barrier would be needed.
        apart: names of phases that begin a piece anyway.
        sums_along: whether those who add up may do so as they go, at the end of a piece; otherwise a sum begins one,
            and who adds up goes on with the balloon.
        shown: values that somebody reads afterwards.

    Raises:
        TypeError: a phase changes state that has no name, see `Phase.changes`, or is named like what another reads.
    """
    named = {name for phase in phases for name in phase.reads(features, access)}
    for phase in phases:
        phase.changes(features, access)
        if phase.name in named:
            raise TypeError(f"the phase {phase.name} is named like what another reads; expected a name of its own")
    light = tuple(phase for phase in phases if phase.light)
    groups: list[list[Phase]] = []
    for phase in phases:
        if phase.light:
            continue
        if not groups or phase.name in apart or not _goes_on(groups[-1], phase, features, access, doubles, sums_along):
            groups.append([])
        groups[-1].append(phase)
    read = [_read(group, light, features, access) for group in groups]
    pieces = [
        _piece(group, read[place], set(shown).union(*read[place + 1 :], *read[:place]), features, access)
        for place, group in enumerate(groups)
    ]
    return Step(features, access, tuple(pieces), light, frozenset(apart))


def _goes_on(
    group: Sequence[Phase], phase: Phase, features: Features, access: Access, doubles: bool, sums_along: bool
) -> bool:
    """Return whether the thread that executes a group may go on with a phase."""
    first = group[0]
    if phase.once(features) != first.once(features) or phase.last != first.last:
        return False
    if any(each.sums for each in group):
        return not sums_along and phase.item == "balloon"
    if phase.sums and not sums_along:
        return False
    if first.item in ("particle", "face"):
        written = {name for each in group for name in each.writes}
        looked_at = {name for each in group for name in each.views(features, access)}
        places = features.kept if doubles else STATE | features.kept
        waits = phase.views(features, access) & written or places.keys() & phase.writes.keys() & looked_at
        waits = waits or _of_others(group, features, access) & phase.reads_state(features, access)
        return phase.item == first.item and (phase.item == "particle" or phase.sums) and not waits
    small = ("world", "balloon")
    return first.item in small and phase.item in small


def _of_others(group: Sequence[Phase], features: Features, access: Access) -> set[str]:
    """Return the names of the state of other items that a group changes, see `tables.NAMED`."""
    changed = {name for phase in group for name in phase.changes(features, access)}
    return {name for name in changed if NAMED[name].item != group[0].item}


def _read(group: Sequence[Phase], light: Sequence[Phase], features: Features, access: Access) -> set[str]:
    """Return the inputs of a group that it has not written itself, with those of light phases that write them."""
    found: set[str] = set()
    written: set[str] = set()
    for phase in group:
        found |= _with_light(phase.reads(features, access), light, features, access) - written
        written |= phase.writes.keys()
    return found


def _with_light(names: Collection[str], light: Sequence[Phase], features: Features, access: Access) -> set[str]:
    """Return names, with the inputs of light phases that write them; of a view, the value that is seen."""
    found: set[str] = set()
    to_see = list(names)
    views = VIEWS | features.kept_views
    while to_see:
        name = to_see.pop()
        found.add(views.get(name, name))
        for phase in light:
            if name in phase.writes:
                to_see += phase.reads(features, access)
    return found


def _piece(
    group: Sequence[Phase], read: set[str], read_elsewhere: set[str], features: Features, access: Access
) -> Piece:
    written = tuple(dict.fromkeys(name for phase in group for name in phase.writes))
    values = tuple(name for name in written if name not in STATE and name not in features.kept)
    looked_at: set[str] = set().union(*(phase.views(features, access) for phase in group))
    moves = tuple(name for name in written if name in STATE)
    return Piece(
        tuple(group),
        group[0].once(features),
        takes=tuple(sorted(read)),
        leaves=tuple(name for name in values if name in read_elsewhere),
        moves=moves,
        keeps=tuple(name for name in written if name in features.kept),
        doubles=tuple(name for name in moves if name in looked_at),
    )


def values_of(step: Step) -> dict[str, Any]:
    """Return the types of the values that are kept."""
    return {value: step.writer(value).writes[value] for value in step.kept}


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
        asked = inspect.signature(phase.asked(self.step.features, self.step.access).func).parameters
        for name in asked:
            self.need(name)
        return f"{phase.name}_may_act({', '.join(map(self.bound, asked))})"

    def reads(self, phase: Phase) -> list[str]:
        """Return the names that a phase reads, by the writer's own names."""
        return [self.aliases.get(name, name) for name in phase.reads(self.step.features, self.step.access)]

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
        called = {phase.name: phase.function(step.features, step.access) for phase in (*phases, *step.light)}
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


class Entry(NamedTuple):
    """Hold a phase with the values that it reads and writes."""

    phase: Phase
    adjoints: tuple[Adjoint, ...]
    reads: dict[str, str]
    """Variables by the names that the phase reads"""
    writes: dict[str, str]
    """Variables by the names that it writes"""
    seen: dict[str, str]
    """Variables by the names that its adjoints read"""


@dataclass(eq=False)
class Trace:
    """Phases of one kind of items, one after the other."""

    step: Step
    item: str
    phases: Sequence[Phase]
    entries: list[Entry] = field(default_factory=list)
    current: dict[str, str] = field(default_factory=dict)
    """Variables that hold each name at the end"""

    def __post_init__(self) -> None:
        for phase in self.phases:
            self._add(phase)

    def writer(self, variable: str) -> Entry | None:
        """Return the entry that writes a variable; None for one that is there as the phases begin."""
        return next((entry for entry in self.entries if variable in entry.writes.values()), None)

    @property
    def written(self) -> set[str]:
        """Return the names that its phases write, and others may read."""
        return {name for phase in self.phases for name in phase.writes}

    def _add(self, phase: Phase) -> None:
        step = self.step
        reads = {name: self._read(name) for name in phase.reads(step.features, step.access)}
        adjoints = tuple(phase.adjoints(step.features, step.access))
        asked = {name for adjoint in adjoints for name in (*arguments_of(adjoint), *adjoint.of) if not is_bar(name)}
        seen = {name: self._read(name) for name in sorted(asked - phase.writes.keys() - reads.keys())}
        writes = {name: self._next(name) for name in phase.writes}
        self.entries.append(Entry(phase, adjoints, reads, writes, {**writes, **seen, **reads}))
        self.current.update(writes)

    def _read(self, name: str) -> str:
        """Return the variable of a name, once light values have been found again."""
        if name not in self.current:
            for phase in self.step.light:
                if name in phase.writes and phase.adjoints(self.step.features, self.step.access):
                    self._add(phase)
        return self.current.get(name, name)

    def _next(self, name: str) -> str:
        times = sum(name in entry.writes for entry in self.entries)
        return f"{name}_{times + 1}"


def arguments_of(adjoint: Adjoint) -> tuple[str, ...]:
    """Return the names of an adjoint's arguments."""
    return tuple(inspect.signature(adjoint.function.func).parameters)


def is_bar(name: str) -> bool:
    """Return whether a name is that of a derivative, or of a view of them."""
    return name.endswith(("_bar", "_bars"))


def reads_neighbor_bars(adjoint: Adjoint) -> bool:
    """Return whether an adjoint wants the bars of others."""
    return any(name.endswith("_bars") for name in arguments_of(adjoint))


def traces_of(step: Step) -> tuple[Trace, ...]:
    """Cut a step where particles wait for balloons, or balloons for particles.

    Raises:
        NoAdjointError: a phase of the step has no adjoint.
    """
    groups: list[list[Phase]] = []
    for phase in (each for piece in step.pieces for each in piece.phases):
        if phase.keeps:
            raise NoAdjointError(f"`{phase.name}`, which keeps values from substep to substep,")
        try:
            phase.adjoints(step.features, step.access)
        except NoAdjointError as missing:
            of_what = "" if str(missing) == phase.name else f" of {missing}"
            raise NoAdjointError(f"`{phase.name}`{of_what}") from None
        if phase.once(step.features):
            continue  # as a frame begins
        if not groups or groups[-1][0].item != phase.item:
            groups.append([])
        groups[-1].append(phase)
    return tuple(Trace(step, group[0].item, group) for group in groups)

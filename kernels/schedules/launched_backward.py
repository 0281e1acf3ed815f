"""A list of phases backwards, as launches: the source of kernels that find derivatives, in their order.

Each phase brings its adjoint. The writer knows only this: a value that all particles of a balloon read has the sum of
their bars; a sum hands its bar to all; and values read of other particles come back through their bars, once all have
them. Results of the forward pass are read where they were stored, or else recomputed.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any, ClassVar, NamedTuple, TypeVar

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.compose import kernel_from
from balloon_warp.kernels.phase import NOT_DIFFERENTIATED, STATE, Adjoint, constants_of
from balloon_warp.kernels.schedules.launched import OFFSETS, PieceWriter
from balloon_warp.kernels.schedules.writer import (
    Entry,
    Step,
    Trace,
    arguments_of,
    head,
    named_in,
    reads_neighbor_bars,
    traces_of,
    written_types,
)

Turn = tuple[Entry, Adjoint]
BARS = {
    "load": "wp.array2d[wp.vec2]", "pressure": "wp.array2d[float]", "gas_mass": "wp.array2d[float]",
    "keyed": "wp.array2d[wp.vec2]", "gas": "wp.array2d[wp.vec2]", "slope": "wp.array2d[float]",
}  # fmt: skip
"""Types of the bars of inputs that no phase writes as a value. That of a keyframed value comes with its product with
the time in the frame, and that of a slope is of the flow through tubes"""


class Sinks:
    """Sums of bars that have been begun, in the order in which a step runs backwards.

    Args:
        load_carried: whether the pressure of the substep before is read, too.
    """

    def __init__(self, load_carried: bool):
        self.begun = {"load"} if load_carried else set[str]()

    def sign(self, name: str) -> str:
        """Return how a bar is written: added to the one that is there, or in place of the one that was."""
        begun = name in self.begun
        self.begun.add(name)
        return "+=" if begun else "="


class Stretch(NamedTuple):
    """Turns of a trace that one kernel runs backwards."""

    turns: Sequence[Turn]
    left: Sequence[Turn]
    """Turns of the trace that later kernels run"""
    after_note: bool
    """Whether it is of phases that read the pressure of this substep, not of the one before"""


class BackwardWriter(PieceWriter):
    """Write one kernel of a trace backwards."""

    aliases: ClassVar = {"springs": "working"}

    def __init__(
        self, trace: Trace, stretch: Stretch, done: set[str], sinks: Sinks, columns: Sequence[int], external: set[str]
    ):
        super().__init__(trace.step)
        self.known.add("time_in_frame")
        self.trace, self._done, self.sinks = trace, done, sinks
        self.turns, self.left, self.after_note = stretch
        self.columns, self.external = columns, external
        """Columns of the numbers that are derived by; values that later phases read"""
        self.bars: dict[str, str] = {}
        """Names by the variables whose bars are known here"""
        self.called: dict[str, Any] = {}

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        first, last = (self.turns[place][0].phase.name for place in (0, -1))
        return f"{self.trace.item}s_{first}_back" if first == last else f"{self.trace.item}s_{first}_back_to_{last}"

    def written(self) -> tuple[str, ...]:
        """Return the lines of the body."""
        self.open()
        for entry, adjoint in self.turns:
            self._turn(entry, adjoint)
        self._sink()
        return tuple(self.lines)

    def open(self) -> None:
        """Write whose thread it is, and of a balloon the sum of the bars that its particles have found."""
        if self.trace.item == "particle":
            self._begin("world, particle")
            return
        self._begin("world, balloon, thread")
        self.line("total = wp.vec2()")
        begin, end = f"{OFFSETS['particle']}[balloon]", f"{OFFSETS['particle']}[balloon + 1]"
        self.line(f"for particle in range({begin} + thread, {end}, wp.block_dim()):")
        self.line("    total += all_load_bar[world, particle]")
        self.line("load_bar = wp.tile_sum(wp.tile(total, preserve_type=True))[0]")
        self.known.add("load_bar")
        self.line("if thread == 0:")
        self.indent = "        "
        self.sinks.begun.discard("load")

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        if name == "constants":
            return "", "constants_of(t)"
        if name == "pressure_bar":
            return "", self.bar_at("pressure", "balloon")
        if name == "slope_bar":
            return "", self.bar_at("slope", "balloon")
        if name == "gas_after_bar":
            return "", "all_gas_bar[world, balloon]"
        if name.endswith("_bars"):
            return "", f"all_{name[:-1]}[world]"
        if name == "keyed" and self.trace.item == "balloon":
            return "", "ramp_at(state, world, balloon, time_in_frame)"
        return super().found(name)

    def have(self, variable: str) -> str:
        """Bind a variable, and return it."""
        variable = self.aliases.get(variable, variable)
        entry = self.trace.writer(variable)
        if variable in self.known:
            return variable
        if entry is None:
            self.need(variable)
            return variable
        (name,) = (name for name, each in entry.writes.items() if each == variable)
        if name in self.step.kept and not entry.phase.light:
            self.known.add(variable)
            self.line(f"{variable} = {self.noted(name, self._owner(name))}")
            return variable
        inputs = [self.have(each) for each in entry.reads.values()]
        self.called[entry.phase.name] = entry.phase.function(self.step.features, self.step.access)
        self.line(f"{', '.join(entry.writes.values())} = {entry.phase.name}({', '.join(inputs)})")
        self.known |= set(entry.writes.values())
        return variable

    def _owner(self, name: str) -> str:
        owner = self.step.owner(name)
        if owner == "balloon":
            self.need("balloon")
        return owner

    def _turn(self, entry: Entry, adjoint: Adjoint) -> None:
        """Call an adjoint, and add up its results."""
        phase = entry.phase
        function = f"{phase.name}_adjoint_{entry.adjoints.index(adjoint) + 1}"
        self.called[function] = adjoint.function
        texts = [self._told(entry, name) for name in arguments_of(adjoint)]
        results = [f"{function}_{name}" for name in adjoint.of]
        self.line(f"# Backwards: {phase.summary}")
        self.line(f"{', '.join(results)} = {function}({', '.join(texts)})")
        for name, result in zip(adjoint.of, results, strict=True):
            self._add(entry.seen[name], name, result)

    def _told(self, entry: Entry, name: str) -> str:
        """Return the text of an argument of an adjoint."""
        if name.endswith("_bar") and name[:-4] in entry.writes:
            return self._bar(entry.writes[name[:-4]], name[:-4])
        if name.endswith(("_bar", "_bars")) or name in ("constants",):
            self.need(name)
            return name
        return self.have(entry.seen[name])

    def _bar(self, variable: str, name: str) -> str:
        """Return the bar of a variable that a phase of the trace has written."""
        if variable not in self.bars:
            self.line(f"{variable}_bar = {self._begun(variable, name) or self._zero(name)}")
            self.bars[variable] = name
        return f"{variable}_bar"

    def _begun(self, variable: str, name: str) -> str:
        """Return the part of a bar that other kernels have found, or "" if none."""
        if self.trace.writer(variable) is None:
            return ""
        last = self.trace.current[name] == variable
        outside = last and (name in STATE or name in self.external)
        if variable in self._done or outside:
            owner = self.trace.item if name in STATE else self._owner(name)
            return self.bar_at(name, owner)
        return ""

    def _zero(self, name: str) -> str:
        dtype = written_types(self.step)[name] if name not in STATE else wp.vec3
        return "float(0.0)" if dtype is float else "wp.vec3()" if dtype is wp.vec3 else f"{name}_type()"

    def _add(self, variable: str, name: str, result: str) -> None:
        """Add to the bar of a variable."""
        if name in ("params", "numbers"):
            self._add_numbers(result)
        elif name in self.step.features.columns.places:
            self._add_number(name, result)
        else:
            before = f"{variable}_bar" if variable in self.bars else self._begun(variable, name)
            self.bars[variable] = name
            self.line(f"{variable}_bar = {before} + {result}" if before else f"{variable}_bar = {result}")

    def _add_number(self, name: str, result: str) -> None:
        """Add the bar of a number by its name, if it is asked for."""
        column = self.step.features.columns.places[name]
        if column in self.columns:
            self.add_to_number(self.columns.index(column), result)

    def _add_numbers(self, result: str) -> None:
        """Add the bars of the numbers that are asked for, and of a mass, which is one of them."""
        of_balloon = self.trace.item == "balloon"
        mass = self.step.features.columns.places["mass"]
        for place, column in enumerate(self.columns):
            text = f"{result}[{column}]" if of_balloon else f"{result}.n[{column}]"
            if column == mass and not of_balloon:
                text += f" + {result}.mass * params.share"
            self.add_to_number(place, text)

    # ---- where bars stand

    row = "world"
    """Index of the results of the way forward"""

    def noted(self, name: str, owner: str) -> str:
        """Return the text that finds a note of the way forward on an item or its balloon."""
        return f"all_{name}[{self.row}, {owner}]"

    def bar_at(self, name: str, owner: str) -> str:
        """Return the text that finds a bar that others have found, of an item or of its balloon."""
        return f"all_{name}_bar[world, {owner}]"

    def put_bar(self, name: str, owner: str, sign: str, text: str) -> None:
        """Write a bar to where others find it, or add to it."""
        self.line(f"all_{name}_bar[world, {owner}] {sign} {text}")

    def add_to_number(self, place: int, text: str) -> None:
        """Add to the bar of a number that is asked for."""
        of_balloon = self.trace.item == "balloon"
        array = "number_bars_of_balloons[world, balloon" if of_balloon else "number_bars[world, particle"
        self.line(f"{array}, {place}] += {text}")

    def add_over_frame(self, name: str, text: str) -> None:
        """Add to the bar of a value that stays the same in a frame."""
        of_balloon = "_of_balloons" if name == "keyed" and self.trace.item == "balloon" else ""
        self.line(f"all_{name}_bar{of_balloon}[world, {self.trace.item}] += {text}")

    def add_keyed(self, bar: str) -> None:
        """Add to the bar of a keyframed value."""
        self.add_over_frame("keyed", f"wp.vec2({bar}, {bar} * time_in_frame)")

    def _sink(self) -> None:
        """Write bars to where others find them."""
        waiting = {
            variable: name for entry, _ in self.left for name, variable in entry.writes.items()
        }  # of which something is left to be found
        for variable, name in self.bars.items():
            if self.trace.writer(variable) is None:
                self._sink_source(name)
            elif variable in waiting:
                self.put_bar(name, self.trace.item, "=", f"{variable}_bar")
                self._done.add(variable)
        for variable, name in waiting.items():
            if name not in STATE and self.step.owner(name) != self.trace.item:
                continue  # a sum, to which nothing has been added yet
            if variable not in self.bars and variable not in self._done and name not in self.external | STATE.keys():
                self.put_bar(name, self.trace.item, "=", self._zero(name))
                self._done.add(variable)
        if not self.left:
            for name in STATE:
                if name in self.trace.current and name not in self.sinks.begun:
                    self.put_bar(name, "particle", self.sinks.sign(name), self._zero(name))

    def _sink_source(self, name: str) -> None:
        """Write the bar of a value that was there as the phases began."""
        if name in NOT_DIFFERENTIATED:
            return
        item = self.trace.item
        if name == "keyed":
            self.add_keyed(f"{name}_bar")
        elif name in ("gas_mass", "gas"):
            self.add_over_frame(name, f"{name}_bar")
        elif name in STATE or name == "load":
            self.put_bar(name, item, self.sinks.sign(name), f"{name}_bar")
        elif name in self.step.kept:
            owner = self._owner(name)
            if owner != item:
                raise TypeError(
                    f"{self.name}: many read {name}, which each balloon has once, and nobody adds up its bar"
                )
            self.put_bar(name, owner, self.sinks.sign(name), f"{name}_bar")
        else:
            raise TypeError(f"{self.name}: nobody takes the bar of {name}")

    def taken(self) -> dict[str, str]:
        """Return the arguments of the kernel."""
        types = written_types(self.step)
        views = {"point": "wp.array2d[wp.vec3]", "velocity": "wp.array2d[wp.vec3]"}
        may_be = {
            "t": "Tables", "time_in_frame": "float", "state": "WorldState", "working": "Working",
            **{f"all_{view}": "wp.array2d[wp.vec3]" for view in STATE.values()},
            **{f"all_{value}": f"wp.array2d[{value}_type]" for value in self.step.kept},
            **{f"all_{value}_bar": f"wp.array2d[{value}_type]" for value in types if value not in STATE},
            **{f"all_{name}_bar": kind for name, kind in (views | BARS).items()},
            "all_keyed_bar_of_balloons": BARS["keyed"],
            "number_bars": "wp.array3d[float]", "number_bars_of_balloons": "wp.array3d[float]",
        }  # fmt: skip
        return named_in(self.lines, may_be)


W = TypeVar("W", bound=BackwardWriter)


class BackwardKernel(NamedTuple):
    """Hold a kernel of a step backwards."""

    name: str
    item: str
    """Item of a thread, or "balloon" for a block of threads"""
    lines: tuple[str, ...]
    arguments: dict[str, str]
    names: dict[str, Any]
    """Names that the text refers to"""
    after_note: bool
    """Whether it is of phases that read the pressure of this substep, not of the one before"""
    meets: str
    """Name of the last phase of a whole world before its own, in which particles have moved; "" if there is none"""

    @property
    def source(self) -> str:
        """Return the kernel's source."""
        whose = "A block for each balloon." if self.item == "balloon" else "A thread for each particle of each world."
        return "\n".join([*head(self.name, self.arguments, whose), *self.lines, ""])


@cache
def made_kernels(step: Step, columns: tuple[int, ...]) -> tuple[Any, ...]:
    """Make the kernels of a step backwards; where they are of particles, a GPU's own division and root will do."""
    return tuple(
        kernel_from(
            each.name, each.source, each.names, module_options={**OPTIONS, "fast_math": each.item == "particle"}
        )
        for each in backward_kernels(step, columns)
    )


@cache
def backward_kernels(step: Step, columns: tuple[int, ...]) -> tuple[BackwardKernel, ...]:
    """Write the kernels of a step backwards.

    Args:
        step: with all that its phases write kept.
        columns: of the balloons' and worlds' numbers, those that are derived by.

    Raises:
        NoAdjointError: a phase of the step has no adjoint.
    """
    kernels: list[BackwardKernel] = []
    for writer in writers_backwards(step, columns, BackwardWriter):
        lines = writer.written()
        names = {**writer.scope([]), **writer.called, "constants_of": constants_of}
        after = writer.after_note
        kernels.append(
            BackwardKernel(
                writer.name, writer.trace.item, lines, writer.taken(), names, after, _met_before(writer.trace)
            )
        )
    return tuple(kernels)


def writers_backwards(step: Step, columns: tuple[int, ...], make: Callable[..., W]) -> Iterator[W]:
    """Yield the writers of a step's turns backwards, between one wait and the next; each writes before the next.

    Raises:
        NoAdjointError: a phase of the step has no adjoint.
    """
    traces = traces_of(step)
    notes = [place for place, trace in enumerate(traces) if _finds_loads(trace)]
    before_note = traces[: notes[0]] if notes else ()
    sinks = Sinks(any("load" in entry.seen for trace in before_note for entry in trace.entries))
    for place, trace in reversed(list(enumerate(traces))):
        external = {name for later in traces[place + 1 :] for entry in later.entries for name in entry.seen.values()}
        sinks.begun -= trace.current.keys() & STATE.keys()
        sinks.begun |= STATE.keys() - trace.current.keys()
        done: set[str] = set()
        cuts = _cut(trace)
        for number, turns in enumerate(cuts):
            left = [turn for later in cuts[number + 1 :] for turn in later]
            after = bool(notes) and place > notes[0]
            yield make(trace, Stretch(turns, left, after), done, sinks, columns, external)


def _met_before(trace: Trace) -> str:
    """Return the name of the last phase of a whole world before a trace, or ""."""
    phases = [phase for piece in trace.step.pieces for phase in piece.phases]
    before = phases[: phases.index(trace.phases[0])]
    return next((phase.name for phase in reversed(before) if phase.item == "team"), "")


def _finds_loads(trace: Trace) -> bool:
    """Return whether the pressures that particles read are of a trace."""
    asked = (arguments_of(adjoint) for entry in trace.entries for adjoint in entry.adjoints)
    return any("load_bar" in names for names in asked)


def _cut(trace: Trace) -> list[list[Turn]]:
    """Return the turns of each kernel: one ends where bars of others are wanted, which it may have added to."""
    cuts: list[list[Turn]] = [[]]
    for entry in reversed(trace.entries):
        for adjoint in entry.adjoints:
            if reads_neighbor_bars(adjoint) and not all(
                each is entry and reads_neighbor_bars(one) for each, one in cuts[-1]
            ):
                cuts.append([])
            cuts[-1].append((entry, adjoint))
    return [turns for turns in cuts if turns]

"""Trace of phases between two barriers, in single assignment: each value is written once.

A value that is written again, such as a velocity, has a name of its own each time: `velocity`, as it is before,
`velocity_1`, `velocity_2`. So it can be told by which of them each phase is derived.
"""

import inspect
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from balloon_warp.kernels.phase import Adjoint, NoAdjointError, Phase
from balloon_warp.kernels.schedules.writer import Step


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
        reads = {name: self._read(name) for name in phase.reads(step.features, step.look)}
        adjoints = tuple(phase.adjoints(step.features, step.look))
        asked = {name for adjoint in adjoints for name in (*arguments_of(adjoint), *adjoint.of) if not is_bar(name)}
        seen = {name: self._read(name) for name in sorted(asked - phase.writes.keys() - reads.keys())}
        writes = {name: self._next(name) for name in phase.writes}
        self.entries.append(Entry(phase, adjoints, reads, writes, {**writes, **seen, **reads}))
        self.current.update(writes)

    def _read(self, name: str) -> str:
        """Return the variable of a name, once light values have been found again."""
        if name not in self.current:
            for phase in self.step.light:
                if name in phase.writes and phase.adjoints(self.step.features, self.step.look):
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


def looks_around(adjoint: Adjoint) -> bool:
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
            phase.adjoints(step.features, step.look)
        except NoAdjointError as missing:
            of_what = "" if str(missing) == phase.name else f" of {missing}"
            raise NoAdjointError(f"`{phase.name}`{of_what}") from None
        if phase.once(step.features):
            continue  # as a frame begins
        if not groups or groups[-1][0].item != phase.item:
            groups.append([])
        groups[-1].append(phase)
    return tuple(Trace(step, group[0].item, group) for group in groups)

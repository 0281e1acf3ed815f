"""A list of phases backwards, as launches: the source of kernels that find derivatives, in the order of their launches.

Each phase brings its adjoint. The writer knows only this: a value that all particles of a balloon read has the sum of
their bars; a sum hands its bar to all; and values read of other particles come back through their bars, once all have
them. Results of the forward pass are read where they were stored, or else recomputed.
"""

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, NamedTuple, TypeVar

from balloon_warp.kernels.adjoints.derived import constants_of
from balloon_warp.kernels.codegen import kernel_from
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phase import STATE
from balloon_warp.kernels.schedules.launched.backward_writer import BackwardWriter, Sinks, Turn
from balloon_warp.kernels.schedules.launched.trace import Trace, arguments_of, looks_around, traces_of
from balloon_warp.kernels.schedules.pieces import Step
from balloon_warp.kernels.schedules.writer import head

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
            yield make(trace, turns, left, done, sinks, columns, external, after)


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
            if looks_around(adjoint) and not all(each is entry and looks_around(one) for each, one in cuts[-1]):
                cuts.append([])
            cuts[-1].append((entry, adjoint))
    return [turns for turns in cuts if turns]

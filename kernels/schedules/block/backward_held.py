"""A frame backwards as one kernel, where each thread of a block keeps its particles: their bars stay in registers.

Values that particles see of each other are put in shared memory just before anyone looks. On a GPU a thread has one
particle, on a CPU the one thread may have them all.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.phase import STATE, VIEWS, Phase
from balloon_warp.kernels.schedules.block.backward import BackwardBlockWriter
from balloon_warp.kernels.schedules.block.backward_items import TurnsInBlock
from balloon_warp.kernels.schedules.block.backward_turns import Turns
from balloon_warp.kernels.schedules.launched.backward import writers_backwards
from balloon_warp.kernels.schedules.launched.trace import arguments_of, looks_around
from balloon_warp.kernels.schedules.writer import written_types

OF_PARTICLE = ("particle", "place", "is_there", "params", "springs", "kept", *STATE)
"""Names that a thread has bound of its particle before turns run backwards"""
OF_FRAME = ("balloon", "origin_place", "ramp", "gas_mass", "inertia", "gain", "gas")
"""Names that may stay the same in a frame"""


class TurnsOfOne(TurnsInBlock):
    """Write turns of a particle that a thread has.

    Args:
        its: names of bars of the particle that are in registers; those that turns write are added.
        known: names that are bound before.
    """

    def __init__(self, its: set[str], known: set[str], *of_block: Any):
        super().__init__(*of_block)
        self.its = its
        self.aliases = {}
        self.known |= known

    def open(self) -> None:
        """Write nothing: a particle is at hand."""
        if self.of_balloon:
            super().open()

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        texts = {
            "numbers": "params.n",
            "origin": self.notes.read("point", "row", "origin_place"),
            "keyed": "ramp[0] + ramp[1] * time_in_frame",
        }
        return ("", texts[name]) if name in texts else super().found(name)

    def noted(self, name: str, owner: str) -> str:
        """Return the variable of a note of the substep, which is read as its turns begin."""
        return name

    def bar_at(self, name: str, owner: str) -> str:
        """Return the text that finds a bar that others have found."""
        if owner == "balloon":
            return super().bar_at(name, owner)
        self.its.add(name)
        return f"its_{name}_bar"

    def put_bar(self, name: str, owner: str, sign: str, text: str) -> None:
        """Write a bar to where others find it, or add to it."""
        if name == "load":
            self.line(f"load_part += wp.where(is_there, {text}, wp.vec2())")
        elif owner == "balloon":
            super().put_bar(name, owner, sign, text)
        else:
            self.its.add(name)
            self.line(f"its_{name}_bar {sign} {text}")

    def its_own(self, text: str, zero: str) -> str:
        """Return a thread's term of a sum; zero where it has no particle."""
        return text if self.of_balloon else f"wp.where(is_there, {text}, {zero})"


class HeldBackwardWriter(BackwardBlockWriter):
    """Write the kernel of a frame backwards for threads that keep particles."""

    @property
    def remark(self) -> str:
        """Return a sentence on the kernel."""
        held = "a particle" if self.layout.held == 1 else f"{self.layout.held} particles"
        return f"A block for each world, for a frame backwards; each of {self.layout.threads} threads has {held}."

    @property
    def _found_again(self) -> tuple[Phase, ...]:
        """Return the phases whose values follow from the notes of a particle: they are found again, not noted.

        A value that a phase changes, such as a force to which it adds, is noted after it.
        """
        phases = (phase for piece in self.step.pieces if piece.item == "particle" for phase in piece.phases)
        step = self.step
        return tuple(
            phase
            for phase in phases
            if not (phase.sums or phase.once(step.features) or phase.last or phase.views(step.features, step.look))
            and phase.writes
            and set(phase.writes) <= set(step.kept) - set(phase.reads(step.features, step.look))
        )

    @property
    def read_back(self) -> list[str]:
        """Return the values of a particle that are noted, besides its state."""
        again = {name for phase in self._found_again for name in phase.writes}
        return [name for name in self._kept_of("particle") if name not in again]

    # ---- backwards

    def _substeps_back(self) -> None:
        its: set[str] = set(STATE)
        bound = {name for name in OF_FRAME if {name, f"{name}_0"} & self.known}
        known = {*OF_PARTICLE, *bound, *self.step.kept}
        make = partial(TurnsOfOne, its, known, self.layout, self.seen, self.noted, self.bars_of_particles)
        turns = [(writer, writer.written()) for writer in writers_backwards(self.turned, self.columns, make)]
        for place in self.places:
            with self.about(place):
                self._begin_its_bars(its)
        self.line("for back in range(t.substeps):")
        with self.indented():
            self._begin_substep_back()
            self._turns(turns, its)
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"if {b('is_there')}:")
                for name in STATE:
                    self.line(f"    put_vector_in(all_{name}_bar, world, {b('particle')}, {b(f'its_{name}_bar')})")

    def _begin_substep_back(self) -> None:
        """Write how a thread reads the notes of the substep."""
        self.line("row = first_row + (t.substeps - 1 - back)")
        self.line("time_in_frame = float(t.substeps - 1 - back) * t.step_seconds")
        for place in self.places:
            with self.about(place):
                for name in (*STATE, *self.read_back):
                    self.line(f"{self.bound(name)} = {self.noted.read(name, 'row', self.bound('particle'))}")
                    self.known.add(self.bound(name))
        for name in self._kept_of("balloon"):
            self.line(f"{name} = all_{name}[row, 0]")
        if self.features.gas:
            self._find_loads()
        for place in self.places:
            with self.about(place):
                self.calls(self._found_again)
        self.line("fetch_notes(notes, row - 1, thread)")

    def _turns(self, turns: Turns, its: set[str]) -> None:
        """Write turns, and before those that look around the values that they see.

        Nobody puts anything there while others still look: a sum in between is a barrier, too.
        """
        looking = [any(map(_sees, writer.turns)) for writer, _ in turns]
        waits = [number for number, (writer, _) in enumerate(turns) if writer.of_balloon]
        looked = False
        for number, (writer, lines) in enumerate(turns):
            if writer.of_balloon:
                looked = False
            if looking[number]:
                if looked:
                    self.line("block_barrier()")
                self._show_its(its)
                self._turn_faces(writer, f"{self.params_of_any()}.n")
                looked = True
            if writer.of_balloon:
                self._turn_balloon(writer, self._numbered(lines, 0, ("params",)))
            else:
                own = {*OF_PARTICLE, *OF_FRAME, *self.step.kept, *(f"its_{name}_bar" for name in its), *_written(lines)}
                for place in self.places:
                    self.lines += self._numbered(lines, place, own - self._common)
            self.called |= writer.called
        first = looking.index(True) if True in looking else len(looking)
        if looked and not any(wait < first for wait in waits):
            self.line("block_barrier()")

    def _show_its(self, its: set[str]) -> None:
        """Write how particles show the values at which others look."""
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"put_in_tile(points, {b('place')}, {b('point')})")
                for name in self.seen:
                    if name in its:
                        self.line(f"put_in_tile({name}_bars, {b('place')}, {b(f'its_{name}_bar')})")
        self.line("block_barrier()")

    def _numbered(self, lines: Sequence[str], place: int, own: Iterable[str]) -> Sequence[str]:
        """Return lines about one of a thread's particles, with its own variables."""
        if not self.are_numbered:
            return lines
        words = re.compile(rf"(?<![.\w])({'|'.join(sorted(own))})\b")
        return [words.sub(rf"\1_{place}", line) for line in lines if not line.lstrip().startswith("#")]

    def _begin_its_bars(self, its: set[str]) -> None:
        """Write the bars of a particle at the end of a frame."""
        types = written_types(self.step)
        for name in sorted(its):
            bar = self.bound(f"its_{name}_bar")
            if name in STATE:
                self.line(f"{bar} = vector_in(all_{name}_bar, world, {self.bound('particle')})")
            else:
                zero = {float: "float(0.0)", wp.vec3: "wp.vec3()"}.get(types[name], f"{name}_type()")
                self.line(f"{bar} = {zero}")


def _written(lines: Iterable[str]) -> Iterator[str]:
    """Yield the variables that lines assign."""
    for line in lines:
        if assigned := re.match(r"\s*([\w, ]+) = ", line):
            yield from assigned[1].split(", ")


def _sees(turn: tuple[Any, Adjoint]) -> bool:
    """Return whether an adjoint looks at other particles."""
    adjoint = turn[1]
    return looks_around(adjoint) or any(name in VIEWS for name in arguments_of(adjoint))

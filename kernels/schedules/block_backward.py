"""A frame backwards as one kernel: a block of threads has a world of one balloon.

One kernel computes the frame again and notes results of its substeps, see `schedules.block`, the other runs them
backwards: so each has the threads and registers that suit it. Threads loop over particles, or keep them, or all find
the same of the one balloon.

Where they loop, bars that others read are in shared memory, and sums over a frame in each thread's registers. Where
each thread keeps its particles, their bars stay in registers, too, and values that particles see of each other are put
in shared memory just before anyone looks. On a GPU a thread has one particle, on a CPU the one thread may have them
all.
"""

import inspect
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import cache, partial
from typing import Any, ClassVar, NamedTuple

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.springs import EIGHT, KINDS, sum_of_lanes
from balloon_warp.kernels.compose import kernel_from
from balloon_warp.kernels.memory import put_vector_in
from balloon_warp.kernels.phase import STATE, VIEWS, Adjoint, Phase, constants_of
from balloon_warp.kernels.schedules.block import AgainWriter, HeldAgainWriter, Notes, RowsWriter
from balloon_warp.kernels.schedules.block_items import COUNTS, block_sum
from balloon_warp.kernels.schedules.block_names import Layout
from balloon_warp.kernels.schedules.launched_backward import BackwardWriter, writers_backwards
from balloon_warp.kernels.schedules.writer import (
    Entry,
    Step,
    arguments_of,
    is_bar,
    reads_neighbor_bars,
    traces_of,
    written_types,
)
from balloon_warp.kernels.warps import Five

KNOWN = ("thread", "first", "balloon", "points", "pulls", "area_vectors")
"""Names that the block has found before, besides handles"""
OVER_FRAME: dict[str, int] = {"keyed": 2, "gas": 2, "gas_mass": 1}
"""Bars that add up over a frame, and how many numbers they have"""
SUM_OF_LOADS = (
    "put_load_bar(thread, Five(load_part[0], load_part[1], 0.0, 0.0, 0.0))",
    "block_barrier()",
    "load_sum = total_load_bar(0)",
    "load_part = wp.vec2()",
    "load_bar = wp.vec2(load_sum[0], load_sum[1])",
)
"""Statements that add up the bars of the load that particles have found"""


class TurnsInBlock(BackwardWriter):
    """Write turns between two barriers.

    Args:
        tiles: names of the bars that stand in shared memory.
        notes: places of the particles' notes.
        bars: places of bars that no other particle sees.
    """

    row: ClassVar[str] = "row"

    def __init__(self, layout: Layout, tiles: Collection[str], notes: Notes, bars: Notes, *of_turns: Any):
        super().__init__(*of_turns)
        self.layout, self.tiles, self.notes, self.bars_of_particles = layout, tiles, notes, bars
        self.results: dict[str, str] = {}
        """Bars of the balloon's values that its turns find"""
        self.sums: list[str] = []
        """Statements of its turns that add up over a frame"""
        self.aliases = {} if any(layout.slots) else {"springs": "working"}
        self.known |= {*KNOWN, *(f"{name}_bars" for name in tiles)}
        self.indent = "        "
        alone = layout.threads == 1 and not layout.held
        self.of_eights = [turn for turn in self.turns if turn[1].of_eight] if alone and "point" in bars else []
        """Turns that one thread does for eight particles at a time"""

    @property
    def of_balloon(self) -> bool:
        """Return whether all threads find the same."""
        return self.trace.item == "balloon"

    def open(self) -> None:
        """Write a loop over particles, or nothing: the sum of the load's bars that they have found comes before."""
        if self.of_balloon:
            self.known.add("load_bar")
            return
        self.line(f"for particle in range(thread, count, {self.layout.threads}):")
        self.indent += "    "
        self.known.add("particle")

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        if name == "springs":
            varying = "read_springs(t, slots, params, particle, True)"
            return "params", varying if self.step.features.springs_vary else "read_pairs(slot_pairs, slots, params)"
        texts = {
            "load": "load_after" if self.after_note else "load_before",
            "params": "read_params_beside(t, first, particle)",
            "numbers": "first.n",
            "velocities": "all_velocities[row]",
            "origin": self.notes.read("point", "row", "volume_origin(t, balloon)"),
        }
        if name in texts:
            return "", texts[name]
        if name == "point":
            return "", "in_tile(points, particle)"
        if name in STATE:
            return "", self.noted(name, "particle")
        if name in self.step.kept:
            return "", self.noted(name, self.step.owner(name))
        return super().found(name)

    def noted(self, name: str, owner: str) -> str:
        """Return the text that finds a note of the substep."""
        return self.notes.read(name, "row") if owner == "particle" else f"all_{name}[row, {owner}]"

    def _turn(self, entry: Entry, adjoint: Adjoint) -> None:
        if (entry, adjoint) not in self.of_eights:
            super()._turn(entry, adjoint)

    # ---- where bars stand

    def bar_at(self, name: str, owner: str) -> str:
        """Return the text that finds a bar that others have found."""
        if owner == "balloon":
            return f"found_{name}_bar"
        if name in self.tiles:
            return f"in_tile({name}_bars, particle)"
        if name in self.bars_of_particles:
            return self.bars_of_particles.read(name, "world")
        return super().bar_at(name, owner)

    def put_bar(self, name: str, owner: str, sign: str, text: str) -> None:
        """Write a bar to where others find it, or add to it."""
        if name == "load":
            self.line(f"load_part += {text}")
        elif owner == "balloon":
            self.results[name] = f"{self.results[name]} + {text}" if sign == "+=" else text
        elif name in self.tiles or name in self.bars_of_particles:
            before = f"{self.bar_at(name, owner)} + " if sign == "+=" else ""
            if name in self.tiles:
                self.line(f"put_in_tile({name}_bars, particle, {before}{text})")
            else:
                self.line(self.bars_of_particles.write(name, "world", before + text))
        else:
            super().put_bar(name, owner, sign, text)

    def line(self, text: str) -> None:
        """Write a line, or keep it for once the frame has run backwards."""
        if self.of_balloon and text.startswith(("over_", "number_")):
            self.sums.append(text)
        else:
            super().line(text)

    def add_to_number(self, place: int, text: str) -> None:
        """Add to the bar of a number that is asked for."""
        self.line(f"number_{place} += {self.its_own(text, 'float(0.0)')}")

    def add_over_frame(self, name: str, text: str) -> None:
        """Add to the bar of a value that stays the same in a frame."""
        zero = "wp.vec2()" if OVER_FRAME[name] == 2 else "float(0.0)"
        self.line(f"over_{name} += {self.its_own(text, zero)}")

    def its_own(self, text: str, zero: str) -> str:
        """Return a thread's term of a sum; zero where it has no particle."""
        return text


FIVE = 5
"""Numbers that threads add up together"""


class SumsOfFrame(RowsWriter):
    """Write sums of bars over a frame."""

    columns: tuple[int, ...] = ()
    """Columns of the numbers that are derived by"""

    def _begin_sums(self) -> None:
        """Write the start values of sums, in each thread."""
        self.line("# Substeps run backwards.")
        for place in range(len(self.columns)):
            self.line(f"number_{place} = float(0.0)")
        for name, size in OVER_FRAME.items():
            self.line(f"over_{name} = {'wp.vec2()' if size == 2 else 'float(0.0)'}")
        self.line("load_part = is_first * all_load_bar[world, 0]")
        self.line("load_before = wp.vec2()")
        self.line("load_after = wp.vec2()")
        self.line("found_pressure_bar = float(0.0)")
        for value in self._kept_of("balloon"):
            self.line(f"found_{value}_bar = {value}_type()")

    def _end_sums(self) -> None:
        """Write the sums over all threads, and where they go."""
        of_frame = {
            "load_part": ("all_load_bar[world, 0]", 2), "over_keyed": ("all_keyed_bar_of_balloons[world, 0]", 2),
            "over_gas": ("all_gas_bar[world, 0]", 2), "over_gas_mass": ("all_gas_mass_bar[world, 0]", 1),
        }  # fmt: skip
        parts = [f"{name}[{n}]" if size > 1 else name for name, (_, size) in of_frame.items() for n in range(size)]
        parts += [f"number_{place}" for place in range(len(self.columns))]
        found = self._summed(parts)
        self.line("if thread == 0:")
        with self.indented():
            self.line("all_pressure_bar[world, 0] = 0.0")
            for place, size in of_frame.values():
                its, found = found[:size], found[size:]
                self.line(f"{place} = {its[0] if size == 1 else f'wp.vec2({its[0]}, {its[1]})'}")
            for place, total in enumerate(found):
                self.line(f"number_bars_of_balloons[world, 0, {place}] = {total}")

    def _summed(self, parts: Sequence[str]) -> list[str]:
        """Write sums over all threads, and return their names."""
        names = []
        for begin in range(0, len(parts), FIVE):
            some = parts[begin : begin + FIVE]
            self.line(f"put_bars(thread, Five({', '.join([*some, *['0.0'] * (FIVE - len(some))])}))")
            self.line("block_barrier()")
            self.line(f"sums_{begin} = total_bars(0)")
            self.line("block_barrier()")
            names += [f"sums_{begin}[{place}]" for place in range(len(some))]
        return names


Turns = Sequence[tuple[TurnsInBlock, tuple[str, ...]]]
"""Writers of the turns between two waits, and their lines"""


class TurnsBesideParticles(SumsOfFrame):
    """Write turns of the balloon and of faces."""

    def __init__(self, kept: Step, layout: Layout):
        super().__init__(kept, layout)
        self.called: dict[str, Any] = {}
        """Functions that turns call, by their names"""
        self.of_kinds = False
        """Whether eight particles at a time add up bars of the constants of springs"""

    def _turn_faces(self, writer: TurnsInBlock, numbers: str) -> None:
        """Write how faces of membranes run backwards, before their particles gather the bars that they leave."""
        for entry, adjoint in writer.turns:
            if adjoint.of_face is None:
                continue
            function = f"{entry.phase.name}_of_face"
            self.called[function] = adjoint.of_face
            told = inspect.signature(adjoint.of_face.func).parameters
            call = f"{function}({', '.join(numbers if name == 'n' else name for name in told)})"
            count = COUNTS["membrane_face"]
            self.line(f"for membrane_face in range(thread, {count}, {self.layout.threads}):")
            self.line(f"    by_numbers = {call}" if self.columns else f"    {call}")
            for place, column in enumerate(self.columns):
                self.line(f"    number_{place} += by_numbers[{column}]")
            self.line("block_barrier()")

    def _turn_eights(self, writer: TurnsInBlock) -> None:
        """Write the turns that a CPU does for eight particles at a time."""
        begin, apart = writer.bars_of_particles.words_of("point") if writer.of_eights else (0, 0)
        given = {"n": "first.n", "found": "bars_of_particles", "row": "world", "kinds": "kinds_bars"}
        given |= {"first_word": str(begin), "apart": str(apart)}
        for number, (entry, adjoint) in enumerate(writer.of_eights):
            function = f"{entry.phase.name}_of_eight_{number + 1}"
            self.called[function] = adjoint.of_eight
            told = inspect.signature(adjoint.of_eight.func).parameters
            self.line(f"# Backwards, eight at a time: {entry.phase.summary}")
            self.line(f"{function}({', '.join(given.get(name, name) for name in told)})")

    def _begin_kinds(self, turns: Turns) -> None:
        """Write where eight particles at a time add up bars of the constants of springs, if they do."""
        self.of_kinds = any(set(KINDS) <= {*adjoint.of} for writer, _ in turns for _, adjoint in writer.of_eights)
        if self.of_kinds:
            self.line(f'kinds_bars = wp.tile_zeros(shape={EIGHT * len(KINDS)}, dtype=float, storage="shared")')

    def _end_kinds(self) -> None:
        """Write the sums of those bars, once a frame has run backwards."""
        for number, name in enumerate(KINDS if self.of_kinds else ()):
            column = self.features.columns.places[name]
            if column in self.columns:
                self.called["sum_of_lanes"] = sum_of_lanes
                self.line(f"number_{self.columns.index(column)} += sum_of_lanes(kinds_bars, {number})")

    def _turn_balloon(self, writer: TurnsInBlock, lines: Sequence[str]) -> None:
        """Write the bars of the balloon's values that follow from those that its particles have found."""
        for line in SUM_OF_LOADS:
            self.line(line)
        self.lines += lines
        for name, text in writer.results.items():
            self.line(f"found_{name}_bar = {text}")
        for text in writer.sums:
            target, added = text.split(" += ")
            self.line(f"{target} += is_first * ({added})")

    def _find_loads(self) -> None:
        """Write the loads by the gas in this substep, and in the one before."""
        self.line("load_now = all_gas_load[row, 0]")
        self.line("load_after = wp.vec2(load_now[1], load_now[2])")
        self.line("load_before = two_in(state.inflation_loads, world, 0)")
        self.line("if back + 1 < t.substeps:")
        self.line("    load_then = all_gas_load[row - 1, 0]")
        self.line("    load_before = wp.vec2(load_then[1], load_then[2])")
        self.line("found_pressure_bar = wp.where(back == 0, all_pressure_bar[world, 0], 0.0)")


class BackwardBlockWriter(TurnsBesideParticles):
    """Write the kernel of a frame backwards.

    Args:
        turned: phases that run backwards.
        kept: the same forward, which keep the values that the others ask for.
    """

    derived = True

    def __init__(self, turned: Step, kept: Step, layout: Layout, columns: tuple[int, ...]):
        super().__init__(kept, layout)
        self.turned, self.columns = turned, columns
        adjoints = [each for trace in traces_of(turned) for entry in trace.entries for each in entry.adjoints]
        seen = {name for each in adjoints for name in arguments_of(each) if is_bar(name) and name.endswith("_bars")}
        self.seen = tuple(sorted(name.removesuffix("_bars") for name in seen))
        """Values whose bars particles see of each other"""
        self.noted = Notes("notes", layout.capacity, self._noted_types())
        self.bars_of_particles = Notes("bars_of_particles", layout.capacity, self._types_of_bars())

    @property
    def read_back(self) -> list[str]:
        """Return the values of a particle that are noted, besides its state."""
        return self._kept_of("particle")

    @property
    def widths(self) -> dict[str, int]:
        """Return how many numbers a row has in each array, by its name."""
        return {"notes": self.noted.words, "bars_of_particles": self.bars_of_particles.words}

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "turn_worlds_back"

    @property
    def remark(self) -> str:
        """Return a sentence on the kernel."""
        return f"A block for each world, for a frame backwards; its {self.layout.threads} threads loop over particles."

    def _arguments(self) -> dict[str, str]:
        bars = dict.fromkeys(STATE, "vec3")
        return {
            **super()._arguments(), "bars_of_particles": "wp.array2d[float]",
            **{f"all_{value}_bar": f"wp.array2d[{value}_type]" for value in written_types(self.step)},
            **{f"all_{name}_bar": f"wp.array2d[wp.{kind}]" for name, kind in bars.items()},
            "all_load_bar": "wp.array2d[wp.vec2]", "all_pressure_bar": "wp.array2d[float]",
            "all_gas_mass_bar": "wp.array2d[float]", "all_keyed_bar_of_balloons": "wp.array2d[wp.vec2]",
            "all_gas_bar": "wp.array2d[wp.vec2]", "number_bars_of_balloons": "wp.array3d[float]",
        }  # fmt: skip

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        self._written()
        loads, totals = (block_sum(name, Five, 1, self.layout.warps) for name in ("load_bar", "bars"))
        return {
            **super().names(), **self.called, "constants_of": constants_of, "Five": Five,
            "put_vector_in": put_vector_in, **self.noted.names(), **self.bars_of_particles.names(),
            "put_load_bar": loads.put, "total_load_bar": loads.total,
            "put_bars": totals.put, "total_bars": totals.total,
        }  # fmt: skip

    # ---- the frame

    def _body(self) -> None:
        self._find_world()
        self._places_of_values()
        self._begin_frame()
        self._begin_sums()
        self._substeps_back()
        self._end_sums()

    def _places_of_values(self) -> None:
        tiles = ("points", *(f"{name}_bars" for name in self.seen))
        self._places_of_rows(tiles)
        self.line("is_first = wp.where(thread == 0, 1.0, 0.0)")

    def _noted_types(self) -> dict[str, Any]:
        """Return the types of the numbers and vectors of particles that rows hold, unless others look at them there."""
        types: dict[str, Any] = {**dict.fromkeys(STATE, wp.vec3), **written_types(self.step)}
        names = [name for name in STATE if not (name == "velocity" and self.shows_velocities)]
        return {name: types[name] for name in (*names, *self.read_back) if types[name] in (float, wp.vec3)}

    def _types_of_bars(self) -> dict[str, Any]:
        """Return the types of the bars of particles that no other particle sees."""
        types = {**dict.fromkeys(STATE, wp.vec3), **written_types(self.step)}
        names = (*STATE, *(name for name in self._kept_of("particle") if name not in self.seen))
        return {name: types[name] for name in names if types[name] in (float, wp.vec3)}

    # ---- backwards

    def _substeps_back(self) -> None:
        make = partial(TurnsInBlock, self.layout, self.seen, self.noted, self.bars_of_particles)
        turns = [(writer, writer.written()) for writer in writers_backwards(self.turned, self.columns, make)]
        self._begin_bars()
        self._begin_kinds(turns)
        self.line("for back in range(t.substeps):")
        with self.indented():
            self.line("row = first_row + (t.substeps - 1 - back)")
            self.line("time_in_frame = float(t.substeps - 1 - back) * t.step_seconds")
            if self.features.gas:
                self._find_loads()
            for number, (writer, lines) in enumerate(turns):
                if writer.of_balloon:
                    self._turn_balloon(writer, lines)
                else:
                    self._turn_particles(writer, lines, first=not number)
                self.called |= writer.called
            self.line("block_barrier()")
        self._end_kinds()
        with self._over("particle"):
            for name in STATE:
                bar = self.bars_of_particles.read(name, "world")
                self.line(f"put_vector_in(all_{name}_bar, world, particle, {bar})")

    def _begin_bars(self) -> None:
        """Write the bars of particles at the end of a frame."""
        with self._over("particle"):
            for name in STATE:
                bar = f"vector_in(all_{name}_bar, world, particle)"
                self.line(self.bars_of_particles.write(name, "world", bar))

    def _turn_particles(self, writer: TurnsInBlock, lines: Sequence[str], first: bool) -> None:
        """Write turns of particles; the first put points where others see them."""
        if any(reads_neighbor_bars(adjoint) for _, adjoint in writer.turns):
            self.line("block_barrier()")
            self._turn_faces(writer, "first.n")
            self._turn_eights(writer)
        if len(lines) == 1 and not first:
            return
        self.lines.append(lines[0])
        if first:
            self.line(f"    put_in_tile(points, particle, {self.noted.read('point', 'row')})")
        self.lines += lines[1:]


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
            if not (phase.sums or phase.once(step.features) or phase.last or phase.views(step.features, step.access))
            and phase.writes
            and set(phase.writes) <= set(step.kept) - set(phase.reads(step.features, step.access))
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
    return reads_neighbor_bars(adjoint) or any(name in VIEWS for name in arguments_of(adjoint))


class Backwards(NamedTuple):
    """Hold the phases and layouts of both kernels."""

    turned: Step
    """Phases that run backwards"""
    kept: Step
    """Phases forward, which keep the values that the others ask for"""
    layout: Layout
    again: Step
    """Phases of a frame that is computed again, on its own layout"""
    layout_again: Layout


def _writer(of: Backwards, columns: tuple[int, ...]) -> BackwardBlockWriter:
    return (HeldBackwardWriter if of.layout.held else BackwardBlockWriter)(of.turned, of.kept, of.layout, columns)


def _writer_again(of: Backwards) -> AgainWriter:
    back = _writer(of, ())
    if of.layout_again.held:
        return HeldAgainWriter(of.again, of.layout_again, back.noted, back.read_back)
    return AgainWriter(of.again, of.layout_again, back.noted)


def _kernel(writer: RowsWriter, layout: Layout) -> Any:
    unroll = 128 if layout.held or any(layout.slots) else 16
    options = {**OPTIONS, "fast_math": True, "max_unroll": unroll}
    source = writer.source()
    return kernel_from(writer.name, source, writer.names(), cuda_max_registers=layout.registers, module_options=options)


@cache
def kernel_backwards(of: Backwards, columns: tuple[int, ...]) -> Any:
    """Make the kernel of a frame backwards."""
    return _kernel(_writer(of, columns), of.layout)


@cache
def kernel_again(of: Backwards) -> Any:
    """Make the kernel of a frame again."""
    return _kernel(_writer_again(of), of.layout_again)


@cache
def widths_of_rows(of: Backwards) -> dict[str, int]:
    """Return how many numbers or vectors a row of each substep has, by the names of arrays."""
    return _writer(of, ()).widths


@cache
def arguments_backwards(of: Backwards, columns: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of the arguments of the kernel backwards."""
    return _writer(of, columns).arguments()


@cache
def arguments_again(of: Backwards) -> tuple[str, ...]:
    """Return the names of the arguments of the kernel of a frame again."""
    return _writer_again(of).arguments()

"""Code of a block for particles and other items, for sums, and for phases of all threads.

Sums over the items of a world are by balloon, and the same to the bit every time: each warp adds up its threads' parts,
in rows of shared memory; whoever wants the sum adds up the rows.
"""

import inspect
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import groupby
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.phase import STATE, Phase
from balloon_warp.kernels.schedules.block_names import Layout, NamesInBlock
from balloon_warp.kernels.schedules.writer import Piece, Step
from balloon_warp.kernels.warps import (
    WARP_THREADS,
    Five,
    of_thread,
    put_warp_sums,
    put_word,
    shared_words,
    sum_of_warp_sums,
    warp_sum,
    word_at,
)


class FewInBlock(NamesInBlock):
    """Write the list of few particles, and the phases for them."""

    def compacted(self, piece: Piece) -> int | None:
        """Return which phase of particles, and all after it, only those go through that it acts on; None if all do.

        The phases read nothing but state that earlier ones have written, and values derived from the point that a
        particle had, see `_from_start`; and items keep nothing.
        """
        if piece.item != "particle" or self.layout.held or piece.leaves or piece.keeps or piece.phases[-1].sums:
            return None
        written: set[str] = set()
        for number, phase in enumerate(piece.phases):
            of_others = {name for each in piece.phases[number:] for name in self.reads(each)} & written
            of_others -= {name for each in self._from_start(piece) for name in each.writes}
            if phase.rare and phase.asked(self.features, self.step.access) and of_others <= STATE.keys():
                return number
            written |= phase.writes.keys()
        return None

    def _from_start(self, piece: Piece) -> tuple[Phase, ...]:
        """Return the phases that read nothing but the point before it moves, which the other tile still has."""
        moving = next((number for number, phase in enumerate(piece.phases) if "point" in phase.writes), 0)
        again = "point" in piece.doubles
        return tuple(phase for phase in piece.phases[:moving] if again and set(self.reads(phase)) == {"point"})

    def _few_items(self, piece: Piece, starts: Sequence[Phase]) -> None:
        """Write the work of threads for the particles that were noted.

        Args:
            starts: phases whose values follow from the points that they had.
        """
        name, threads = piece.phases[0].name, self.layout.threads
        self.line(f"for noted in range(thread, count_of_{name}({self.turn}), {threads}):")
        with self.indented():
            self.line(f"particle = item_of_{name}(noted)")
            self.known.add("particle")
            if starts:
                self.line(f"point = in_tile({self.points[1]}, particle)")
                self.known.add("point")
                self.calls(starts)
                self.known.discard("point")
            self.calls(piece.phases)
            self._put_particle(piece)
        self.line("if thread == 0:")
        self.line(f"    clear_{name}({self.next_turn})")
        self.line("block_barrier()")

    def _note_or_go_on(self, phases: Sequence[Phase]) -> None:
        """Write how an item is noted, if the first of phases may act on it, and otherwise goes through the others."""
        phase, *others = phases
        self.line(f"if {self.may_act(phase)}:")
        self.line(f"    note_{phase.name}({self.turn}, particle)")
        if others:
            self.line("else:")
            with self.indented():
                self.calls(others)

    def _put_particle(self, piece: Piece) -> None:
        """Write the velocity and point that a piece has moved to where they wait."""
        if "velocity" in piece.moves:
            self.line(self.write("velocity", self._target(piece, "velocity")))
        if "point" in piece.moves:
            self.line(f"put_in_tile({self._target(piece, 'point')}, particle, point)")

    def _target(self, piece: Piece, name: str) -> str:
        """Return where a piece writes points, or velocities."""
        places = self.points if name == "point" else self.velocities
        return places[1 if name in piece.doubles else 0]


COUNTS = {
    "particle": "count",
    "face": "t.faces.balloon.shape[0]",
    "triangle": "t.membranes.corners.shape[0]",
    "sphere": "t.spheres.numbers.shape[1]",
    "membrane_face": "t.membranes.membrane_faces.corners.shape[0]",
}
"""Expressions for the number of items in a world"""
BALLOON_OF = {"particle": "t.particles.balloon", "face": "t.faces.balloon"}


class ItemsInBlock(FewInBlock):
    """Write phases of items, by a thread each."""

    def __init__(self, step: Step, layout: Layout, alone: bool | None = None):
        super().__init__(step, layout, step.features.balloons == 1 if alone is None else alone)
        self.deferred: list[Piece] = []
        """Pieces about spheres that are deferred until a later piece needs the moved spheres"""
        self.spheres_moved = False
        self.shows_velocities = any("velocities" in self.reads(phase) for phase in self.phases)
        """Whether other items read velocities, or change them"""

    def _is_deferred(self, piece: Piece) -> bool:
        """Return whether a piece is about spheres alone, once they have moved: it may wait until somebody asks."""
        return all(phase.item == "world" and phase.due is not None for phase in piece.phases)

    def _asks(self, phase: Phase) -> bool:
        return phase.item != "sphere" and "spheres" in self.reads(phase)

    def _settle_spheres(self) -> None:
        """Write the deferred work, before anyone asks where spheres are."""
        if not self.spheres_moved:
            return
        self.spheres_moved = False
        self.line("block_barrier()")
        for piece in self.deferred:
            for phase in piece.phases:
                call = self.call(phase)
                self.line(f"if any_in_block({phase.name}_is_due({self._asked(phase)})):")
                self.line(f"    # {phase.summary}")
                self.line("    if thread == 0:")
                self.line(f"        {call}")
                self.line("    block_barrier()")
        self.deferred.clear()

    def _asked(self, phase: Phase) -> str:
        """Return the arguments of the function that says whether there is anything to do."""
        assert phase.due is not None
        return ", ".join(inspect.signature(phase.due(self.features).func).parameters)

    def _held_particles(self, piece: Piece) -> None:
        summed = self._begin_sum(piece)
        asking = next((number for number, phase in enumerate(piece.phases) if self._asks(phase)), None)
        if asking is not None and self.spheres_moved:  # others get on with the phases before
            for place in self.places:
                with self.about(place):
                    self.calls(piece.phases[:asking])
            self._settle_spheres()
        else:
            asking = 0
        for place in self.places:
            with self.about(place):
                self._calls_and_sum(piece.phases[asking:], summed, self.bound("is_there"))
                self._show_held(piece)
        self._switch(piece)
        self._exchange(piece)
        if not piece.last:
            self._end_sum(summed)

    def _exchange(self, piece: Piece) -> None:
        """Write the halo exchange after a piece: none, where each block has a world of its own."""

    def _show_held(self, piece: Piece) -> None:
        """Write the values that a piece has moved or keeps to where others see them."""
        b = self.bound
        for name in piece.keeps:
            if self._is_seen(name):
                self._put_kept(name)
        if "point" in piece.moves:
            self.line(f"put_in_tile({self._target(piece, 'point')}, {b('place')}, {b('point')})")
        if "velocity" in piece.moves and self.shows_velocities:
            self.line(f"if {b('is_there')}:")
            self.line(f"    put_vector({self._target(piece, 'velocity')}, {b('particle')}, {b('velocity')})")

    def _is_seen(self, name: str) -> bool:
        """Return whether a phase looks at a kept value of others."""
        return any(name in phase.views(self.features, self.step.access) for phase in self.phases)

    def _take_kept(self) -> None:
        """Write how a thread takes the kept values of one of its particles."""
        for name in self.kept_of_particles:
            self.line(f"{self.bound(name)} = kept_{name}[world, {self.bound('particle')}]")
            self.known.add(self.bound(name))

    def _put_kept(self, name: str) -> None:
        """Write a kept value of a thread's particle to where it stays."""
        self.line(f"if {self.bound('is_there')}:")
        self.line(f"    kept_{name}[world, {self.bound('particle')}] = {self.bound(name)}")

    @property
    def kept_of_particles(self) -> tuple[str, ...]:
        """The values that particles keep."""
        return tuple(each.name for each in self.features.keeps if each.item == "particle")

    def _items(self, piece: Piece) -> None:
        """Write the work of threads in a loop over items, whose values then wait in memory."""
        few = self.compacted(piece)
        if few is not None:
            read = {name for phase in piece.phases[few:] for name in self.reads(phase)}
            starts = [phase for phase in self._from_start(piece) if not read.isdisjoint(phase.writes)]
            rest = piece._replace(phases=piece.phases[few:], doubles=())
            self._all_items(piece._replace(phases=piece.phases[:few]), rest.phases)
            self._few_items(rest, starts)
            return
        self._all_items(piece)

    def _all_items(self, piece: Piece, few: Sequence[Phase] = ()) -> None:
        """Write a loop over all items.

        Args:
            few: phases of which the first is left to the items that it may act on, and the others with it.
        """
        item, summed = piece.item, self._begin_sum(piece)
        rounds = summed is not None and not self.alone
        with self._over(item, rounds):
            if summed and item != "particle" and not self.alone:
                self.line(f"balloon = {BALLOON_OF[item]}[{item}]")
                self.known.add("balloon")
            self._calls_and_sum(piece.phases, summed, "is_there" if rounds else "")
            for value in piece.leaves:
                if summed is None or value not in summed.writes:
                    of_particle = item == "particle"
                    self.line(
                        self.write(value, self.home(value)) if of_particle else f"all_{value}[world, {item}] = {value}"
                    )
            for value in piece.keeps:
                self.line(f"{self.kept_at(value)} = {value}")
            if few:
                self._note_or_go_on(few)
            self._put_particle(piece)
        self._switch(piece)
        if item == "sphere":
            self.spheres_moved = True  # who asks waits for a barrier
        elif not piece.last:
            self._end_sum(summed)

    def _switch(self, piece: Piece) -> None:
        """Take notice of where points and velocities are from here on."""
        if "point" in piece.doubles:
            self.points = self.points[::-1]
        if "velocity" in piece.doubles:
            self.velocities = self.velocities[::-1]

    @contextmanager
    def _over(self, item: str, rounds: bool = False) -> Iterator[None]:
        """Loop over items of a world.

        Args:
            rounds: whether all threads go through as many, the last item again where there are no more.
        """
        threads, (begin, count) = self.layout.threads, self._items_of(item)
        if rounds:
            self.line(f"for begin in range(0, {count}, {threads}):")
        else:
            first = f"{begin} + thread" if begin else "thread"
            self.line(f"for {item} in range({first}, {count}, {threads}):")
        with self.indented():
            if rounds:
                self.line(f"is_there = begin + thread < {count}")
                self.line(f"{item} = wp.min(begin + thread, {count} - 1)")
            self.known.add(item)
            yield

    def _items_of(self, item: str) -> tuple[str, str]:
        """Return where a block's items begin, if not at the first, and where they end."""
        return "", COUNTS[item]

    def _begin_sum(self, piece: Piece) -> Phase | None:
        """Write how a sum begins, and return the phase whose values it adds up."""
        last = piece.phases[-1]
        if not last.sums:
            return None
        (value,) = last.writes
        if self.alone:
            self.line(f"part_of_{value} = {_nothing(last)}")
        else:
            self.line(f"clear_{value}(thread)")
        return last

    def _calls_and_sum(self, phases: Iterable[Phase], summed: Phase | None, condition: str) -> None:
        """Write the calls of phases, the last one's value added up.

        Args:
            condition: on which there is such an item.
        """
        self.calls(phase for phase in phases if phase is not summed)
        if summed is None:
            return
        (value,) = summed.writes
        call = self.call(summed)
        self.line(f"# {summed.summary}")
        if self.alone:
            part = f"wp.where({condition}, {call}, {_nothing(summed)})" if condition else call
            self.line(f"part_of_{value} += {part}")
            return
        self.need("balloon")
        part = self.bound(f"part_of_{value}")
        self.line(f"{part} = {call}")
        self.line(f"add_{value}(thread, {self.bound('balloon')}, wp.where({condition}, {part}, {_nothing(summed)}))")

    def _end_sum(self, summed: Phase | None) -> None:
        """Write a barrier, and the sum of each balloon."""
        if summed is None:
            self.line("block_barrier()")
            return
        (value,) = summed.writes
        if self.alone:
            self.line(f"put_{value}(thread, part_of_{value})")
            self.line("block_barrier()")
            self.line(f"{value} = total_{value}(0)")
            self.known.add(value)
            return
        self.line("block_barrier()")
        if self._read_by_particles(value):
            self.line(f"for balloon in range({self._warps_of_balloons}):")
            self.line(f"    {value} = total_{value}(balloon)")
            self.line("    if thread % WARP_THREADS == 0:")
            self.line(f"        all_{value}[world, balloon] = {value}")
            self.line("block_barrier()")

    def _read_by_particles(self, value: str) -> bool:
        pieces = (piece for piece in self.step.pieces if piece.item == "particle")
        return any(value in piece.takes for piece in pieces)

    @property
    def _warps_of_balloons(self) -> str:
        return f"thread // WARP_THREADS, {self.features.balloons}, {self.layout.warps}"


def _nothing(summed: Phase) -> str:
    """Return the start value of a sum."""
    ((value, dtype),) = summed.writes.items()
    return "float(0.0)" if dtype is float else f"{value}_type()"


class GroupsInBlock(ItemsInBlock):
    """Write phases of a whole group: by one thread for all, or by all together."""

    def _worlds(self, piece: Piece) -> None:
        """Write phases of the world and its balloons.

        With one balloon all threads compute the values, so that none waits for them.
        """
        for item, phases in groupby(piece.phases, key=lambda phase: phase.item):
            if item == "balloon" and not self.alone:
                self._over_balloons(tuple(phases))
                continue
            for phase in phases:
                if phase.writes:
                    self.calls((phase,))
                    self._keep_for_all(phase)
                elif phase in self.notes:
                    continue
                else:
                    self._by_one_thread(phase)
            if not self.alone:
                self.line("block_barrier()")
        waits = any(phase.item == "world" for phase in piece.phases) or not piece.phases[0].writes
        if self.alone and waits:
            self.line("block_barrier()")
        self.forget("load")

    def _keep_for_all(self, phase: Phase) -> None:
        """Write the kept values that all threads have found to where one of them stores them, once all have read."""
        if phase.keeps:
            self.line("block_barrier()")
            self.line("if thread == 0:")
            self.lines += [f"{self.indent}    {self.kept_at(name)} = {self.bound(name)}" for name in phase.keeps]
            self.line("block_barrier()")

    def _by_one_thread(self, phase: Phase) -> None:
        call = self.call(phase)
        self.line(f"# {phase.summary}")
        self.line(f"if {self._is_noting()}:")
        self.line(f"    {call}")

    def _is_noting(self) -> str:
        """Return whether a thread is the one that does something for the world."""
        return "thread == 0"

    def _over_balloons(self, phases: tuple[Phase, ...]) -> None:
        """Write the work for each balloon, by a warp of which one thread does it once all have the sums."""
        self.line(f"for balloon in range({self._warps_of_balloons}):")
        with self.indented():
            self.known.add("balloon")
            summed = {value for phase in self.phases if phase.sums for value in phase.writes}
            for value in dict.fromkeys(name for phase in phases for name in self.reads(phase) if name in summed):
                self.line(f"{value} = total_{value}(balloon)")
                self.known.add(value)
            self.line("if thread % WARP_THREADS == 0:")
            with self.indented():
                self.calls(phases)
                for value in (value for phase in phases for value in phase.writes if value in self.step.kept):
                    self.line(f"all_{value}[world, balloon] = {value}")
                for value in (value for phase in phases for value in phase.keeps):
                    self.line(f"{self.kept_at(value)} = {value}")
        self.line("block_barrier()")

    def _springs(self, piece: Piece) -> None:
        """Write the work on springs, color by color, on points and velocities where these are."""
        self.line("colors = t.correction.color_offsets.shape[0] - 1")
        self.line("for color_of_sweep in range(t.correction.sweeps * colors):")
        with self.indented():
            self.line("color = color_of_sweep % colors")
            self.line("begin = t.correction.color_offsets[color] + thread")
            self.line(f"for spring in range(begin, t.correction.color_offsets[color + 1], {self.layout.threads}):")
            with self.indented():
                self.known.add("spring")
                self.calls(piece.phases)
            self.line("block_barrier()")
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"{b('point')} = in_tile({self.points[0]}, {b('place')})")
                self.line(f"{b('velocity')} = vector_at({self.velocities[0]}, {b('particle')})")

    def _team(self, piece: Piece) -> None:
        """Write the work of all threads with points and velocities in arrays, if there is anything to do."""
        (phase,) = piece.phases
        self.line(f"if {phase.name}_is_due({self._asked(phase)}):")
        points, velocities = self.points, self.velocities
        with self.indented():
            self._to_arrays()
            self.line("block_barrier()")
            self.points, self.velocities = ("seen_points", ""), ("seen_velocities", "")
            self.known |= {"seen_points", "seen_velocities"}
            self.calls(piece.phases)
            self.line("block_barrier()")
            self.points, self.velocities = points, velocities
            self._from_arrays()
            self.line("block_barrier()")

    def _to_arrays(self) -> None:
        self.line("seen_points = state.points[world]")
        self.line("seen_velocities = state.velocities[world]")
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"if {b('is_there')}:")
                self.line(f"    put_vector(seen_points, {b('particle')}, {b('point')})")
                self.line(f"    put_vector(seen_velocities, {b('particle')}, {b('velocity')})")
        if not self.layout.held:
            with self._over("particle"):
                self.line(f"put_vector(seen_points, particle, in_tile({self.points[0]}, particle))")
                if self._velocities_wait_elsewhere:
                    self.line(f"put_vector(seen_velocities, particle, {self.read('velocity')})")

    @property
    def _velocities_wait_elsewhere(self) -> bool:
        """Return whether loops find velocities elsewhere than in the state."""
        return "velocity" in self.layout.tiles or self.velocities[0] != "velocities"

    def _from_arrays(self) -> None:
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"if {b('is_there')}:")
                self.line(f"    {b('point')} = vector_at(seen_points, {b('particle')})")
                self.line(f"    {b('velocity')} = vector_at(seen_velocities, {b('particle')})")
                if self.shows_velocities and self._velocities_wait_elsewhere:
                    self.line(f"    put_vector({self.velocities[0]}, {b('particle')}, {b('velocity')})")
                self.line(f"put_in_tile({self.points[0]}, {b('place')}, {b('point')})")
        if not self.layout.held:
            with self._over("particle"):
                self.line(f"put_in_tile({self.points[0]}, particle, vector_at(seen_points, particle))")
                if self._velocities_wait_elsewhere:
                    self.line("velocity = vector_at(seen_velocities, particle)")
                    self.line(self.write("velocity", self.velocities[0]))

    @property
    def notes(self) -> tuple[Phase, ...]:
        """Return the phases that note values that all threads know anyway, for who asks once the frame has ended."""
        if not self.keeps_load or self.features.gas_changes:
            return ()
        behind = (piece for piece in self.step.pieces if piece.item == "balloon" and piece.phases[0].writes)
        return tuple(phase for piece in behind for phase in piece.phases if not phase.writes)


WORDS = 8
"""Number of words that a warp has for a sum"""


class BlockSum(NamedTuple):
    """Hold the functions of a sum; all threads of a warp call each."""

    clear: Any
    """(thread): nothing in the rows of the warp yet"""
    put: Any
    """(thread, part): a thread's part of the one balloon"""
    add: Any
    """(thread, balloon, part): more of a balloon; items stand in the order of their balloons, so that a warp has few"""
    total: Any
    """(balloon): the sum, once a barrier has come"""


@wp.func
def no_number():
    """Return the sum of no numbers."""
    return float(0.0)


@wp.func
def no_five():
    """Return the sum of no vectors."""
    return Five()


@cache
def block_sum(name: str, dtype: Any, balloons: int, warps: int) -> BlockSum:
    """Return the functions of a sum of numbers, or of vectors of five."""
    rows = shared_words(f"sum of {name}", balloons * warps * WORDS)
    is_number = dtype is float

    @wp.func
    def row_of(balloon: wp.int32, warp: wp.int32):
        return (balloon * warps + warp) * WORDS

    @wp.func
    def put_number(first: wp.int32, thread: wp.int32, part: float, added: bool):
        total = warp_sum(part)
        if thread % WARP_THREADS == 0:
            if added:
                total += word_at(rows(), first)
            put_word(rows(), first, total)

    @wp.func
    def put_five(first: wp.int32, thread: wp.int32, part: Five, added: bool):
        put_warp_sums(rows(), first, part, added)

    put_part, nothing = (put_number, no_number) if is_number else (put_five, no_five)

    @wp.func
    def clear(thread: wp.int32):
        for word in range(thread % WARP_THREADS, balloons * WORDS, wp.min(WARP_THREADS, wp.block_dim())):
            put_word(rows(), row_of(word // WORDS, thread // WARP_THREADS) + word % WORDS, 0.0)

    @wp.func
    def put(thread: wp.int32, part: dtype):
        put_part(row_of(0, thread // WARP_THREADS), thread, part, False)

    @wp.func
    def add(thread: wp.int32, balloon: wp.int32, part: dtype):
        for each in range(of_thread(balloon, 0), of_thread(balloon, WARP_THREADS - 1) + 1):
            put_part(row_of(each, thread // WARP_THREADS), thread, wp.where(each == balloon, part, nothing()), True)

    @wp.func
    def total_of_numbers(balloon: wp.int32):
        total = float(0.0)
        for warp in range(warps):
            total += word_at(rows(), row_of(balloon, warp))
        return total

    @wp.func
    def total_of_fives(balloon: wp.int32):
        return sum_of_warp_sums(rows(), row_of(balloon, 0), warps)

    return BlockSum(clear, put, add, total_of_numbers if is_number else total_of_fives)


class StateInBlock(GroupsInBlock):
    """Write how particles come from the state, and go back."""

    def _take_particles(self) -> None:
        if not self.layout.held:
            self.line("first = read_params(t, world, wp.min(thread, count - 1))")
            with self._over("particle"):
                self.line(f"put_in_tile(points, particle, state.points[world, {self.number}])")
                if "velocity" in self.layout.tiles:
                    self.line(f"put_in_tile(velocities, particle, state.velocities[world, {self.number}])")
        for place in self.places:
            with self.about(place):
                self._take_particle(place)
        if self.layout.membrane_face and self.layout.membrane_face.quads:
            self.line(f"membrane_faces = hold_membrane_faces(t, world, {self.params_of_any()}.n, thread)")
        if self.features.spheres:
            self.line(f"spheres = share_spheres(t, state, world, thread, {self.features.penalties})")
        if self.alone:
            with self.about(0):
                for name in ("balloon", "ramp", "origin_place"):
                    self.need(name)
        if self.keeps_load:
            self.line("gas_load = load_in(state, world, balloon)")
            self.known.add("gas_load")

    def _take_particle(self, number: int) -> None:
        """Write how a thread takes one of the particles that it keeps; where there is none, one that does not move."""
        b = self.bound
        self._find_particle(number)
        first_params = self.params_of_any()
        whose = f"read_params(t, world, {b('particle')})"
        if number and self.alone:
            whose = f"read_params_beside(t, {first_params}, {b('particle')})"
        self.line(f"{b('params')} = take_place({whose}, {b('is_there')})")
        kept = "kept" if self.layout.membrane_face else "springs"
        self.line(f"{b(kept)} = read_springs(t, slots, {b('params')}, {b('place')}, {b('is_there')})")
        self.line(f"{b('point')} = state.points[world, {b('particle')}]")
        self.line(f"{b('velocity')} = state.velocities[world, {b('particle')}]")
        self.line(f"put_in_tile(points, {b('place')}, {b('point')})")
        self.known |= {b(name) for name in ("place", "is_there", "particle", "params", kept, "point", "velocity")}
        self._take_kept()

    def _find_particle(self, number: int) -> None:
        """Write which particle a thread takes, and where in the tile."""
        b = self.bound
        self.line(f"{b('place')} = thread" + (f" + {number * self.layout.threads}" if number else ""))
        self.line(f"{b('is_there')} = {b('place')} < count")
        self.line(f"{b('particle')} = wp.min({b('place')}, count - 1)")

    def _put_particles(self) -> None:
        for phase in self.notes:
            self._by_one_thread(phase)
        if self.features.spheres:
            self.line(f"put_spheres(state, world, thread, spheres, {self.features.penalties})")
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"if {b('is_there')}:")
                self.line(f"    state.points[world, {b('particle')}] = {b('point')}")
                self.line(f"    state.velocities[world, {b('particle')}] = {b('velocity')}")
                for name in self.kept_of_particles:
                    self._put_kept(name)
        if not self.layout.held:
            with self._over("particle"):
                self.line(f"state.points[world, {self.number}] = in_tile({self.points[0]}, particle)")
                if self._velocities_wait_elsewhere:
                    self.line(f"state.velocities[world, {self.number}] = {self.read('velocity')}")

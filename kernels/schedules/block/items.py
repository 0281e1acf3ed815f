"""Code of a block for particles and other items, held by threads or looped over, and for sums."""

import inspect
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from balloon_warp.kernels.phase import STATE, Phase
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.names import NamesInBlock
from balloon_warp.kernels.schedules.pieces import Piece, Step

COUNTS = {
    "particle": "count",
    "face": "t.faces.balloon.shape[0]",
    "triangle": "t.membranes.corners.shape[0]",
    "sphere": "t.spheres.numbers.shape[1]",
    "film": "t.membranes.films.corners.shape[0]",
}
"""Expressions for the number of items in a world"""
BALLOON_OF = {"particle": "t.particles.balloon", "face": "t.faces.balloon"}


class ItemsInBlock(NamesInBlock):
    """Write what threads do for items."""

    def __init__(self, step: Step, layout: Layout, alone: bool | None = None):
        super().__init__(step, layout, step.traits.balloons == 1 if alone is None else alone)
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
        """Write what is to be done before anyone asks where spheres are."""
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
        return ", ".join(inspect.signature(phase.due(self.traits).func).parameters)

    def _held_particles(self, piece: Piece) -> None:
        summed = self._begin_sum(piece)
        asking = next((number for number, phase in enumerate(piece.phases) if self._asks(phase)), None)
        if asking is not None and self.spheres_moved:  # others get on with what comes before
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
        """Write what blocks tell each other of what a piece has moved: nothing, where each has a world."""

    def _show_held(self, piece: Piece) -> None:
        """Write what a piece has moved to where others see it."""
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
        """Return whether a phase looks at what others keep."""
        return any(name in phase.views(self.traits, self.step.look) for phase in self.phases)

    def _take_kept(self) -> None:
        """Write how a thread takes what one of its particles keeps."""
        for name in self.kept_of_particles:
            self.line(f"{self.bound(name)} = kept_{name}[world, {self.bound('particle')}]")
            self.known.add(self.bound(name))

    def _put_kept(self, name: str) -> None:
        """Write what a particle that a thread has keeps to where it stays."""
        self.line(f"if {self.bound('is_there')}:")
        self.line(f"    kept_{name}[world, {self.bound('particle')}] = {self.bound(name)}")

    @property
    def kept_of_particles(self) -> tuple[str, ...]:
        """The values that particles keep."""
        return tuple(each.name for each in self.traits.keeps if each.item == "particle")

    def compacted(self, piece: Piece) -> int | None:
        """Return which phase of particles, and all after it, only those go through that it acts on; None if all do.

        Those phases read nothing but state that the ones before have written, and items keep nothing.
        """
        if piece.item != "particle" or self.layout.held or piece.leaves or piece.keeps or piece.phases[-1].sums:
            return None
        written: set[str] = set()
        for number, phase in enumerate(piece.phases):
            of_others = {name for each in piece.phases[number:] for name in self.reads(each)} & written
            if phase.rare and phase.asked(self.traits, self.step.look) and of_others <= STATE.keys():
                return number
            written |= phase.writes.keys()
        return None

    def _items(self, piece: Piece) -> None:
        """Write what threads do in a loop over items, whose values then wait in memory."""
        few = self.compacted(piece)
        if few is not None:
            rest = piece._replace(phases=piece.phases[few:], doubles=())
            self._all_items(piece._replace(phases=piece.phases[:few]), rest.phases[0])
            self._few_items(rest)
            return
        self._all_items(piece)

    def _few_items(self, piece: Piece) -> None:
        """Write what threads do for the particles that were noted."""
        name, threads = piece.phases[0].name, self.layout.threads
        self.line(f"for noted in range(thread, count_of_{name}({self.turn}), {threads}):")
        with self.indented():
            self.line(f"particle = item_of_{name}(noted)")
            self.known.add("particle")
            self.calls(piece.phases)
            self._put_particle(piece)
        self.line("if thread == 0:")
        self.line(f"    clear_{name}({self.next_turn})")
        self.line("block_barrier()")

    def _note(self, phase: Phase) -> None:
        """Write how an item is noted, if a phase may act on it."""
        asked = inspect.signature(phase.asked(self.traits, self.step.look).func).parameters
        for name in asked:
            self.need(name)
        self.line(f"if {phase.name}_may_act({', '.join(map(self.bound, asked))}):")
        self.line(f"    note_{phase.name}({self.turn}, particle)")

    def _put_particle(self, piece: Piece) -> None:
        """Write what a piece has moved to where it waits."""
        if "velocity" in piece.moves:
            self.line(self.write("velocity", self._target(piece, "velocity")))
        if "point" in piece.moves:
            self.line(f"put_in_tile({self._target(piece, 'point')}, particle, point)")

    def _all_items(self, piece: Piece, noting: Phase | None = None) -> None:
        """Write a loop over all items, and note those that a phase may act on."""
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
            self._put_particle(piece)
            if noting:
                self._note(noting)
        self._switch(piece)
        if item == "sphere":
            self.spheres_moved = True  # who asks waits for a barrier
        elif not piece.last:
            self._end_sum(summed)

    def _target(self, piece: Piece, name: str) -> str:
        """Return where a piece writes points, or velocities."""
        places = self.points if name == "point" else self.velocities
        return places[1 if name in piece.doubles else 0]

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
        return f"thread // WARP_THREADS, {self.traits.balloons}, {self.layout.warps}"


def _nothing(summed: Phase) -> str:
    """Return what a sum begins with."""
    ((value, dtype),) = summed.writes.items()
    return "float(0.0)" if dtype is float else f"{value}_type()"

"""Code of a block for particles and other items, held by threads or looped over, and for sums."""

import inspect
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.block.few import FewInBlock
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.pieces import Piece, Step

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
        return any(name in phase.views(self.features, self.step.look) for phase in self.phases)

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

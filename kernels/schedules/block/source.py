"""A list of phases as one kernel: a block of threads advances a world by a frame, with barriers between pieces.

Points stand in shared memory. A thread either keeps a few particles in registers, with all that is known of them, or
loops over particles, whose values then wait in memory from piece to piece.
"""

import inspect
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from itertools import groupby
from typing import Any

import warp as wp

from balloon_warp.kernels.codegen import kernel_from
from balloon_warp.kernels.loops.slots import SlotTable
from balloon_warp.kernels.memory import in_tile, put_in_tile, put_vector, vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import own_beside_function, own_functions
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.looks import reader_of_springs
from balloon_warp.kernels.schedules.block.names import NamesInBlock
from balloon_warp.kernels.schedules.block.sums import block_sum
from balloon_warp.kernels.schedules.pieces import Piece, Step
from balloon_warp.kernels.schedules.writer import head, named_in
from balloon_warp.kernels.spheres import shared_spheres
from balloon_warp.kernels.tables import WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import WARP_THREADS, any_in_block, block_barrier

COUNTS = {
    "particle": "count",
    "face": "t.faces.balloon.shape[0]",
    "triangle": "t.membranes.corners.shape[0]",
    "sphere": "t.spheres.radius.shape[1]",
    "film": "t.membranes.films.corners.shape[0]",
}
"""items of a world"""
BALLOON_OF = {"particle": "t.particles.balloon", "face": "t.faces.balloon"}


class BlockWriter(NamesInBlock):
    """Write the source of the kernel."""

    def __init__(self, step: Step, layout: Layout, alone: bool | None = None):
        super().__init__(step, layout, step.traits.balloons == 1 if alone is None else alone)
        self.deferred: list[Piece] = []
        """pieces about spheres, which nobody has asked for since these have moved"""
        self.spheres_moved = False
        self.shows_velocities = "velocity" in step.doubled or any(piece.item == "spring" for piece in step.pieces)
        """whether others look at velocities, or change them"""

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "advance_worlds"

    def source(self) -> str:
        """Return the text of the kernel."""
        body = self._written()
        return "\n".join([*head(self.name, named_in(body, self._arguments()), self.remark), *body, ""])

    @property
    def remark(self) -> str:
        """Return what the kernel is."""
        held = self.layout.held
        keeps = f"keeps {held} particle{'s' * (held > 1)} in registers" if held else "loops over particles"
        return f"A block for each world, for a frame; each of {self.layout.threads} threads {keeps}."

    def arguments(self) -> tuple[str, ...]:
        """Return the names of what the kernel takes."""
        return tuple(named_in(self._written(), self._arguments()))

    def _arguments(self) -> dict[str, str]:
        return {
            "t": "Tables", "slots": "SlotTable", "state": "WorldState", "working": "Working",
            "second_velocities": "wp.array2d[wp.vec3]", "film_pulls": "wp.array2d[wp.vec3]",
            **{f"all_{value}": f"wp.array2d[{value}_type]" for value in self.step.kept},
        }  # fmt: skip

    def names(self) -> dict[str, Any]:
        """Return what the text refers to."""
        names = {
            **self.scope(phase for piece in self.step.pieces for phase in piece.phases),
            "in_tile": in_tile, "put_in_tile": put_in_tile, "vector_at": vector_at, "put_vector": put_vector,
            "block_barrier": block_barrier, "any_in_block": any_in_block, "WARP_THREADS": WARP_THREADS, "SlotTable": SlotTable,
            "read_own_beside": own_beside_function(self.traits.columns, self.traits.balloons),
            "take_place": place_function(self.traits), "load_in": load_in,
        }  # fmt: skip
        if self.layout.held:
            names["read_springs"] = reader_of_springs(self.traits, self.layout)
        if self.layout.film and self.layout.film.quads:
            names["hold_films"] = self.step.look.films(self.traits).keeps
        if self.traits.spheres:
            names["share_spheres"], names["put_spheres"], _ = shared_spheres(self.traits.spheres)
        for phase in self.phases:
            if phase.due:
                names[f"{phase.name}_is_due"] = phase.due(self.traits)
            if phase.sums:
                (value,) = phase.writes
                functions = block_sum(value, phase.writes[value], self.traits.balloons, self.layout.warps)
                names |= {f"{verb}_{value}": function for verb, function in functions._asdict().items()}
        return names

    def _written(self) -> list[str]:
        """Return the body's lines, without values that nobody reads."""
        if not self.lines:
            self._body()
            self.lines = _read_ones(self.lines)
        return self.lines

    def _body(self) -> None:
        self._find_world()
        if self.traits.frames != "all":
            self.line(f"if working.verdicts[world] {'!=' if self.traits.frames == 'free' else '=='} 0:")
            self.line("    return")
        self._places_of_values()
        self.line("# Particles come from the state.")
        self._take_particles()
        self.line("block_barrier()")
        self._write_pieces(piece for piece in self.step.pieces if piece.once)
        self._keep_once()
        self._substeps()
        self._write_pieces(piece for piece in self.step.pieces if piece.last)
        self.line("# Particles go back to the state.")
        self._put_particles()

    def _find_world(self) -> None:
        """Write whose block it is."""
        self.line("world, thread = wp.tid()")

    def _places_of_values(self) -> None:
        """Write where all of a world's values are."""
        layout, doubled = self.layout, self.step.doubled
        tiles = [*self.points[: 2 if "point" in doubled else 1]]
        tiles += [self.home(name) for name in layout.tiles]
        for tile in tiles:
            self.line(f'{tile} = wp.tile_empty(shape={layout.capacity}, dtype=wp.vec3, storage="shared")')
        if layout.film and layout.film.tile:
            areas = layout.film.tile if layout.film.areas else 1
            self.line(f'pulls = wp.tile_empty(shape={layout.film.tile}, dtype=wp.vec4, storage="shared")')
            self.line(f'area_vectors = wp.tile_empty(shape={areas}, dtype=wp.vec2, storage="shared")')
        elif layout.film:
            self.line("pulls = film_pulls[world]")
            self.line("area_vectors = film_pulls[world]")
        if "velocity" not in layout.tiles:
            self.line("velocities = state.velocities[world]")
            self.line("new_velocities = second_velocities[world]")
        if not layout.held:
            for value in self.step.kept:
                if self.step.owner(value) == "particle" and value not in layout.tiles:
                    self.line(f"each_{value} = all_{value}[world]")
        self.line("count = state.points.shape[1]")
        self.line("frame_begin = time_of(t, state.frame, 0.0)")
        self.line("time_in_frame = float(0.0)")
        self.known.add("time_in_frame")

    def _take_particles(self) -> None:
        if not self.layout.held:
            self.line("first = read_own(t, world, wp.min(thread, count - 1))")
            with self._over("particle"):
                self.line("put_in_tile(points, particle, state.points[world, particle])")
                if "velocity" in self.layout.tiles:
                    self.line("put_in_tile(velocities, particle, state.velocities[world, particle])")
        for place in self.places:
            with self.about(place):
                self._take_particle(place)
        if self.layout.film and self.layout.film.quads:
            self.line(f"films = hold_films(t, world, {self.own_of_any()}.n, thread)")
        if self.traits.spheres:
            self.line("spheres = share_spheres(t, state, world, thread)")
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
        first_own = self.own_of_any()
        whose = f"read_own(t, world, {b('particle')})"
        if number and self.alone:
            whose = f"read_own_beside(t, {first_own}, {b('particle')})"
        self.line(f"{b('own')} = take_place({whose}, {b('is_there')})")
        self.line(f"{b('springs')} = read_springs(t, slots, {b('own')}, {b('place')}, {b('is_there')})")
        self.line(f"{b('point')} = state.points[world, {b('particle')}]")
        self.line(f"{b('velocity')} = state.velocities[world, {b('particle')}]")
        self.line(f"put_in_tile(points, {b('place')}, {b('point')})")
        self.known |= {b(name) for name in ("place", "is_there", "particle", "own", "springs", "point", "velocity")}

    def _find_particle(self, number: int) -> None:
        """Write which particle a thread takes, and where in the tile."""
        b = self.bound
        self.line(f"{b('place')} = thread" + (f" + {number * self.layout.threads}" if number else ""))
        self.line(f"{b('is_there')} = {b('place')} < count")
        self.line(f"{b('particle')} = wp.min({b('place')}, count - 1)")

    def _keep_once(self) -> None:
        """Write what stays the same in a frame, where registers keep it."""
        read = {name for piece in self.step.pieces if not piece.once for name in piece.takes}
        for phase in self.step.light:
            if phase.once(self.traits) and not read.isdisjoint(phase.writes):
                (value,) = phase.writes
                if phase.item == "balloon" and self.alone:
                    self.need(value)
                for place in self.places if phase.item == "particle" else ():
                    with self.about(place):
                        self.need(value)

    def _substeps(self) -> None:
        """Write the loop; where points or velocities have two places, a turn has two substeps."""
        if not self.step.doubled:
            self.line("for substep in range(t.substeps):")
            self._substep("substep")
            return
        self.line("for pair in range(t.substeps // 2):")
        self._substep("2 * pair")
        self._substep("2 * pair + 1")
        if self.layout.odd:
            self.line("if t.substeps % 2 == 1:")
            self._substep("t.substeps - 1")

    def _substep(self, number: str) -> None:
        with self.indented():
            self.line(f"time_in_frame = float({number}) * t.step_seconds")
            self._write_pieces(piece for piece in self.step.pieces if not piece.once and not piece.last)

    @property
    def notes(self) -> tuple[Phase, ...]:
        """Return the phases that note what all threads know anyway, for who asks once the frame has ended."""
        if not self.keeps_load or self.traits.gas_changes:
            return ()
        behind = (piece for piece in self.step.pieces if piece.item == "balloon" and piece.phases[0].writes)
        return tuple(phase for piece in behind for phase in piece.phases if not phase.writes)

    def _put_particles(self) -> None:
        for phase in self.notes:
            self._by_one_thread(phase)
        if self.traits.spheres:
            self.line(f"put_spheres(state, world, thread, spheres, {self.traits.penalties})")
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"if {b('is_there')}:")
                self.line(f"    state.points[world, {b('particle')}] = {b('point')}")
                self.line(f"    state.velocities[world, {b('particle')}] = {b('velocity')}")
        if not self.layout.held:
            with self._over("particle"):
                self.line(f"state.points[world, particle] = in_tile({self.points[0]}, particle)")
                if self._velocities_wait_elsewhere:
                    self.line(f"state.velocities[world, particle] = {self.read('velocity')}")

    # pieces

    def _write_pieces(self, pieces: Iterable[Piece]) -> None:
        for piece in pieces:
            if self._is_deferred(piece):
                self.deferred.append(piece)
                continue
            if not (piece.item == "particle" and self.layout.held) and any(map(self._asks, piece.phases)):
                self._settle_spheres()
            if piece.item == "particle" and self.layout.held:
                self._held_particles(piece)
            elif piece.item in ("world", "balloon"):
                self._worlds(piece)
            elif piece.item == "spring":
                self._springs(piece)
            elif piece.item == "film" and self.layout.film and self.layout.film.quads:
                self.calls(piece.phases)
                self.line("block_barrier()")
            elif piece.item == "team":
                self._team(piece)
            else:
                self._items(piece)

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
        if "point" in piece.moves:
            self.line(f"put_in_tile({self._target(piece, 'point')}, {b('place')}, {b('point')})")
        if "velocity" in piece.moves and self.shows_velocities:
            self.line(f"if {b('is_there')}:")
            self.line(f"    put_vector({self._target(piece, 'velocity')}, {b('particle')}, {b('velocity')})")

    def _items(self, piece: Piece) -> None:
        """Write what threads do in a loop over items, whose values then wait in memory."""
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
            if "velocity" in piece.moves:
                self.line(self.write("velocity", self._target(piece, "velocity")))
            if "point" in piece.moves:
                self.line(f"put_in_tile({self._target(piece, 'point')}, particle, point)")
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

    # sums

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

    # a world's own

    def _worlds(self, piece: Piece) -> None:
        """Write what is done for the world and its balloons. Of one balloon all threads find the values, so that none
        need wait for them."""
        for item, phases in groupby(piece.phases, key=lambda phase: phase.item):
            if item == "balloon" and not self.alone:
                self._over_balloons(tuple(phases))
                continue
            for phase in phases:
                if phase.writes:
                    self.calls((phase,))
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

    def _by_one_thread(self, phase: Phase) -> None:
        call = self.call(phase)
        self.line(f"# {phase.summary}")
        self.line(f"if {self._is_noting()}:")
        self.line(f"    {call}")

    def _is_noting(self) -> str:
        """Return whether a thread is the one that does something for the world."""
        return "thread == 0"

    def _over_balloons(self, phases: tuple[Phase, ...]) -> None:
        """Write what is done for each balloon, by a warp of which one thread does it once all have the sums."""
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
        self.line("block_barrier()")

    def _springs(self, piece: Piece) -> None:
        """Write what is done to springs, color by color, to points and velocities where these are."""
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
        """Write what all threads do with points and velocities in arrays, if there is anything to do."""
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
        """Whether loops find velocities elsewhere than in the state."""
        return "velocity" in self.layout.tiles or self.velocities[0] != "velocities"

    def _from_arrays(self) -> None:
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"if {b('is_there')}:")
                self.line(f"    {b('point')} = vector_at(seen_points, {b('particle')})")
                self.line(f"    {b('velocity')} = vector_at(seen_velocities, {b('particle')})")
                self.line(f"put_in_tile({self.points[0]}, {b('place')}, {b('point')})")
        if not self.layout.held:
            with self._over("particle"):
                self.line(f"put_in_tile({self.points[0]}, particle, vector_at(seen_points, particle))")
                if self._velocities_wait_elsewhere:
                    self.line("velocity = vector_at(seen_velocities, particle)")
                    self.line(self.write("velocity", self.velocities[0]))


def _nothing(summed: Phase) -> str:
    """Return what a sum begins with."""
    ((value, dtype),) = summed.writes.items()
    return "float(0.0)" if dtype is float else f"{value}_type()"


def _read_ones(lines: list[str]) -> list[str]:
    """Return lines without values that no other line reads."""
    while True:
        words = re.findall(r"\w+", "\n".join(line.split("#")[0] for line in lines))
        unread = {word for word in set(words) if words.count(word) == 1}
        kept = [line for line in lines if not ((m := re.match(r"\s*(\w+) = ", line)) and m[1] in unread)]
        if len(kept) == len(lines):
            return lines
        lines = kept


@wp.func
def load_in(state: WorldState, world: wp.int32, balloon: wp.int32):
    """Return what a balloon's gas presses with, as the state has it: see `laws.gas.gas_load`."""
    load = state.inflation_loads[world, balloon]
    return wp.vec4(state.pressures[world, balloon], load[0], load[1], 0.0)


@cache
def place_function(traits: Traits) -> Any:
    """Return the function that makes a particle what a thread has: where there is none, one that does not move."""
    Own, _ = own_functions(traits.columns, traits.balloons)  # noqa: N806 - a type

    @wp.func
    def take_place(own: Own, there: bool):
        if not there:
            own.share = 0.0
            own.mass = 0.0
        return own

    return take_place


@cache
def kernel_of_frame(step: Step, layout: Layout) -> Any:
    """Make the kernel of a list."""
    writer = BlockWriter(step, layout)
    options = {**OPTIONS, "fast_math": True, "max_unroll": 128 if layout.held else 16}
    return kernel_from(
        writer.name, writer.source(), writer.names(), cuda_max_registers=layout.registers, module_options=options
    )


@cache
def arguments_of_frame(step: Step, layout: Layout) -> tuple[str, ...]:
    """Return the names of what the kernel of a list takes."""
    return BlockWriter(step, layout).arguments()


def source_of_frame(step: Step, layout: Layout) -> str:
    """Write the kernel of a list."""
    return BlockWriter(step, layout).source()

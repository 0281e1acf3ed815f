"""A list of phases as one kernel: a block of threads advances a world by a frame.

Barriers stand between pieces. Points stand in shared memory. A thread keeps a few particles in registers, with all that
is known of them, or loops over particles, whose values then wait in memory.

A frame is done again, from its beginning, to note results of its substeps for those that run backwards: the beginning
of each substep, and the values that its particles see of each other. Each substep of each world has a row of words.
Values that others look at stand in an array of their own. A row has a value's first components side by side, then all
second ones: neighboring threads read neighboring words, and the stride of components is known as a kernel is compiled,
so that one address serves them all. They are a line more apart than particles need: an odd number of lines, so that
they do not all fall into the same few sets of a cache.
"""

import re
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.compose import Clock, kernel_from, params_beside_function, params_functions
from balloon_warp.kernels.contact.free_frames import BUSY, FREE
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.spheres import shared_spheres
from balloon_warp.kernels.loops.springs import SlotTable, paired_reader
from balloon_warp.kernels.memory import in_tile, put_in_tile, put_vector, put_vector_in, vector_at
from balloon_warp.kernels.phase import STATE, Item
from balloon_warp.kernels.schedules.block_items import StateInBlock, block_sum
from balloon_warp.kernels.schedules.block_names import Layout, reader_of_springs
from balloon_warp.kernels.schedules.writer import Piece, Step, compaction, head, named_in
from balloon_warp.kernels.tables import WorldState
from balloon_warp.kernels.warps import WARP_THREADS, any_in_block, block_barrier

TURNS = {"substep": ("substep % 2", "1 - substep % 2"), "2 * pair + 1": ("1", "0")}
"""Parities of the numbers of substeps that are not 0, and of the next"""


class BlockWriter(StateInBlock):
    """Write the source of the kernel."""

    derived = False
    """Whether the kernel's results are derived"""

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
        """Return a sentence on the kernel."""
        held = self.layout.held
        keeps = f"keeps {held} particle{'s' * (held > 1)} in registers" if held else "loops over particles"
        time = "round" if self._in_rounds else "frame"
        return f"A block for each world, for a {time}; each of {self.layout.threads} threads {keeps}."

    def arguments(self) -> tuple[str, ...]:
        """Return the names of the kernel's arguments."""
        return tuple(named_in(self._written(), self._arguments()))

    def _arguments(self) -> dict[str, str]:
        return {
            "t": "Tables", "slots": "SlotTable", "state": "WorldState", "working": "Working",
            "second_velocities": "wp.array2d[wp.vec3]", "membrane_face_pulls": "wp.array2d[wp.vec3]",
            "state_numbers": "wp.array[wp.int32]",
            "clock": "Clock", "first_substep": "wp.int32", "round_substeps": "wp.int32",
            **{f"all_{value}": f"wp.array2d[{value}_type]" for value in self.step.kept}, **self.kept_arrays,
        }  # fmt: skip

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        names = {
            **self.scope(phase for piece in self.step.pieces for phase in piece.phases),
            "in_tile": in_tile, "put_in_tile": put_in_tile, "vector_at": vector_at, "put_vector": put_vector,
            "block_barrier": block_barrier, "any_in_block": any_in_block, "WARP_THREADS": WARP_THREADS,
            "SlotTable": SlotTable, "BUSY": BUSY, "FREE": FREE, "Clock": Clock,
            "read_params_beside": params_beside_function(self.features.columns, self.features.balloons),
            "take_place": place_function(self.features), "load_in": load_in,
        }  # fmt: skip
        if self.layout.held or any(self.layout.slots):
            names["read_springs"] = reader_of_springs(self.features, self.layout, self.derived)
        if any(self.layout.slots) and not self.layout.held:
            names["read_pairs"] = paired_reader(self.features, self.layout.slots)
        if self.layout.membrane_face and self.layout.membrane_face.quads:
            names["hold_membrane_faces"] = self.step.access.membrane_faces(self.features).keeps
        if self.features.spheres:
            names["share_spheres"], names["put_spheres"], _ = shared_spheres(self.features.spheres)
        for phase in self.phases:
            if phase.due:
                names[f"{phase.name}_is_due"] = phase.due(self.features)
            if phase.name in self._compacted:
                functions = compaction(phase.name, self.layout.capacity)
                names[f"{phase.name}_may_act"] = phase.asked(self.features, self.step.access)
                names |= {f"{verb}_{phase.name}": getattr(functions, verb) for verb in ("clear", "note")}
                names |= {f"count_of_{phase.name}": functions.count, f"item_of_{phase.name}": functions.at}
            if phase.sums:
                (value,) = phase.writes
                functions = block_sum(value, phase.writes[value], self.features.balloons, self.layout.warps)
                names |= {f"{verb}_{value}": function for verb, function in functions._asdict().items()}
        return names

    @property
    def _in_rounds(self) -> bool:
        """Return whether a launch is for the substeps from one search to the next."""
        return self.features.frames == "clear"

    @property
    def _compacted(self) -> tuple[str, ...]:
        """Return the names of phases that only those items go through on which they act."""
        found = ((piece, self.compacted(piece)) for piece in self.step.pieces)
        return tuple(piece.phases[number].name for piece, number in found if number is not None)

    def _written(self) -> list[str]:
        """Return the body's lines, without values that nobody reads."""
        if not self.lines:
            self._body()
            self.lines = _read_ones(self.lines)
        return self.lines

    def _body(self) -> None:
        self._find_world()
        if self.features.frames != "all":
            self.line(f"if working.verdicts[world] == {'FREE' if self.features.frames == 'busy' else 'BUSY'}: return")
        self._places_of_values()
        self.line("# Particles come from the state.")
        self._take_particles()
        for name in self._compacted:
            self.line("if thread == 0:")
            self.line(f"    clear_{name}(0)")
            self.line(f"    clear_{name}(1)")
        self.line("block_barrier()")
        self._write_pieces(piece for piece in self.step.pieces if piece.once)
        self._keep_once()
        self._forget_times()
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
        self._places_of_membrane_faces()
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

    def _places_of_membrane_faces(self) -> None:
        """Write where faces of membranes leave the forces on their corners, and the area vectors."""
        membrane_face = self.layout.membrane_face
        if membrane_face and membrane_face.tile:
            areas = membrane_face.tile if membrane_face.areas else 1
            self.line(f'pulls = wp.tile_empty(shape={membrane_face.tile}, dtype=wp.vec4, storage="shared")')
            self.line(f'area_vectors = wp.tile_empty(shape={areas}, dtype=wp.vec2, storage="shared")')
        elif membrane_face:
            self.line("pulls = membrane_face_pulls[world]")
            self.line("area_vectors = membrane_face_pulls[world]")

    def _forget_times(self) -> None:
        """Find times anew in each substep: phases that run once a frame have found those of its beginning."""
        for name in ("time", "end"):
            self.forget(name)

    def _keep_once(self) -> None:
        """Write the values that stay the same in a frame, where registers keep them."""
        read = {name for piece in self.step.pieces if not piece.once for name in piece.takes}
        for phase in self.step.light:
            if phase.once(self.features) and not read.isdisjoint(phase.writes):
                (value,) = phase.writes
                if phase.item == "balloon" and self.alone:
                    self.need(value)
                for place in self.places if phase.item == "particle" else ():
                    with self.about(place):
                        self.need(value)

    def _substeps(self) -> None:
        """Write the loop; where points or velocities have two places, a turn has two substeps."""
        count = "round_substeps" if self._in_rounds else "t.substeps"
        if not self.step.doubled:
            self.line(f"for substep in range({count}):")
            self._substep("substep")
            return
        self.line(f"for pair in range({count} // 2):")
        self._substep("2 * pair")
        self._substep("2 * pair + 1")
        if self.layout.odd:
            self.line(f"if {count} % 2 == 1:")
            self._substep(f"{count} - 1")

    def _substep(self, number: str) -> None:
        with self.indented():
            self.turn, self.next_turn = TURNS.get(number, ("0", "1"))
            begin = "clock.done[0] + first_substep + " if self._in_rounds else ""
            self.line(f"time_in_frame = float({begin}{number}) * t.step_seconds")
            self._write_pieces(piece for piece in self.step.pieces if not piece.once and not piece.last)

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
            elif piece.item == "membrane_face" and self.layout.membrane_face and self.layout.membrane_face.quads:
                self.calls(piece.phases)
                self.line("block_barrier()")
            elif piece.item == "team":
                self._team(piece)
            else:
                self._items(piece)


def _read_ones(lines: list[str]) -> list[str]:
    """Return lines without values that no other line reads."""
    words = re.findall(r"\w+", "\n".join(line.split("#")[0] for line in lines))
    unread = {word for word in set(words) if words.count(word) == 1}
    kept = [line for line in lines if not ((m := re.match(r"\s*(\w+) = ", line)) and m[1] in unread)]
    return kept if len(kept) == len(lines) else _read_ones(kept)


@wp.func
def load_in(state: WorldState, world: wp.int32, balloon: wp.int32):
    """Return the load by a balloon's gas, as the state has it: see `laws.gas.gas_load`."""
    load = state.inflation_loads[world, balloon]
    return wp.vec4(state.pressures[world, balloon], load[0], load[1], 0.0)


@cache
def place_function(features: Features) -> Any:
    """Return the function for the parameters of a thread's particle: where there is none, of one that does not move."""
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def take_place(params: Params, there: bool):
        if not there:
            params.share = 0.0
            params.mass = 0.0
        return params

    return take_place


@cache
def kernel_of_frame(step: Step, layout: Layout) -> Any:
    """Make the kernel of a list."""
    w = BlockWriter(step, layout)
    options = {**OPTIONS, "fast_math": True, "max_unroll": 128 if layout.held else 16}
    return kernel_from(w.name, w.source(), w.names(), cuda_max_registers=layout.registers, module_options=options)


@cache
def arguments_of_frame(step: Step, layout: Layout) -> tuple[str, ...]:
    """Return the names of the arguments of a list's kernel."""
    return BlockWriter(step, layout).arguments()


def source_of_frame(step: Step, layout: Layout) -> str:
    """Write the kernel of a list."""
    return BlockWriter(step, layout).source()


class RowsWriter(BlockWriter):
    """Write the common parts of kernels with rows."""

    def _arguments(self) -> dict[str, str]:
        return super()._arguments() | {
            "slot_pairs": "wp.array2d[wp.vec2]", "notes": "wp.array2d[float]", "all_velocities": "wp.array2d[wp.vec3]",
        }  # fmt: skip

    def _kept_of(self, item: Item) -> list[str]:
        """Return the values of particles, or of the balloon, that each substep notes."""
        return [value for value in self.step.kept if self.step.owner(value) == item]

    def _places_of_rows(self, tiles: Iterable[str]) -> None:
        """Write where all of a world's values are.

        Args:
            tiles: vectors of particles in shared memory.
        """
        for tile in tiles:
            self.line(f'{tile} = wp.tile_empty(shape={self.layout.capacity}, dtype=wp.vec3, storage="shared")')
        self._places_of_membrane_faces()
        self.line("count = state.points.shape[1]")
        self.line("first_row = world * (t.substeps + 1)")
        self.line("frame_begin = time_of(t, state.frame, 0.0)")
        self.line("time_in_frame = float(0.0)")
        self.known.add("time_in_frame")

    def _begin_frame(self) -> None:
        """Write the lines before all substeps."""
        self.line("# Particles come from the state.")
        self._take_particles()
        self.line("block_barrier()")
        self._write_pieces(piece for piece in self.step.pieces if piece.once)
        self._keep_once()
        self._forget_times()


WORDS_OF_LINE = 32
"""Words of a line of a GPU's memory"""


class Notes:
    """Places of values in a row.

    Args:
        array: name of the array that holds the rows.
        capacity: particles for which there is room.
        types: numbers and vectors of particles that are noted, by their names.
    """

    def __init__(self, array: str, capacity: int, types: Mapping[str, Any]):
        self._array, self._apart = array, capacity + WORDS_OF_LINE
        self._places: dict[str, tuple[int, int]] = {}
        end = 0
        for name, dtype in types.items():
            size = 1 if dtype is float else 3
            self._places[name] = end, size
            end += size
        self.words = end * self._apart
        """Number of words of a row"""

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def words_of(self, name: str) -> tuple[int, int]:
        """Return where in a row a value's first component begins, and how far apart components are."""
        return self._places[name][0] * self._apart, self._apart

    def read(self, name: str, row: str, place: str = "particle") -> str:
        """Return the text that reads a value of a particle."""
        if name in self:
            return f"{name}_of_{self._array}({self._array}, {row}, {place})"
        array = f"all_{STATE.get(name, name)}"
        return f"vector_in({array}, {row}, {place})" if name in STATE else f"{array}[{row}, {place}]"

    def write(self, name: str, row: str, text: str, place: str = "particle") -> str:
        """Return the statement that notes a value of a particle."""
        if name in self:
            return f"put_{name}_of_{self._array}({self._array}, {row}, {place}, {text})"
        array = f"all_{STATE.get(name, name)}"
        if name in STATE:
            return f"put_vector_in({array}, {row}, {place}, {text})"
        return f"{array}[{row}, {place}] = {text}"

    def names(self) -> dict[str, Any]:
        """Return the functions that such texts refer to."""
        readers = {f"{name}_of_{self._array}": self._reader(*place) for name, place in self._places.items()}
        readers[f"fetch_{self._array}"] = self._fetcher()
        return readers | {f"put_{name}_of_{self._array}": self._writer(*place) for name, place in self._places.items()}

    def _fetcher(self) -> Any:
        lines = -(-self.words // WORDS_OF_LINE)

        line = f"notes.data + (size_t)(unsigned int)row * {self.words}u + {WORDS_OF_LINE} * line"

        @wp.func_native(f"""
        #if defined(__CUDA_ARCH__)
            for (int line = row < 0 ? {lines} : thread; line < {lines}; line += blockDim.x)
                asm volatile("prefetch.global.L2 [%0];" :: "l"({line}));
        #endif
        """)
        def fetch_notes(notes: wp.array2d[float], row: wp.int32, thread: wp.int32):
            """Bring a row nearer that is read later: a line of the memory by each thread."""
            ...

        return fetch_notes

    def _at(self, place: int) -> str:
        begin = f"notes.data + (size_t)(unsigned int)row * {self.words}u + (unsigned int)particle"
        return f"({begin})[{place * self._apart}]"

    def _reader(self, place: int, size: int) -> Any:
        if size == 1:

            @wp.func_native(f"return {self._at(place)};")
            def number_noted(notes: wp.array2d[float], row: wp.int32, particle: wp.int32) -> float:
                """Return a number of a particle."""
                ...

            return number_noted

        parts = ", ".join(self._at(place + part) for part in range(3))

        @wp.func_native(f"return wp::vec_t<3, float>({parts});")
        def vector_noted(notes: wp.array2d[float], row: wp.int32, particle: wp.int32) -> wp.vec3:
            """Return a vector of a particle."""
            ...

        return vector_noted

    def _writer(self, place: int, size: int) -> Any:
        if size == 1:

            @wp.func_native(f"{self._at(place)} = value;")
            def note_number(notes: wp.array2d[float], row: wp.int32, particle: wp.int32, value: float):
                """Note a number of a particle."""
                ...

            return note_number

        @wp.func_native(" ".join(f"{self._at(place + part)} = value[{part}];" for part in range(3)))
        def note_vector(notes: wp.array2d[float], row: wp.int32, particle: wp.int32, value: wp.vec3):
            """Note a vector of a particle."""
            ...

        return note_vector


class AgainWriter(RowsWriter):
    """Write the kernel of a frame again, for threads that loop: values wait where they are noted.

    Args:
        noted: places of the particles' notes.
    """

    velocity_row = "row"
    """Row of the velocities that are read"""

    def __init__(self, step: Step, layout: Layout, noted: Notes):
        super().__init__(step, layout)
        self.noted = noted
        self.velocities = ("velocities", "velocities")

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "advance_worlds_again"

    @property
    def remark(self) -> str:
        """Return a sentence on the kernel."""
        return super().remark.replace("for a frame;", "for a frame again, with notes of its substeps;")

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        return {**super().names(), **self.noted.names(), "put_vector_in": put_vector_in}

    def _body(self) -> None:
        self._find_world()
        self._places_of_rows(self.points[: 2 if "point" in self.step.doubled else 1])
        self._begin_frame()
        self._note_beginning()
        self._clear_lists()
        self._substeps()

    def _note_beginning(self) -> None:
        with self._over("particle"):
            self.line(self.noted.write("point", "first_row", "in_tile(points, particle)"))
            self.line(self.noted.write("velocity", "first_row", "state.velocities[world, particle]"))

    def _clear_lists(self) -> None:
        for name in self._compacted:
            self.line("if thread == 0:")
            self.line(f"    clear_{name}(0)")
            self.line(f"    clear_{name}(1)")
        self.line("block_barrier()")

    def _substeps(self) -> None:
        self.line("for substep in range(t.substeps):")
        with self.indented():
            self.turn, self.next_turn = "substep % 2", "1 - substep % 2"
            self.line("row = first_row + substep")
            self.line("time_in_frame = float(substep) * t.step_seconds")
            if self.shows_velocities:
                self.line("velocities = all_velocities[row]")
                self.line("next_velocities = all_velocities[row + 1]")
            self.velocity_row = "row"
            self._begin_substep()
            self._write_pieces(piece for piece in self.step.pieces if not piece.once and not piece.last)
            self._end_substep()

    def _begin_substep(self) -> None:
        """Write nothing: where a substep begins, the one before has noted."""

    def _end_substep(self) -> None:
        """Write the notes of the balloon, and bring points back to the tile that the next substep begins with."""
        if of_balloon := self._kept_of("balloon"):
            self.line("if thread == 0:")
            for value in of_balloon:
                self.line(f"    all_{value}[row, 0] = {value}")
        if self.points[0] != "points":
            with self._over("particle"):
                self.line(f"put_in_tile(points, particle, in_tile({self.points[0]}, particle))")
            self.line("block_barrier()")
        self.points, self.velocities = ("points", "new_points"), ("velocities", "velocities")

    def _switch(self, piece: Piece) -> None:
        super()._switch(piece._replace(doubles=tuple(name for name in piece.doubles if name == "point")))
        if "velocity" in piece.moves:
            self.velocities = ("next_velocities", "next_velocities")
            self.velocity_row = "row + 1"

    def read(self, name: str) -> str:
        """Return how a value of a particle is read from where it was noted."""
        return self.noted.read(name, self.velocity_row if name == "velocity" else "row")

    def write(self, name: str, target: str) -> str:
        """Return the statement that notes a value of a particle."""
        return self.noted.write(name, "row + 1" if name == "velocity" else "row", name)

    def _put_particle(self, piece: Piece) -> None:
        super()._put_particle(piece)
        if "point" in piece.moves:
            self.line(self.noted.write("point", "row + 1", "point"))


class HeldAgainWriter(AgainWriter):
    """Write the kernel of a frame again, for threads that keep particles.

    Args:
        names: of the values noted of particles, besides their state.
    """

    def __init__(self, step: Step, layout: Layout, noted: Notes, names: Collection[str]):
        super().__init__(step, layout, noted)
        self._names = names

    def _note_beginning(self) -> None:
        """Write nothing: each substep notes where it begins."""

    def _begin_substep(self) -> None:
        for place in self.places:
            with self.about(place):
                self._note_its(STATE)

    def _show_held(self, piece: Piece) -> None:
        super()._show_held(piece)
        if noted := [name for name in piece.leaves if name in self._names]:
            self._note_its(noted)

    def _note_its(self, names: Collection[str]) -> None:
        """Write how the particle at hand notes its values."""
        b = self.bound
        self.line(f"if {b('is_there')}:")
        for name in names:
            self.line(f"    {self.noted.write(name, 'row', b(name), b('particle'))}")

"""A list of phases as one kernel: a block of threads advances a world by a frame, with barriers between pieces.

Points stand in shared memory. A thread keeps a few particles in registers, with all that is known of them, or loops
over particles, whose values then wait in memory.
"""

import re
from collections.abc import Iterable
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.codegen import kernel_from
from balloon_warp.kernels.contact.free_frames import BUSY, FREE
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.slots import SlotTable, paired_reader
from balloon_warp.kernels.memory import in_tile, put_in_tile, put_vector, vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import params_beside_function, params_functions
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.looks import reader_of_springs
from balloon_warp.kernels.schedules.block.state import StateInBlock
from balloon_warp.kernels.schedules.block.sums import block_sum
from balloon_warp.kernels.schedules.compaction import compaction
from balloon_warp.kernels.schedules.pieces import Piece, Step
from balloon_warp.kernels.schedules.writer import head, named_in
from balloon_warp.kernels.spheres import shared_spheres
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
        return f"A block for each world, for a frame; each of {self.layout.threads} threads {keeps}."

    def arguments(self) -> tuple[str, ...]:
        """Return the names of the kernel's arguments."""
        return tuple(named_in(self._written(), self._arguments()))

    def _arguments(self) -> dict[str, str]:
        return {
            "t": "Tables", "slots": "SlotTable", "state": "WorldState", "working": "Working",
            "second_velocities": "wp.array2d[wp.vec3]", "membrane_face_pulls": "wp.array2d[wp.vec3]",
            "state_numbers": "wp.array[wp.int32]",
            **{f"all_{value}": f"wp.array2d[{value}_type]" for value in self.step.kept}, **self.kept_arrays,
        }  # fmt: skip

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        names = {
            **self.scope(phase for piece in self.step.pieces for phase in piece.phases),
            "in_tile": in_tile, "put_in_tile": put_in_tile, "vector_at": vector_at, "put_vector": put_vector,
            "block_barrier": block_barrier, "any_in_block": any_in_block, "WARP_THREADS": WARP_THREADS,
            "SlotTable": SlotTable, "BUSY": BUSY, "FREE": FREE,
            "read_params_beside": params_beside_function(self.features.columns, self.features.balloons),
            "take_place": place_function(self.features), "load_in": load_in,
        }  # fmt: skip
        if self.layout.held or any(self.layout.slots):
            names["read_springs"] = reader_of_springs(self.features, self.layout, self.derived)
        if any(self.layout.slots) and not self.layout.held:
            names["read_pairs"] = paired_reader(self.features, self.layout.slots)
        if self.layout.membrane_face and self.layout.membrane_face.quads:
            names["hold_membrane_faces"] = self.step.look.membrane_faces(self.features).keeps
        if self.features.spheres:
            names["share_spheres"], names["put_spheres"], _ = shared_spheres(self.features.spheres)
        for phase in self.phases:
            if phase.due:
                names[f"{phase.name}_is_due"] = phase.due(self.features)
            if phase.name in self._compacted:
                functions = compaction(phase.name, self.layout.capacity)
                names[f"{phase.name}_may_act"] = phase.asked(self.features, self.step.look)
                names |= {f"{verb}_{phase.name}": getattr(functions, verb) for verb in ("clear", "note")}
                names |= {f"count_of_{phase.name}": functions.count, f"item_of_{phase.name}": functions.at}
            if phase.sums:
                (value,) = phase.writes
                functions = block_sum(value, phase.writes[value], self.features.balloons, self.layout.warps)
                names |= {f"{verb}_{value}": function for verb, function in functions._asdict().items()}
        return names

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
            self.line(f"if working.verdicts[world] == {'BUSY' if self.features.watched else 'FREE'}: return")
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
            self.turn, self.next_turn = TURNS.get(number, ("0", "1"))
            self.line(f"time_in_frame = float({number}) * t.step_seconds")
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

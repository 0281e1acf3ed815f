"""Phases as launches: the source of a kernel for each piece of a list."""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.compose import kernel_from
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.net_force import Loops, scalar_loops
from balloon_warp.kernels.loops.spheres import sphere_at
from balloon_warp.kernels.memory import four_bytes_in, vector_at
from balloon_warp.kernels.phase import STATE, VIEWS, Access, Phase
from balloon_warp.kernels.schedules.writer import Piece, Step, Writer, compaction, head, named_in
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import block_barrier, set_quanta, total_newtons
from balloon_warp.kernels.working import Working

wp.set_module_options(OPTIONS)


@wp.kernel
def read_sphere_forces(
    # state in
    sphere_forces: wp.array2d[wp.vec3],
    # out
    sphere_quanta: wp.array3d[wp.int64],
):
    """Convert sphere forces from newtons to whole numbers; a thread a (world, sphere)."""
    world, sphere = wp.tid()
    set_quanta(sphere_quanta, world, sphere, sphere_forces[world, sphere])


@wp.kernel
def write_sphere_forces(
    # in
    sphere_quanta: wp.array3d[wp.int64],
    # state out
    sphere_forces: wp.array2d[wp.vec3],
):
    """Convert sphere forces from whole numbers to newtons; a thread a (world, sphere)."""
    world, sphere = wp.tid()
    sphere_forces[world, sphere] = total_newtons(sphere_quanta, world, sphere)


def rare_phase(step: Step, piece: Piece) -> Phase | None:
    """Return the phase of a piece, if it is the only one, and most items stay as they are."""
    first, *others = piece.phases
    stays = not (others or piece.sums or piece.doubles or piece.leaves or piece.keeps)
    return first if stays and first.asked(step.features, step.access) else None


def acts_on_few(step: Step, piece: Piece) -> bool:
    """Return whether a block lists the particles that a piece acts on: it is apart since most have nothing to do."""
    rare = rare_phase(step, piece)
    return rare is not None and piece.item == "particle" and rare.name in step.apart


def tested_ahead(step: Step, piece: Piece) -> Phase | None:
    """Return the phase of the next piece, if it acts on few particles, and the thread that moved one knows which."""
    place = step.pieces.index(piece) + 1
    after = step.pieces[place] if place < len(step.pieces) else None
    knows = piece.item == "particle" and not (piece.sums or piece.once or acts_on_few(step, piece))
    return after.phases[0] if knows and after and acts_on_few(step, after) else None


def is_tested_ahead(step: Step, piece: Piece) -> bool:
    """Return whether the piece before notes the particles that this one acts on."""
    place = step.pieces.index(piece)
    return place > 0 and tested_ahead(step, step.pieces[place - 1]) is not None


@cache
def gathering_loops(features: Features) -> Loops:
    """Return loops over all forces on a particle."""
    return scalar_loops(features, vector_at)


@wp.func
def summed_force(
    t: Tables, points: Any, velocities: Any, params: Any, working: Working, point: Any, velocity: Any, time: float
):
    """Take the summed force [N], and clear it for the next substep."""
    force = working.forces[params.world, params.number]
    working.forces[params.world, params.number] = wp.vec3()
    return force


@wp.func
def summed_area_vector(t: Tables, points: Any, params: Any, working: Working, point: Any):
    """Take the summed area vector [m^2], and clear it."""
    area_vector = working.area_vectors[params.world, params.number]
    working.area_vectors[params.world, params.number] = wp.vec3()
    return area_vector


@cache
def summed_loops(features: Features) -> Loops:
    """Return functions that read sums by other threads: forces of springs, strings, hinges, faces, and area vectors."""

    return scalar_loops(features, vector_at, summed_force, summed_area_vector)._replace(others=None)


GATHERED = Access(vector_at, sphere_at, gathering_loops)
"""Access where each particle loops over its forces"""
SUMMED = Access(vector_at, sphere_at, summed_loops, alone=lambda features: not (features.in_water or features.bursts))
"""Access where other threads have summed the forces"""
ITEMS_OF_PART = wp.constant(512)
"""Number of items in a part of a large balloon, whose sums are reduced part by part"""
ITEMS_OF_LIST = wp.constant(512)
"""Number of items among which a block finds those that a rare phase acts on"""
Part = Literal["all", "part", "parts"]
"""Range that the kernel of a summing piece covers: all items of a balloon, the items of a part, or the parts"""
HANDLES = ("t", "state", "working", "clock", "substep")
NAMES: Mapping[str, tuple[str, str]] = {
    "time_in_frame": ("", "time_in_frame_of(clock, substep)"),
    "time": ("time_in_frame", "time_of(t, state.frame, time_in_frame)"),
    "end": ("time_in_frame", "time_in_frame + t.step_seconds"),
    "points": ("", "all_points[world]"),
    "velocities": ("", "all_velocities[world]"),
    "spheres": ("", "spheres_in_state(t, state, working)"),
    "numbers": ("", "read_numbers(t, world, balloon)"),
}
"""Expressions for the names that phases read: names that the expression needs, and its text"""
OF_PARTICLE: Mapping[str, tuple[str, str]] = {
    "params": ("", "read_params(t, world, particle)"),
    "balloon": ("params", "params.balloon"),
    "point": ("", "vector_in(all_points, world, particle)"),
    "velocity": ("", "vector_in(all_velocities, world, particle)"),
    "origin": ("balloon", "all_points[world, volume_origin(t, balloon)]"),
    "gas_mass": ("balloon", "working.gas_masses[world, balloon]"),
    "keyed": ("balloon time_in_frame", "ramp_at(state, world, balloon, time_in_frame)"),
    "load": ("balloon", "two_in(state.inflation_loads, world, balloon)"),
}
"""Expressions for names of a particle"""
OFFSETS = {"particle": "t.particles.offsets", "face": "t.faces.balloon_offsets"}
"""Begin of each balloon's items"""
END_OF_LIST = "wp.min(begin + ITEMS_OF_LIST, state.points.shape[1])"
"""End of the particles of a block"""


class PieceWriter(Writer):
    """Find the arguments of phases where the state is in arrays."""

    aliases: ClassVar[Mapping[str, str]] = {"springs": "working"}

    def __init__(self, step: Step):
        super().__init__(step, (*HANDLES, "world"))

    def _begin(self, indices: str) -> None:
        self.line(f"{indices} = wp.tid()")
        if self.step.features.frames == "busy":
            self.line("if working.verdicts[world] == 0:")
            self.line("    return")
        self.known |= set(indices.split(", "))

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        kept = self.step.kept
        if VIEWS.get(name) in kept:
            return "", f"all_{VIEWS[name]}[world]"
        if name in kept:
            item = self.step.owner(name)
            return (item if item == "balloon" else ""), f"all_{name}[world, {item}]"
        if kept := self.found_kept(name):
            return kept
        particles = "particle" in self.known
        if particles and name in OF_PARTICLE:
            return OF_PARTICLE[name]
        if name in NAMES:
            return NAMES[name]
        return self.number_at(name) if particles or "sphere" in self.known else None


class _Writer(PieceWriter):
    """Write the source of a piece."""

    def __init__(self, step: Step, piece: Piece, part: Part = "all"):
        super().__init__(step)
        self.piece, self.part = piece, part

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return self.piece.name

    def source(self) -> str:
        """Return the text of the kernel."""
        return "\n".join([*head(self.name, self.arguments(), self._whose()), *self._written(), ""])

    def _whose(self) -> str:
        """Return a sentence on the thread that executes the piece."""
        if self.piece.sums:
            return f"A block for each {self.part if self.part == 'part' else 'balloon'}."
        if acts_on_few(self.step, self.piece):
            return "A block for each few hundred particles of each world."
        if self.piece.item in ("team", "world", "balloon"):
            return f"A {'block' if self.piece.item == 'team' else 'thread'} for each world."
        return f"A thread for each {self.piece.item} of each world."

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        names = {**self.scope(self.piece.phases), "ITEMS_OF_PART": ITEMS_OF_PART, "four_bytes_in": four_bytes_in}
        if ahead := tested_ahead(self.step, self.piece):
            names[f"{ahead.name}_may_act"] = ahead.asked(self.step.features, self.step.access)
        if rare := rare_phase(self.step, self.piece):
            functions = compaction(rare.name, int(ITEMS_OF_LIST))
            names |= {f"{rare.name}_may_act": rare.asked(self.step.features, self.step.access),
                      "clear": functions.clear, "note": functions.note, "count": functions.count, "noted": functions.at,
                      "ITEMS_OF_LIST": ITEMS_OF_LIST, "block_barrier": block_barrier}  # fmt: skip
        return names

    def arguments(self) -> dict[str, str]:
        """Return the names of the kernel's arguments, as it needs them, and their types."""
        may_be = {
            "t": "Tables", "clock": "Clock", "substep": "wp.int32", "state": "WorldState", "working": "Working",
            **{f"all_{view}": "wp.array2d[wp.vec3]" for view in STATE.values()},
            **{f"new_{view}": "wp.array2d[wp.vec3]" for view in STATE.values()},
            **{f"all_{value}": f"wp.array2d[{value}_type]" for value in self.step.kept}, **self.kept_arrays,
            "all_active": "wp.array2d[wp.int8]",
        }  # fmt: skip
        if self.piece.sums:
            may_be["all_parts"] = f"wp.array3d[{self._summed}_type]"
        if self.piece.item == "spring":
            may_be["first_spring"] = "wp.int32"
        return named_in(self._written(), may_be)

    def _written(self) -> list[str]:
        """Return the body's lines."""
        if not self.lines:
            self._body()
        return self.lines

    @property
    def _summed(self) -> str:
        return next(iter(self.piece.phases[0].writes))

    def _body(self) -> None:
        piece = self.piece
        if piece.sums:
            self._sum()
        elif acts_on_few(self.step, piece):
            self._few()
        elif piece.item == "team":
            self._begin("world, thread")
            self.calls(piece.phases)
        elif piece.item in ("world", "balloon"):
            self._worlds()
        else:
            self._begin(f"world, {piece.item}")
            if piece.item == "spring":
                self.line("spring += first_spring")
            if rare := rare_phase(self.step, piece):
                self.line(f"if not {self.may_act(rare)}:")
                self.line("    return")
            self.calls(piece.phases)
            self._leave()
            if ahead := tested_ahead(self.step, piece):
                self.line(f"all_active[world, {piece.item}] = wp.int8(wp.where({self.may_act(ahead)}, 1, 0))")

    def _few(self) -> None:
        """Write a loop over items that lists those to act on, and one over these: so that all threads have one."""
        (phase,), item = self.piece.phases, self.piece.item
        self._begin("world, part, thread")
        for line in ("if thread == 0:", "    clear(0)", "block_barrier()", "begin = part * ITEMS_OF_LIST"):
            self.line(line)
        before, self.indent = set(self.known), "        "
        if is_tested_ahead(self.step, self.piece):
            self.lines.append(f"    for four in range(begin + 4 * thread, {END_OF_LIST}, 4 * wp.block_dim()):")
            self.line("active = four_bytes_in(all_active, world, four)")
            for place in range(4):
                self.line(f"if active & {1 << 8 * place} != 0:")
                self.line(f"    note(0, four + {place})")
        else:
            self.lines.append(f"    for {item} in range(begin + thread, {END_OF_LIST}, wp.block_dim()):")
            self.known.add(item)
            self.line(f"if {self.may_act(phase)}:")
            self.line(f"    note(0, {item})")
        self.lines += ["    block_barrier()", "    for place in range(thread, count(0), wp.block_dim()):"]
        self.known = {*before, item}
        self.line(f"{item} = noted(place)")
        self.calls(self.piece.phases)
        self._leave()

    def _leave(self) -> None:
        """Write the results of the piece to where they are kept."""
        for name in self.piece.moves:
            self.line(f"put_vector_in(new_{STATE[name]}, world, {self.piece.item}, {name})")
        for name in self.piece.leaves:
            self.line(f"all_{name}[world, {self.step.owner(name)}] = {name}")
        for name in self.piece.keeps:
            self.line(f"{self.kept_at(name)} = {name}")

    def _worlds(self) -> None:
        """Write the work of a thread for a world, balloon by balloon."""
        self._begin("world")
        known = set(self.known)
        looping = False
        for phase in self.piece.phases:
            of_balloon = phase.item == "balloon"
            if of_balloon and not looping:
                known = set(self.known)
                self.line("for balloon in range(t.inflation_kind.shape[0]):")
                self.known.add("balloon")
            elif looping and not of_balloon:
                self.known = known
            looping = of_balloon
            self.indent = "        " if looping else "    "
            self.calls((phase,))
            for name in phase.keeps:
                self.line(f"{self.kept_at(name)} = {name}")

    def _sum(self) -> None:
        """Write the sum of a block over a balloon, or a part of one, in the same order every time."""
        phase, *others = self.piece.phases
        value = self._summed
        self._begin("world, balloon, part, thread" if self.part == "part" else "world, balloon, thread")
        self.line("total = float(0.0)" if phase.writes[value] is float else f"total = {value}_type()")
        before = set(self.known)
        if self.part == "parts":
            self.line("for part in range(thread, all_parts.shape[2], wp.block_dim()):")
            self.line("    total += all_parts[world, balloon, part]")
        else:
            begin, end = f"{OFFSETS[phase.item]}[balloon]", f"{OFFSETS[phase.item]}[balloon + 1]"
            if self.part == "part":
                self.line(f"begin = {begin} + part * ITEMS_OF_PART")
                begin, end = "begin", f"wp.min(begin + ITEMS_OF_PART, {end})"
            self.line(f"for {phase.item} in range({begin} + thread, {end}, wp.block_dim()):")
            self.indent = "        "
            self.known.add(phase.item)
            call = self.call(phase)
            self.line(f"# {phase.summary}")
            self.line(f"total += {call}")
            self.indent = "    "
        self.known = before
        tile = "wp.tile(total)" if phase.writes[value] is float else "wp.tile(total, preserve_type=True)"
        self.line(f"{value} = wp.tile_sum({tile})[0]")
        self.known.add(value)
        self.line("if thread == 0:")
        self.indent = "        "
        if self.part == "part":
            self.line(f"all_parts[world, balloon, part] = {value}")
        else:
            self.calls(tuple(others))
            self._leave()


@cache
def kernel_of(step: Step, piece: Piece, part: Part = "all", fast_math: bool = False, registers: int = 0) -> Any:
    """Make the kernel of a piece.

    Args:
        fast_math: whether a GPU's own division and root will do.
        registers: of a thread, at most; 0 for as many as the compiler takes.
    """
    writer = _Writer(step, piece, part)
    options: dict[str, Any] = {"module_options": {**OPTIONS, "fast_math": fast_math}}
    if registers:
        options["cuda_max_registers"] = registers
    return kernel_from(piece.name, writer.source(), writer.names(), **options)


@cache
def arguments_of(step: Step, piece: Piece, part: Part = "all") -> tuple[str, ...]:
    """Return the names of the arguments of a piece's kernel."""
    return tuple(_Writer(step, piece, part).arguments())


def source_of(step: Step, instead: Mapping[str, str] = MappingProxyType({})) -> str:
    """Write the kernels of a list, in the order of their launches.

    Args:
        instead: sources of other kernels, by the name of the first phase of the piece that they execute.
    """
    pieces = [piece for piece in step.pieces if piece.item != "launches"]
    return "\n\n".join(instead.get(piece.phases[0].name) or _Writer(step, piece).source() for piece in pieces)

"""Layouts of worlds: in blocks of threads, with registers and shared memory, and in lanes of vector registers."""

import os
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.contact.spheres import mark_count
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3
from balloon_warp.kernels.loops.membranes import MembraneFaceLayout
from balloon_warp.kernels.phases.motion import check
from balloon_warp.kernels.schedules.block import arguments_of_frame, kernel_of_frame
from balloon_warp.kernels.schedules.block_names import Layout, access_of
from balloon_warp.kernels.schedules.lanes import arguments_of, kinds_of
from balloon_warp.kernels.schedules.lanes_layouts import Layout as LaneLayout
from balloon_warp.kernels.schedules.lanes_state import lane_structs, part_structs
from balloon_warp.kernels.schedules.writer import Step, cut, values_of
from balloon_warp.kernels.substep import FACING, FILMED, NOTHING, phases_of
from balloon_warp.kernels.working import Working
from balloon_warp.model import Model, State
from balloon_warp.model.state import Room
from balloon_warp.schedules.launched import working_arrays
from balloon_warp.schedules.membranes import (
    MembraneQuads,
    membrane_face_entries,
    membrane_face_layout,
    membrane_face_table,
    membrane_quads,
)
from balloon_warp.schedules.slices import (
    kind_slots,
    min_valence,
    order_by_springs,
    quad_rings,
    renumbered,
    slot_table,
    spring_ends,
)
from balloon_warp.schedules.tables import kept_arguments, make_tables, other_corners, world_state
from balloon_warp.system.warp_threads import begin_loading, launch_tiled

MOST_THREADS = 1024
"""Largest number of threads of a block"""
BYTES_PER_PARTICLE = 24
"""Bytes of a particle: two buffers of points"""
RESERVED_BYTES = 2048
"""Shared memory for spheres and the sums of areas and swellings of a balloon or two [bytes]"""
CPU_TILE_BYTES = 1 << 18
"""Shared memory of the CPU, which emulates a GPU here: a block of one thread, a tile of a GPU's size [bytes]"""
CAPACITY_STEP = 512
"""Granularity of the streaming kernel's capacity, so that few are compiled"""


def thread_a_particle(model: Model) -> bool:
    """Return whether a block has a thread for each particle of a world."""
    return model.particle_count <= MOST_THREADS


def fits_in_block(model: Model) -> bool:
    """Return whether a world's points, in two buffers, fit in the shared memory of a block."""
    return model.particle_count <= max_particles(model)


def max_particles(model: Model, bytes_per_particle: int = BYTES_PER_PARTICLE) -> int:
    """Return the largest number of particles whose points fit in shared memory, at a number of bytes each."""
    if model.device.is_cpu:
        return CPU_TILE_BYTES // bytes_per_particle
    # bytes for each further balloon or sphere, of the most warps; in water, of what floats, too
    sums = 1 << 11 if model.scene.water else 1 << 10
    presses = 1 << 13 if model.scene.contact == "impulse" else 0
    reserved = RESERVED_BYTES + presses + sums * (model.balloon_count + model.sphere_count)
    capacity = (model.device.max_shared_memory_per_block - reserved) // bytes_per_particle
    return capacity // CAPACITY_STEP * CAPACITY_STEP


def require_block(model: Model, schedule: str) -> None:
    """Make sure that a world fits in a block.

    Raises:
        InputError: it does not.
    """
    if not fits_in_block(model):
        raise InputError(
            f"schedule {schedule}: a world of {model.particle_count:,} particles is too large for a block's shared "
            f"memory, which holds {max_particles(model):,}; use gather"
        )


WARP_THREADS = 32
MOST_THREADS_OF_MULTIPROCESSOR = 2048
REGISTERS = 65536
"""Registers of a multiprocessor"""
QUARTERS = 4
"""Partitions of a multiprocessor, among which its warps and registers are divided"""
MOST_REGISTERS = 248
"""Largest number of registers of a thread"""
PARAMS_REGISTERS, GAS_REGISTERS, FIXTURE_REGISTERS = 12, 28, 28
"""Registers of a thread besides those for particles: without gas, with gas, and additional ones for obstacles"""
PARTICLE_REGISTERS = 24
"""Registers for a particle, besides those for its springs"""
MEMBRANE_FACE_REGISTERS, QUAD_REGISTERS = 4, 20
"""Additional registers to measure a face of a membrane, and for each quad that a thread keeps"""
MOST_QUADS = 2
"""Largest number of quads that a thread keeps"""
SUM_BYTES = 2048
"""Shared memory of a block besides tiles [bytes]"""
POINT_BYTES = 12
THREADS_BESIDE = ((416, 72), (384, 80), (256, 80))
"""Threads of a block that loop over particles, and registers of each, where a multiprocessor has memory for two such
blocks; chosen is the one whose last turn is fullest"""
THREADS_OF_MANY, MANY = (512, 64), 1792
"""Threads and registers from a number of particles of one balloon of springs"""
THREADS_NEAR_FIXTURES = 256, 128
"""Threads and registers where particles touch obstacles, which takes more registers"""
THREADS_OF_SMALL_NEAR_FIXTURES = 128, 128
"""Threads and registers where a multiprocessor has several small worlds: while few leave obstacles, others move"""
THREADS_ALONE = 768, 80
"""Threads and registers where a multiprocessor has memory for one block only"""


def step_of(features: Features, layout: Layout) -> Step:
    """Return the phases of a scene, in pieces, as a block executes them."""
    instead = FILMED if layout.membrane_face else FACING if features.directions_on_the_way else NOTHING
    phases = (*phases_of(features, instead=instead), *phases_of(features, (check,)))
    return cut(phases, features, access_of(layout, features.spheres), doubles=True, sums_along=True)


def layout_of(model: Model, features: Features) -> Layout:
    """Return the layout that lets most worlds run at once on a multiprocessor.

    A thread keeps one particle, or two, if their springs fit in registers; otherwise it loops. Two share a thread's
    fixed work, and their loads overlap; where a multiprocessor has no second block to turn to while it waits, more
    threads with one particle each are faster. Where few particles of many worlds leave obstacles, all loop.
    """
    if _small_ones_leave_fixtures(model, features):
        return _looped(model, features)
    return held_layout_of(model, features) or _looped(model, features)


def held_layout_of(model: Model, features: Features) -> Layout | None:
    """Return the layout with threads that keep particles, or none."""
    single, double = (_held(model, features, count) for count in (1, 2))
    if single and double:
        return double[0] if double[1] >= max(single[1], 2) else single[0]
    found = single or double
    return found[0] if found else None


def _small_ones_leave_fixtures(model: Model, features: Features) -> bool:
    """Return whether each multiprocessor has several worlds of a few springs that may touch obstacles."""
    many = model.device.is_cuda and model.world_count > 2 * model.device.sm_count
    return many and features.may_touch_obstacles and not features.membranes and thread_a_particle(model)


def _held(model: Model, features: Features, held: int) -> tuple[Layout, int] | None:
    """Return the layout with so many particles a thread, and how many blocks a multiprocessor then runs at once."""
    membrane_face = membrane_face_layout(model, features)
    if (
        model.device.is_cpu
        or not (thread_a_particle(model) or membrane_face)
        or features.gas_flows
        or features.corrected
    ):
        return None
    if features.membranes and (membrane_face is None or features.wears or features.inflation_directions):
        return None
    reading, keeping = (_with_quads(model, features, held, membrane_face, keeps) for keeps in (False, True))
    return keeping if keeping and reading and keeping[1] >= min(reading[1], 2) else reading


def _with_quads(
    model: Model, features: Features, held: int, membrane_face: MembraneFaceLayout | None, keeps_quads: bool
) -> tuple[Layout, int] | None:
    """Return the layout with threads that keep quads of membranes, or none."""
    threads = _round_up(-(-model.particle_count // held), WARP_THREADS)
    capacity, quads = threads * held, -(-model.face_count // threads) if keeps_quads else 0
    may_keep = (
        membrane_face
        and membrane_face.areas
        and membrane_face.triangles == 4
        and not features.viscous
        and quads <= MOST_QUADS
    )
    may_keep = may_keep and all(law.linear for law in features.membranes)
    if threads > MOST_THREADS or (keeps_quads and not may_keep):
        return None
    if membrane_face:
        membrane_face = membrane_face._replace(quads=quads, room=quads * threads, capacity=capacity)
        membrane_face = membrane_face._replace(tile=membrane_face_entries(model, membrane_face))
    ends = spring_ends(model)
    ring = quad_rings(model) if features.measures_areas or features.directions_on_the_way else None
    layout = Layout(
        threads, capacity, held, kind_slots(ends), min_valence(ring) if ring else 0, membrane_face=membrane_face,
        odd=model.substeps % 2 == 1,
    )  # fmt: skip
    tiles = 2 if "point" in step_of(features, layout).doubled else 1
    bytes_of_tiles = tiles * POINT_BYTES * capacity + (
        membrane_face.tile * (24 if membrane_face.areas else 16) if membrane_face else 0
    )
    slots = sum(layout.slots) * (3 if features.springs_vary else 2)
    needed = (GAS_REGISTERS if features.gas else PARAMS_REGISTERS) + held * (PARTICLE_REGISTERS + slots)
    needed += MEMBRANE_FACE_REGISTERS * bool(membrane_face) + quads * QUAD_REGISTERS
    needed += FIXTURE_REGISTERS if features.may_touch_obstacles else 0
    in_memory = model.device.max_shared_memory_per_block // (bytes_of_tiles + SUM_BYTES)
    useful = min(-(-model.world_count // model.device.sm_count), MOST_THREADS_OF_MULTIPROCESSOR // threads)
    for blocks in range(min(useful, in_memory), 0, -1):
        warps_of_quarter = -(-blocks * threads // WARP_THREADS // QUARTERS)
        registers = min(REGISTERS // QUARTERS // WARP_THREADS // warps_of_quarter // 8 * 8, MOST_REGISTERS)
        if registers >= needed:
            return layout._replace(registers=registers), blocks
    return None


def _looped(model: Model, features: Features) -> Layout:
    """Return the layout in which threads loop over particles.

    Values that wait from piece to piece do so in shared memory, as far as two blocks have room for them.
    """
    membrane_face = membrane_face_layout(model, features)
    threads, registers = _loop_threads(model, features, membrane_face)
    threads = 1 if model.device.is_cpu else min(_round_up(model.particle_count, WARP_THREADS), threads)
    capacity = _round_up(model.particle_count, CAPACITY_STEP)
    layout = Layout(
        threads, capacity, registers=registers, odd=model.substeps % 2 == 1,
        # areas from memory are no sooner read than found
        membrane_face=membrane_face._replace(areas=False) if membrane_face else None,
    )  # fmt: skip
    return _ordered(features, layout._replace(tiles=_tiles(model, features, layout)))


def _ordered(features: Features, layout: Layout) -> Layout:
    """Return the layout with particles by their number of springs, where only this kernel sees them in that order."""
    alone = "velocity" in layout.tiles and not (features.membranes or features.has("hinge") or features.keeps)
    return layout._replace(ordered=alone)


def _loop_threads(model: Model, features: Features, membrane_face: MembraneFaceLayout | None) -> tuple[int, int]:
    """Return the threads that loop, and registers of each."""
    if 2 * model.particle_count > max_particles(model):
        return THREADS_ALONE
    if _small_ones_leave_fixtures(model, features):
        return THREADS_OF_SMALL_NEAR_FIXTURES
    if features.may_touch_obstacles:
        return THREADS_NEAR_FIXTURES
    if model.balloon_count == 1 and membrane_face is None and model.particle_count > MANY:
        return THREADS_OF_MANY
    return min(THREADS_BESIDE, key=lambda each: _round_up(model.particle_count, each[0]))


def _tiles(model: Model, features: Features, layout: Layout) -> tuple[str, ...]:
    """Return the state of particles in shared memory, besides points."""
    if model.device.is_cpu:
        return ()
    step = step_of(features, layout)
    kept = [value for value in ("area_vector", "free_velocity", "force", "inflation_direction") if value in step.kept]
    velocities_are_seen = features.reads_neighbor_velocities or features.needs("face", "velocity") or features.impulses
    waiting = [*([] if velocities_are_seen else ["velocity"]), *kept]
    points = 2 if "point" in step.doubled else 1
    room = max_particles(model, POINT_BYTES) // (1 if features.corrected else 2) // layout.capacity - points
    return tuple(waiting[: max(room, 0)])


def _round_up(count: int, step: int) -> int:
    return -(-count // step) * step


class BlockFrames:
    """Advance worlds by frames.

    Args:
        working: the memory beside the state, where others share it.
    """

    contact_lists = None
    """Lists of contacts: balloons do not touch in blocks"""

    def __init__(self, model: Model, features: Features, room: Room, working: Any | None = None):
        self.model, self.layout = model, layout_of(model, features)
        self.step = step_of(features, self.layout)
        self.numbers: wp.array | None = None
        """Numbers in the state of the particles in the tables, where these have them in another order"""
        laid_out = model
        if self.layout.ordered:
            order = order_by_springs(model, spring_ends(model))
            laid_out = renumbered(model, order)
            self.numbers = wp.array(order, dtype=wp.int32, device=model.device)
        self.tables = make_tables(laid_out, features, in_block=not self.layout.held or features.in_water)
        self.tables.membranes.membrane_faces = membrane_face_table(model, self.layout.membrane_face)
        self.working = working or _working_of_blocks(model, features, room)
        self._named_inputs = {"t": self.tables, "working": self.working, **_values(model, self.step, self.layout, room)}
        self._named_inputs["state_numbers"] = self.numbers
        if self.layout.held:
            ring = quad_rings(model) if self.layout.rings else None
            self._named_inputs["slots"] = slot_table(model, spring_ends(model), ring)

    @staticmethod
    def allocate(model: Model, features: Features, room: Room, shares_working: bool = False) -> None:
        """Ask for all memory that they keep, or that they do not share."""
        layout = layout_of(model, features)
        if not shares_working:
            working_arrays(model, features, room)
        _values(model, step_of(features, layout), layout, room)

    def begin_loading(self) -> None:
        """Compile the kernel ahead."""
        begin_loading(kernel_of_frame(self.step, self.layout), self.model.device)

    def advance(self, state: State) -> None:
        """Advance by a frame."""
        self._launch(state, self.layout, {})

    def advance_round(self, state: State, clock: Any, first: int, count: int) -> None:
        """Advance by so many substeps, see `frames.Rounds`."""
        layout = self.layout._replace(odd=count % 2 == 1)
        self._launch(state, layout, {"clock": clock, "first_substep": first, "round_substeps": count})

    def _launch(self, state: State, layout: Layout, told: dict[str, Any]) -> None:
        named_inputs = {**self._named_inputs, "state": world_state(state), **kept_arguments(state), **told}
        launch_tiled(
            kernel_of_frame(self.step, layout),
            dim=[self.model.world_count],
            inputs=[named_inputs[name] for name in arguments_of_frame(self.step, layout)],
            block_dim=layout.threads,
            device=self.model.device,
        )


def _working_of_blocks(model: Model, features: Features, room: Room) -> Any:
    working = Working()
    for name, array in working_arrays(model, features, room).items():
        setattr(working, name, array)
    return working


def _values(model: Model, step: Step, layout: Layout, room: Room) -> dict[str, Any]:
    """Allocate the values that live from piece to piece, and have no place in the block."""
    counts = {"particle": model.particle_count, "face": model.face_count, "balloon": model.balloon_count}
    named, found = arguments_of_frame(step, layout), {}
    for value, dtype in values_of(step).items():
        if f"all_{value}" in named:
            shape = (model.world_count, counts[step.owner(value)])
            found[f"all_{value}"] = room.array(shape, wp.float32 if dtype is float else dtype)
    vectors = {
        "membrane_face_pulls": membrane_face_entries(model, layout.membrane_face) if layout.membrane_face else 0,
        "second_velocities": model.particle_count,
    }
    return found | {
        name: room.array((model.world_count, count), wp.vec3) for name, count in vectors.items() if name in named
    }


LANES = int(LANE_COUNT)


@dataclass(frozen=True)
class Items:
    """Items that the lanes hold at once: particles of eight worlds, or octets of particles, each of one balloon."""

    layout: LaneLayout
    offsets: NDArray[np.int64]
    """Begin of each balloon's items, and the end of the last"""
    particles: NDArray[np.int64]
    """Particle at each place, -1 where an octet is padded"""

    @property
    def count(self) -> int:
        """Number of items."""
        return int(self.offsets[-1])

    @property
    def places(self) -> NDArray[np.int64]:
        """Place of each particle."""
        of_particle = np.zeros(self.particles.max() + 1, dtype=np.int64)
        filled = self.particles >= 0
        of_particle[self.particles[filled]] = np.flatnonzero(filled)
        return of_particle


def items_of(model: Model, layout: LaneLayout) -> Items:
    """Return the items of a model."""
    offsets = np.array(model.particle_offsets)
    if layout.worlds:
        return Items(layout, offsets, np.arange(offsets[-1]))
    octets = np.cumsum([0, *(-(-np.diff(offsets) // LANES))])
    particles = np.full(LANES * octets[-1], -1)
    for balloon, (begin, end) in enumerate(pairwise(offsets.tolist())):
        particles[LANES * octets[balloon] :][: end - begin] = np.arange(begin, end)
    return Items(layout, octets, particles)


@dataclass(frozen=True)
class Entries:
    """Entries of particles, item by item: an octet lists as many as the particle with most."""

    offsets: NDArray[np.int64]
    """Begin of each item's entries, and the end of the last"""
    sources: NDArray[np.int64]
    """Entry of each lane, -1 if it has none; shape (n,) or (n, 8)"""
    owners: NDArray[np.int64]
    """Place that each entry belongs to, of the same shape"""


def list_entries(items: Items, particles: NDArray[np.int64], classes: NDArray[np.int64]) -> Entries:
    """Return the n-th of a class of each particle's entries, side by side.

    Args:
        particles: of each entry, ascending.
        classes: of each entry: the lanes have entries of one class at a time.
    """
    if items.layout.worlds:
        order = np.lexsort([classes, particles])
        offsets = np.searchsorted(particles[order], np.arange(items.count + 1))
        return Entries(offsets, order, particles[order])
    if not len(particles):
        none = np.zeros((0, LANES), dtype=np.int64)
        return Entries(np.zeros(items.count + 1, dtype=np.int64), none, none)
    places = items.places[particles]
    kinds, kind = np.unique(classes, return_inverse=True)
    order = np.lexsort([kind, places])
    cell = places[order] * len(kinds) + kind[order]  # a particle's entries of one class
    nth = np.arange(len(cell)) - np.searchsorted(cell, cell)
    counts = np.bincount(cell, minlength=LANES * items.count * len(kinds))
    widths = counts.reshape(items.count, LANES, len(kinds)).max(axis=1)
    begins = np.cumsum(np.append(0, widths.ravel()))
    octet, lane = np.divmod(places[order], LANES)
    row = begins[octet * len(kinds) + kind[order]] + nth
    sources = np.full((int(begins[-1]), LANES), -1)
    sources[row, lane] = order
    owners = np.repeat(np.arange(items.count), widths.sum(axis=1))[:, None] * LANES + np.arange(LANES)
    return Entries(begins[:: len(kinds)], sources, owners)


def make_lane_tables(model: Model, features: Features, layout: LaneLayout, tables: Any) -> Any:
    """Return the model item by item."""
    items = items_of(model, layout)
    t = lane_structs(layout).tables()

    def array(values: Any, dtype: Any) -> Any:
        return wp.array(np.asarray(values), dtype=dtype, device=model.device)

    t.all = tables
    t.up, t.step_seconds, t.substeps = model.up, model.step_seconds, model.substeps
    t.lane_count, t.world_count = LANES, model.world_count
    t.item_offsets, t.particles = array(items.offsets, wp.int32), array(items.particles, wp.int32)
    shares = np.append(model.particle_mass_share.numpy(), 0.0)[items.particles]
    t.shares = array(shares if layout.worlds else shares.reshape(-1, LANES), layout.number)
    held = np.append(np.diff(tables.strings.offsets.numpy()) if model.string_count else [], 0)
    lanes = 1 if layout.worlds else LANES
    t.held = array(held[items.particles].reshape(-1, lanes).any(axis=1) if model.string_count else [], wp.int32)
    t.places = array(items.places, wp.int32)
    if not layout.worlds:
        t.present = array((items.particles >= 0).reshape(-1, LANES), layout.number)
    if features.jets:
        weights = np.append(model.neck_weights.numpy(), 0.0)[items.particles]
        t.necks.weights = array(weights if layout.worlds else weights.reshape(-1, LANES), layout.number)
    if features.driven:
        first = np.append(tables.outer.slots.numpy()[:, 0], 0.0)[items.particles]
        t.outer.slots = array(first[:, None] if layout.worlds else first.reshape(-1, 1, LANES), layout.number)
    _add_springs(t, model, features, items, array)
    if features.membranes:
        _add_membranes(t, model, features, items, array)
    if features.measures_areas:
        _add_fans(t, model, items, array)
    if features.inflation_directions:
        _add_faces(t, model, items, array)
    return t


def _add_springs(t: Any, model: Model, features: Features, items: Items, array: Any) -> None:
    ends = spring_ends(model)
    entries = list_entries(items, ends.particle, ends.kind)
    there = entries.sources >= 0
    kinds = ends.kind[entries.sources]
    if not items.layout.worlds:
        kinds = np.where(there, kinds, -1).max(axis=1)  # the same in all lanes that have a spring

    def placed(values: NDArray) -> Any:
        return array(np.where(there, values[entries.sources], 0.0), items.layout.number)

    t.spring_offsets = array(entries.offsets, wp.int32)
    t.spring_kinds = array(kinds, wp.int32)
    neighbors = items.places[ends.neighbor]
    t.spring_ends = array(np.where(there, neighbors[entries.sources], entries.owners), items.layout.reference)
    t.spring_lengths = placed(ends.rest_length)
    t.spring_scales = placed(ends.scale) if features.springs_vary else array([], items.layout.number)


def _quads_of(model: Model, layout: LaneLayout) -> MembraneQuads:
    """Return quads and triangles, or eight alike of one balloon, with a last axis of lanes; padding has no area.

    Eight worlds go through quads in the same order, with the same padding, which there has no triangle: the sums of
    quads are alike in both.
    """
    quads = membrane_quads(model)
    alike, counts = np.unique(np.stack([quads.balloons, -quads.triangles]), axis=1, return_counts=True)
    octets, ends = -(-counts // LANES), np.cumsum(counts)
    begins = LANES * (np.cumsum(octets) - octets)
    places = np.repeat(begins - ends + counts, counts).astype(np.int64) + np.arange(len(quads.corners))

    def filled(values: NDArray, nothing: int) -> NDArray:
        rows = np.full((LANES * int(octets.sum()), *values.shape[1:]), nothing, dtype=values.dtype)
        rows[places] = values
        return rows if layout.worlds else np.moveaxis(rows.reshape(-1, LANES, *values.shape[1:]), 1, -1)

    rows = LANES * octets if layout.worlds else octets
    return MembraneQuads(
        filled(quads.corners, -1),
        filled(quads.rests, 0),
        filled(quads.triangles, 0) if layout.worlds else np.repeat(-alike[1], octets),
        filled(quads.numbers, -1),
        np.repeat(alike[0], rows),
    )


def _add_membranes(t: Any, model: Model, features: Features, items: Items, array: Any) -> None:
    quads, layout = _quads_of(model, items.layout), items.layout
    corners = np.where(quads.corners >= 0, items.places[quads.corners], 0)
    t.quad_offsets = array(np.searchsorted(quads.balloons, np.arange(model.balloon_count + 1)), wp.int32)
    t.quads = array(corners.reshape(-1, *corners.shape[2:]), layout.reference)
    t.quad_rests = array(quads.rests.reshape(-1, *quads.rests.shape[2:]), layout.four)
    t.quad_triangles = array(quads.triangles, wp.int32)
    numbers = quads.numbers if features.wears else quads.numbers[:0]
    t.quad_numbers = array(numbers.reshape(-1, *numbers.shape[2:]), layout.reference)


def _add_fans(t: Any, model: Model, items: Items, array: Any) -> None:
    """Add the fans of faces; padding is a face of a particle alone."""
    fans = other_corners(model)
    entries = list_entries(items, fans.particles, fans.sizes)
    lanes = 1 if items.layout.worlds else LANES
    sources, owners = entries.sources.reshape(-1, lanes), entries.owners.reshape(-1, lanes)
    sizes = fans.sizes[sources.max(axis=1)]  # the same in all lanes that have a fan
    begins = np.append(0, np.cumsum(sizes))
    fan = np.repeat(np.arange(len(sizes)), sizes)
    nth = np.arange(begins[-1]) - begins[fan]
    there = sources[fan] >= 0
    corners = fans.others[np.where(there, fans.begins[sources[fan]] + nth[:, None], 0)]
    flat = np.where(there, items.places[corners], owners[fan])
    table = part_structs(items.layout)[1]()
    table.offsets, table.begins = array(entries.offsets, wp.int32), array(begins, wp.int32)
    table.particles = array(flat.ravel() if items.layout.worlds else flat, items.layout.reference)
    t.fans = table


def _add_faces(t: Any, model: Model, items: Items, array: Any) -> None:
    """Add faces, or eight faces of one balloon with as many corners; padding has no area, and is far away."""
    begins = np.asarray(model.face_offsets.numpy(), dtype=np.int64)
    corners = items.places[np.asarray(model.face_particles.numpy(), dtype=np.int64)]
    around_offsets = np.asarray(model.particle_face_offsets.numpy(), dtype=np.int64)
    particles = np.repeat(np.arange(model.particle_count), np.diff(around_offsets))
    around = list_entries(items, particles, np.zeros_like(particles))
    faces = np.asarray(model.particle_faces.numpy(), dtype=np.int64)
    balloons = np.asarray(model.face_balloon.numpy(), dtype=np.int64)
    table = part_structs(items.layout)[0]()
    table.particle_offsets = array(around.offsets, wp.int32)
    if items.layout.worlds:
        table.offsets, table.particles = array(begins, wp.int32), array(corners, wp.int32)
        table.balloon_offsets = array(np.searchsorted(balloons, np.arange(model.balloon_count + 1)), wp.int32)
        table.around_particles = array(faces[around.sources], wp.int32)
        t.faces = table
        return
    octets = face_octets(model)
    listed, offsets = [], [0]
    where = np.zeros(model.face_count, dtype=np.int64)
    for number, members in enumerate(octets):
        size = int(begins[members[0] + 1] - begins[members[0]])
        block = np.zeros((size, LANES), dtype=np.int64)  # one corner for all, where an octet is filled up
        block[:, : len(members)] = corners[begins[members][None] + np.arange(size)[:, None]]
        listed.append(block)
        offsets.append(offsets[-1] + size)
        where[members] = LANES * number + np.arange(len(members))
    table.offsets, table.particles = array(offsets, wp.int32), array(np.concatenate(listed), items.layout.reference)
    of_octets = [balloons[members[0]] for members in octets]
    table.balloon_offsets = array(np.searchsorted(of_octets, np.arange(model.balloon_count + 1)), wp.int32)
    nothing = LANES * len(octets)
    seen = np.where(around.sources >= 0, where[faces[around.sources]], nothing)
    table.around_particles = array(seen, items.layout.reference)
    t.faces = table


def face_octets(model: Model) -> list[NDArray[np.int64]]:
    """Return the faces of one balloon with as many corners, up to eight at a time."""
    alike = np.stack([model.face_balloon.numpy(), np.diff(model.face_offsets.numpy())]).astype(np.int64)
    octets = []
    for kind in np.unique(alike, axis=1).T:
        members = np.flatnonzero((alike == kind[:, None]).all(axis=0))
        octets += [members[first : first + LANES] for first in range(0, len(members), LANES)]
    return octets


FAR_AWAY = 1e16
"""Coordinate of a face that is nearest to no particle [m], whose square is a finite float"""


class LaneMemory(NamedTuple):
    """Arrays by name; those that a scene does not need are empty."""

    of_kernel: dict[str, Any]
    """State and values, as arguments of the kernel"""
    of_tables: dict[str, Any]
    solids: dict[str, Any]
    working: dict[str, Any]


def group_count(model: Model, layout: LaneLayout) -> int:
    """Return the groups of worlds, or worlds."""
    return -(-model.world_count // LANES) if layout.worlds else model.world_count


def shares_of(model: Model, layout: LaneLayout, thread_count: int | None = None) -> list[NDArray[np.int64]]:
    """Return the groups of each thread; a thread a core, if not given, and no more than there are groups."""
    groups = group_count(model, layout)
    return np.array_split(np.arange(groups), min(thread_count or os.cpu_count() or 1, groups))


def allocate_lanes(model: Model, step: Step, layout: LaneLayout, room: Room) -> LaneMemory:
    """Ask for it."""
    groups, items, features = group_count(model, layout), items_of(model, layout).count, step.features
    balloons, width = model.balloon_count, features.columns.width
    solids = model.sphere_count + (len(model.obstacles) if features.may_touch_obstacles else 0)
    adds_up = bool(features.membranes) or features.has("hinge") or features.has("face")
    return LaneMemory(
        _of_kernel(model, step, layout, room),
        {
            "numbers": room.array((groups, balloons, width), Lanes),
            "forces": room.array((groups, _places(layout, items) if adds_up else 0), layout.vector),
        },
        {
            "centers": room.array((groups, solids), Lanes3),
            "motions": room.array((groups, solids), Lanes3),
            "reaches": room.array((groups, solids), Lanes),
        },
        _working_of_lanes(model, features, groups * (LANES if layout.worlds else 1), room),
    )


def _places(layout: LaneLayout, items: int) -> int:
    """Return the number of entries: of eight worlds, or of each particle of an octet."""
    return items if layout.worlds else LANES * items


def _of_kernel(model: Model, step: Step, layout: LaneLayout, room: Room) -> dict[str, Any]:
    groups, items, takes = group_count(model, layout), items_of(model, layout).count, arguments_of(step, layout)
    faces = model.face_count if layout.worlds else len(face_octets(model))
    counts = {"particle": items, "face": faces, "balloon": model.balloon_count}
    arrays = {}
    for place in ("all_points", "other_points", "all_velocities", "other_velocities"):
        if place in takes:
            shown = "Seen" in takes[place]
            shape = (groups, _places(layout, items) if shown else items)
            arrays[place] = room.array(shape, layout.vector if shown else Lanes3)
    for name, (item, kind) in kinds_of(step, layout).items():
        shown = kind is layout.vector and not layout.worlds
        arrays[f"all_{name}"] = room.array((groups, LANES * counts[item] + 1 if shown else counts[item]), kind)
        if f"all_{name}_parts" in takes:
            arrays[f"all_{name}_parts"] = room.array((groups, LANES), kind)
    return arrays


def put_far_away(arrays: dict[str, Any], layout: LaneLayout) -> None:
    """Place the padding face of octets far away, so that it is nearest to no particle."""
    if not layout.worlds and "all_face_center" in arrays:
        centers = arrays["all_face_center"].numpy()
        centers[:, -1] = FAR_AWAY
        arrays["all_face_center"].assign(centers)


def _working_of_lanes(model: Model, features: Features, worlds: int, room: Room) -> dict[str, Any]:
    spheres = model.sphere_count
    return {
        "gas_masses": room.array((worlds, model.balloon_count if features.gas else 0), wp.float32),
        "sphere_quanta": room.array((worlds, spheres if features.spheres_pushed else 0, 3), wp.int64),
        "sphere_starts": room.array((worlds, spheres if features.keeps_starts else 0), wp.vec3),
        "near": room.array((worlds, mark_count(model.particle_count) if features.impulses else 0), wp.int32),
    }


def rows_of(numbers: Any) -> Any:
    """Return numbers by group, lane and balloon: a row each."""
    groups, balloons, width = numbers.shape
    flat = wp.array(
        ptr=numbers.ptr, shape=(groups, balloons, width, LANES), dtype=wp.float32, device=numbers.device, copy=False
    )
    return flat.transpose((0, 3, 1, 2))

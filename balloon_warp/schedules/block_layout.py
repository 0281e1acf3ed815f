"""Worlds in blocks of threads: their layout in registers and shared memory, and frames of all in one launch.

Capacity of a thread block for particles: in shared memory, and in threads.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.membranes import MembraneFaceLayout
from balloon_warp.kernels.phases.motion import check
from balloon_warp.kernels.schedules.block import arguments_of_frame, kernel_of_frame
from balloon_warp.kernels.schedules.block_names import Layout, access_of
from balloon_warp.kernels.schedules.writer import Step, cut, values_of
from balloon_warp.kernels.substep import FACING, FILMED, NOTHING, phases_of
from balloon_warp.kernels.working import Working
from balloon_warp.model import Model, State
from balloon_warp.model.state import Room
from balloon_warp.schedules.launched import working_arrays
from balloon_warp.schedules.membranes import membrane_face_entries, membrane_face_layout, membrane_face_table
from balloon_warp.schedules.slices import (
    kind_slots,
    min_valence,
    order_by_springs,
    quad_rings,
    renumbered,
    slot_table,
    spring_ends,
)
from balloon_warp.schedules.tables import kept_arguments, make_tables, world_state
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
        self.working = working or _working(model, features, room)
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

    @property
    def _kernel(self) -> Any:
        return kernel_of_frame(self.step, self.layout)

    def begin_loading(self) -> None:
        """Compile the kernel ahead."""
        begin_loading(self._kernel, self.model.device)

    def advance(self, state: State) -> None:
        """Advance by a frame."""
        named_inputs = {**self._named_inputs, "state": world_state(state), **kept_arguments(state)}
        launch_tiled(
            self._kernel,
            dim=[self.model.world_count],
            inputs=[named_inputs[name] for name in arguments_of_frame(self.step, self.layout)],
            block_dim=self.layout.threads,
            device=self.model.device,
        )


def _working(model: Model, features: Features, room: Room) -> Any:
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

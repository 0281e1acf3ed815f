"""The `block` schedule: a thread block a world, whose points stay in shared memory for all substeps of a frame."""

from dataclasses import dataclass
from typing import Any

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.block import FORCE_ROWS, SphereForces
from balloon_warp.kernels.block_air import GAS_ROWS
from balloon_warp.kernels.block_resident import resident_kernel
from balloon_warp.kernels.block_streaming import streaming_kernel
from balloon_warp.model import Model, State
from balloon_warp.model.memory import VECTOR_BYTES
from balloon_warp.schedules.refresh import refresh_ramp
from balloon_warp.schedules.slots import kind_slots, slot_table
from balloon_warp.schedules.tables import (
    SpringEnds,
    air_table,
    body_table,
    correction_table,
    face_table,
    obstacle_table,
    spring_ends,
    spring_table,
    string_table,
    water_table,
    world_state,
)
from balloon_warp.schedules.traits import beyond_basics, model_traits

WARP_THREADS = 32
MOST_THREADS = 1024
MOST_THREADS_OF_MULTIPROCESSOR = 2048
REGISTERS = 65536
"""of a multiprocessor"""
QUARTERS = 4
"""of a multiprocessor, among which its warps and registers are shared out"""
MOST_REGISTERS = 248
"""of a thread"""
BYTES_PER_PARTICLE = 24
"""two buffers of points"""
CPU_TILE_BYTES = 1 << 18
"""the CPU stands in for a GPU here: a block of one thread, a tile of a GPU's size"""
STREAMING_STEP = 512
"""capacities of the streaming kernel are multiples of this, so that few are compiled"""


class BlockSchedule:
    """Advances a state by whole frames, in place. Bit-reproducible.

    Raises:
        InputError: a world does not fit in a block's shared memory.
    """

    name = "block"
    capturable = True

    def __init__(self, model: Model):
        if not fits_in_block(model):
            raise InputError(
                f"--schedule block: a world of {model.particle_count:,} particles is too large for a block's shared "
                f"memory, which holds {_most_particles(model):,}; use gather"
            )
        self.model = model
        self._tables = [table(model) for table in (body_table, string_table, obstacle_table, face_table)]
        fresh = model.scene.normals == "fresh"
        ends = spring_ends(model)
        self._memory: list[Any] = []
        residence = _residence(model, ends)
        if residence:
            self._threads = residence.threads
            self._own_tables = [slot_table(model, ends)]
            self._kernel = resident_kernel(
                residence.threads,
                residence.particles_a_thread,
                -(-model.face_count // residence.threads),
                kind_slots(ends),
                self._own_tables[0].faces.shape[0],
                model.sphere_count,
                ends.vary,
                model.string_count > 0,
                model.scene.ground is not None,
                fresh,
                model.substeps % 2 == 1,
                residence.registers,
            )
        else:
            most = _round_up(model.particle_count, WARP_THREADS)
            self._threads = min(most, MOST_THREADS) if model.device.is_cuda else 1
            capacity = _round_up(model.particle_count, STREAMING_STEP)
            traits = model_traits(model)
            self._own_tables = [
                *(spring_table(model, ends), water_table(model), air_table(model), correction_table(model)),
            ]
            self._kernel = streaming_kernel(capacity, _power_of_two(model.sphere_count), traits, fresh)
            other_velocities = wp.zeros(
                (model.world_count, model.particle_count if traits.keeps_velocities else 0),
                dtype=wp.vec3,
                device=model.device,
            )
            gas_rows = wp.zeros(
                (GAS_ROWS * model.world_count, model.balloon_count), dtype=wp.float64, device=model.device
            )
            self._memory = [_sphere_forces(model), other_velocities, gas_rows]

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        if _residence(model, spring_ends(model)):
            return 0
        velocities = VECTOR_BYTES * model.particle_count if model_traits(model).keeps_velocities else 0
        return velocities + FORCE_ROWS * (24 * model.sphere_count + 4) + GAS_ROWS * 8 * model.balloon_count

    def advance_frame(self, state: State) -> None:
        """One frame in one launch, after the ramp of the inflation."""
        model = self.model
        refresh_ramp(model, state)
        wp.launch_tiled(
            self._kernel,
            dim=[model.world_count],
            inputs=[
                *self._tables,
                *self._own_tables,
                model.substeps,
                model.step_seconds,
                world_state(state),
                *self._memory,
            ],
            block_dim=self._threads,
            device=model.device,
        )


def _sphere_forces(model: Model) -> Any:
    """Room for the forces on spheres."""
    forces = SphereForces()
    forces.totals = wp.zeros(
        (FORCE_ROWS * model.world_count, model.sphere_count, 3), dtype=wp.int64, device=model.device
    )
    forces.stamps = wp.zeros((model.world_count, FORCE_ROWS), dtype=wp.int32, device=model.device)
    return forces


@dataclass(frozen=True)
class Residence:
    """How the particles of a world live in the registers of a block."""

    particles_a_thread: int
    threads: int
    registers: int
    """of a thread"""
    blocks: int
    """that a multiprocessor runs at once"""


def _residence(model: Model, ends: SpringEnds) -> Residence | None:
    """The layout that lets most worlds run at once on a multiprocessor; None if the springs do not fit in registers.

    Two particles a thread share what a thread does for itself (spheres, barriers), and their loads overlap; where a
    multiprocessor has no second block to turn to while it waits, more threads with one particle each are faster.
    """
    if not thread_a_particle(model) or model.device.is_cpu or beyond_basics(model):
        return None
    single, double = _layout(model, ends, 1), _layout(model, ends, 2)
    if single and double:
        return double if double.blocks >= max(single.blocks, 2) else single
    return single or double


def _layout(model: Model, ends: SpringEnds, particles_a_thread: int) -> Residence | None:
    """With as many blocks as leave registers for the springs."""
    threads = _round_up(-(-model.particle_count // particles_a_thread), WARP_THREADS)
    needed = 12 + particles_a_thread * (24 + (3 if ends.vary else 2) * sum(kind_slots(ends)))
    for blocks in range(_useful_blocks(model, threads), 0, -1):
        warps_of_quarter = -(-blocks * threads // WARP_THREADS // QUARTERS)
        registers = min(REGISTERS // QUARTERS // WARP_THREADS // warps_of_quarter // 8 * 8, MOST_REGISTERS)
        if registers >= needed:
            return Residence(particles_a_thread, threads, registers, blocks)
    return None


def _useful_blocks(model: Model, threads: int) -> int:
    """Blocks of a multiprocessor that there are worlds for, and that its threads allow."""
    return min(-(-model.world_count // model.device.sm_count), MOST_THREADS_OF_MULTIPROCESSOR // threads)


def thread_a_particle(model: Model) -> bool:
    """Whether a block has a thread for each particle of a world."""
    return model.particle_count <= MOST_THREADS


def fits_in_block(model: Model) -> bool:
    """Whether a world's points, in two buffers, fit in the shared memory of a block."""
    return model.particle_count <= _most_particles(model)


def _most_particles(model: Model) -> int:
    if model.device.is_cpu:
        return CPU_TILE_BYTES // BYTES_PER_PARTICLE
    reserved = 2048  # for the sums of areas and swellings
    capacity = (model.device.max_shared_memory_per_block - reserved) // BYTES_PER_PARTICLE
    return capacity // STREAMING_STEP * STREAMING_STEP


def _round_up(count: int, step: int) -> int:
    return -(-count // step) * step


def _power_of_two(count: int) -> int:
    return 1 << max(count - 1, 0).bit_length()

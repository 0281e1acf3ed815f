"""The `block` schedule: a thread block a world, whose points stay in shared memory for all substeps of a frame."""

from typing import Any

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.block import FORCE_ROWS, SphereForces
from balloon_warp.kernels.block_resident import resident_kernel
from balloon_warp.kernels.block_streaming import streaming_kernel
from balloon_warp.model import Model, State
from balloon_warp.model.memory import VECTOR_BYTES
from balloon_warp.schedules.refresh import refresh_ramp
from balloon_warp.schedules.slots import kind_slots, slot_table
from balloon_warp.schedules.tables import (
    SpringEnds,
    body_table,
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
        rows = FORCE_ROWS * model.world_count
        self._sphere_forces = SphereForces()
        self._sphere_forces.totals = wp.zeros((rows, model.sphere_count, 3), dtype=wp.int64, device=model.device)
        self._sphere_forces.stamps = wp.zeros((model.world_count, FORCE_ROWS), dtype=wp.int32, device=model.device)
        self._threads = min(_round_up(model.particle_count, WARP_THREADS), MOST_THREADS) if model.device.is_cuda else 1
        fresh = model.scene.normals == "fresh"
        ends = spring_ends(model)
        registers = _resident_registers(model, ends, self._threads)
        self._memory: list[Any] = []
        if registers:
            self._own_tables = [slot_table(model, ends)]
            self._kernel = resident_kernel(
                self._threads,
                -(-model.face_count // self._threads),
                kind_slots(ends),
                self._own_tables[0].faces.shape[0],
                model.sphere_count,
                ends.vary,
                model.string_count > 0,
                model.scene.ground is not None,
                fresh,
                registers,
            )
        else:
            capacity = _round_up(model.particle_count, STREAMING_STEP)
            traits = model_traits(model)
            self._own_tables = [spring_table(model, ends), water_table(model)]
            self._kernel = streaming_kernel(capacity, _power_of_two(model.sphere_count), traits, fresh)
            other_velocities = wp.zeros(
                (model.world_count, model.particle_count if traits.rubber else 0), dtype=wp.vec3, device=model.device
            )
            self._memory = [other_velocities]

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        velocities = VECTOR_BYTES * model.particle_count if model_traits(model).rubber else 0
        return velocities + FORCE_ROWS * (24 * model.sphere_count + 4)

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
                self._sphere_forces,
                *self._memory,
            ],
            block_dim=self._threads,
            device=model.device,
        )


def _resident_registers(model: Model, ends: SpringEnds, threads: int) -> int:
    """Registers a thread that let most blocks run at once on a multiprocessor; 0 if the springs do not fit in them."""
    if not thread_a_particle(model) or model.device.is_cpu or beyond_basics(model):
        return 0
    needed = 36 + (3 if ends.vary else 2) * sum(kind_slots(ends)) + 8 * model.sphere_count
    for blocks in range(_useful_blocks(model, threads), 0, -1):
        registers = min(REGISTERS // (threads * blocks) // 8 * 8, MOST_REGISTERS)
        if registers >= needed:
            return registers
    return 0


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
    reserved = 1024  # for the sums of areas
    capacity = (model.device.max_shared_memory_per_block - reserved) // BYTES_PER_PARTICLE
    return capacity // STREAMING_STEP * STREAMING_STEP


def _round_up(count: int, step: int) -> int:
    return -(-count // step) * step


def _power_of_two(count: int) -> int:
    return 1 << max(count - 1, 0).bit_length()

"""The `block` schedule: a thread block a world, whose points stay in shared memory for all substeps of a frame."""

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.block import FORCE_SLOTS
from balloon_warp.kernels.block_streaming import streaming_kernel
from balloon_warp.kernels.clock import count_frame
from balloon_warp.model import Model, State
from balloon_warp.schedules.refresh import refresh_ramp
from balloon_warp.schedules.tables import (
    body_table,
    face_table,
    obstacle_table,
    spring_table,
    string_table,
    world_state,
)

WARP_THREADS = 32
MOST_THREADS = 1024
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
        self._sphere_forces = wp.zeros(
            (FORCE_SLOTS * model.world_count, model.sphere_count, 3), dtype=wp.int64, device=model.device
        )
        capacity = _round_up(model.particle_count, STREAMING_STEP)
        self._kernel = streaming_kernel(capacity, _power_of_two(model.sphere_count))
        self._springs = [spring_table(model), model.scene.normals == "fresh"]
        self._threads = min(_round_up(model.particle_count, WARP_THREADS), MOST_THREADS) if model.device.is_cuda else 1

    def advance_frame(self, state: State) -> None:
        """One frame in one launch, after the ramp of the inflation."""
        model = self.model
        refresh_ramp(model, state)
        wp.launch_tiled(
            self._kernel,
            dim=[model.world_count],
            inputs=[
                *self._tables,
                *self._springs,
                model.substeps,
                model.step_seconds,
                world_state(state),
                self._sphere_forces,
            ],
            block_dim=self._threads,
            device=model.device,
        )
        wp.launch(count_frame, 1, inputs=[state.frame], device=model.device)


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

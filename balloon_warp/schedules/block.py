"""The `block` schedule: a thread block a world, whose points stay in shared memory for all substeps of a frame."""

from dataclasses import dataclass
from typing import Any

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.block_air import GAS_ROWS
from balloon_warp.kernels.block_contact import FORCE_ROWS, SphereForces
from balloon_warp.kernels.block_resident import resident_kernel
from balloon_warp.kernels.block_resident_air import resident_air_kernel
from balloon_warp.kernels.block_streaming import streaming_kernel
from balloon_warp.model import Model, State
from balloon_warp.model.memory import VECTOR_BYTES
from balloon_warp.schedules.health import health_table
from balloon_warp.schedules.refresh import refresh_ramp
from balloon_warp.schedules.residence import MOST_THREADS, WARP_THREADS, Residence, residence, residence_in_air
from balloon_warp.schedules.rings import Ring
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
from balloon_warp.schedules.traits import model_traits

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
        ends = spring_ends(model)
        home = residence(model, ends)
        airy_home = residence_in_air(model, ends)
        if home:
            self._recipe = _resident(model, ends, home)
        elif airy_home:
            self._recipe = _resident_in_air(model, ends, *airy_home)
        else:
            self._recipe = _streaming(model, ends)

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        ends = spring_ends(model)
        if residence(model, ends) or residence_in_air(model, ends):
            return 0
        velocities = VECTOR_BYTES * model.particle_count if model_traits(model).keeps_velocities else 0
        return velocities + FORCE_ROWS * (24 * model.sphere_count + 4) + GAS_ROWS * 8 * model.balloon_count

    def advance_frame(self, state: State) -> None:
        """One frame in one launch, after the ramp of the inflation."""
        model, recipe = self.model, self._recipe
        refresh_ramp(model, state)
        wp.launch_tiled(
            recipe.kernel,
            dim=[model.world_count],
            inputs=[*recipe.tables, model.substeps, model.step_seconds, world_state(state), *recipe.memory],
            block_dim=recipe.threads,
            device=model.device,
        )


@dataclass(frozen=True)
class Recipe:
    """A launch for a frame."""

    kernel: Any
    threads: int
    """of a block"""
    tables: list[Any]
    memory: list[Any]


def _resident(model: Model, ends: SpringEnds, home: Residence) -> Recipe:
    """For what the paper has, in worlds with a thread for every particle or two."""
    slots = slot_table(model, ends)
    kernel = resident_kernel(
        home.threads,
        home.particles_a_thread,
        -(-model.face_count // home.threads),
        kind_slots(ends),
        slots.faces.shape[0],
        model.sphere_count,
        ends.vary,
        model.string_count > 0,
        model.scene.ground is not None,
        model.scene.normals == "fresh",
        model.substeps % 2 == 1,
        home.registers,
    )
    tables = [body_table(model), string_table(model), obstacle_table(model), face_table(model), slots]
    tables.append(health_table(model))
    return Recipe(kernel, home.threads, tables, [])


def _resident_in_air(model: Model, ends: SpringEnds, home: Residence, rings: Ring) -> Recipe:
    """For pressure, gas and air."""
    kernel = resident_air_kernel(
        home.threads,
        kind_slots(ends),
        model.balloon_count,
        model.sphere_count,
        ends.vary,
        model.string_count > 0,
        model.scene.ground is not None,
        model.substeps % 2 == 1,
        home.registers,
    )
    slots = slot_table(model, ends, rings)
    tables = [body_table(model), string_table(model), obstacle_table(model), air_table(model), slots]
    tables.append(health_table(model))
    return Recipe(kernel, home.threads, tables, [])


def _streaming(model: Model, ends: SpringEnds) -> Recipe:
    """For all else, on any device."""
    capacity = _round_up(model.particle_count, STREAMING_STEP)
    traits = model_traits(model)
    fresh = model.scene.normals == "fresh"
    kept = model.particle_count if traits.keeps_velocities else 0
    memory = [
        _sphere_forces(model),
        wp.zeros((model.world_count, kept), dtype=wp.vec3, device=model.device),
        wp.zeros((GAS_ROWS * model.world_count, model.balloon_count), dtype=wp.float64, device=model.device),
    ]
    tables = [body_table(model), string_table(model), obstacle_table(model), face_table(model)]
    tables += [spring_table(model, ends), water_table(model), air_table(model), correction_table(model)]
    tables.append(health_table(model))
    return Recipe(
        kernel=streaming_kernel(capacity, _power_of_two(model.sphere_count), traits, fresh),
        threads=min(_round_up(model.particle_count, WARP_THREADS), MOST_THREADS) if model.device.is_cuda else 1,
        tables=tables,
        memory=memory,
    )


def _sphere_forces(model: Model) -> Any:
    """Room for the forces on spheres."""
    forces = SphereForces()
    forces.totals = wp.zeros(
        (FORCE_ROWS * model.world_count, model.sphere_count, 3), dtype=wp.int64, device=model.device
    )
    forces.stamps = wp.zeros((model.world_count, FORCE_ROWS), dtype=wp.int32, device=model.device)
    return forces


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

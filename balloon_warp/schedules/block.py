"""The `block` schedule: a thread block a world, whose points stay in shared memory for all substeps of a frame."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.schedules.block_memory import BlockMemory, Layout
from balloon_warp.kernels.schedules.block_resident import resident_kernel
from balloon_warp.kernels.schedules.block_streaming import streaming_kernel
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.schedules.fixtures import forget_looks, look_array
from balloon_warp.schedules.ramp import note_pressures, refresh_ramp
from balloon_warp.schedules.renumber import order_by_springs, renumbered
from balloon_warp.schedules.residence import Residence, residence
from balloon_warp.schedules.slots import kind_slots, slot_table
from balloon_warp.schedules.spring_ends import SpringEnds, spring_ends
from balloon_warp.schedules.tables import make_tables, world_state
from balloon_warp.schedules.traits import choosing_parameters, model_traits

BYTES_PER_PARTICLE = 24
"""two buffers of points"""
BYTES_WITH_VELOCITY = 36
RESERVED_BYTES = 2048
"""of shared memory, for spheres and the sums of areas and swellings of a balloon or two"""
CPU_TILE_BYTES = 1 << 18
"""the CPU stands in for a GPU here: a block of one thread, a tile of a GPU's size"""
CAPACITY_STEP = 512
"""capacities of the streaming kernel are multiples of this, so that few are compiled"""
THREADS_BESIDE = ((416, 72), (384, 80), (256, 80))
"""of a block whose threads go through many particles, and registers of each, where a multiprocessor has memory for two
such blocks: those whose last turn is fullest"""
THREADS_AMONG_OBSTACLES = 256, 128
"""the same among obstacles, which take more registers"""
THREADS_ALONE = 768, 80
"""where it has not"""
WARP_THREADS = 32


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
        self.model, self._traits = model, model_traits(model)
        self._recipe = _recipe(model, self._traits)
        self._tables = self._recipe.tables
        self._memory = BlockMemory()
        arrays = _working_arrays(model, self._traits, self._recipe.layout, Allocating(model.device))
        for name, array in arrays.items():
            setattr(self._memory, name, array)
        self._memory.numbers = wp.array(self._recipe.numbers, dtype=wp.int32, device=model.device)

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        room, traits = Counting(), model_traits(model)
        _working_arrays(model, traits, _layout(model, traits, spring_ends(model))[0], room)
        look_array(model, room)
        return room.bytes // model.world_count

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernel is chosen by."""
        return choosing_parameters(self._traits)

    def advance_frame(self, state: State) -> None:
        """One frame in one launch, after the ramp of the inflation."""
        refresh_ramp(self.model, state)
        forget_looks(self._tables)
        if self._traits.tells_time:
            wp.copy(self._memory.frame, state.frame)
        wp.launch_tiled(
            self._recipe.kernel,
            dim=[self.model.world_count],
            inputs=[self._tables, *self._recipe.slots, world_state(state), self._memory],
            block_dim=self._recipe.layout.threads,
            device=self.model.device,
        )
        note_pressures(self.model, self._traits, state)


@dataclass(frozen=True)
class Recipe:
    """A launch for a frame."""

    kernel: Any
    layout: Layout
    tables: Any
    slots: list[Any]
    """the table of springs that stay in registers, if they do"""
    numbers: NDArray[np.int64]
    """of the particles in the tables, which may have them in another order"""


def _recipe(model: Model, traits: Traits) -> Recipe:
    ends = spring_ends(model)
    layout, residing = _layout(model, traits, ends)
    if residing:
        slots = [slot_table(model, ends, residing.rings)]
        own_order = np.arange(model.particle_count)
        tables = make_tables(model, traits, in_block=traits.in_water)
        return Recipe(resident_kernel(traits, layout), layout, tables, slots, own_order)
    order = order_by_springs(model, ends)
    tables = make_tables(renumbered(model, order), traits, in_block=True)
    return Recipe(streaming_kernel(traits, layout), layout, tables, [], order)


def _layout(model: Model, traits: Traits, ends: SpringEnds) -> tuple[Layout, Residence | None]:
    """How a world lies on a block, and, where its particles stay in registers, how."""
    residing = residence(model, traits, ends)
    odd = model.substeps % 2 == 1
    if residing:
        layout = Layout(
            threads=residing.threads,
            capacity=residing.threads * residing.particles_a_thread,
            resident=True,
            two=residing.particles_a_thread == 2,
            faces=model.face_count if traits.aims and not traits.aims_on_the_way else 1,
            kind_slots=kind_slots(ends),
            rings=residing.rings is not None,
            odd_substeps=odd,
            registers=residing.registers,
        )
        return layout, residing
    capacity = _round_up(model.particle_count, CAPACITY_STEP)
    threads, registers = _streaming_threads(model, traits)
    layout = Layout(
        threads,
        capacity,
        resident=False,
        odd_substeps=odd,
        fast_velocities=not traits.keeps_velocities and _room_for_velocities(model, traits),
        registers=registers,
    )
    return layout, None


def _room_for_velocities(model: Model, traits: Traits) -> bool:
    """Whether velocities fit in shared memory, too, and leave half of it to the cache of what is read from tables, by
    two blocks. A position correction reads and writes them so often that it wants them there all the same."""
    most = _most_particles(model, BYTES_WITH_VELOCITY)
    return model.particle_count <= (most if traits.corrected else most // 4)


def _streaming_threads(model: Model, traits: Traits) -> tuple[int, int]:
    """Of a block, and the registers of each."""
    threads, registers = THREADS_ALONE
    if 2 * model.particle_count <= _most_particles(model):
        threads, registers = min(THREADS_BESIDE, key=lambda each: _round_up(model.particle_count, each[0]))
        if traits.fixtures:
            threads, registers = THREADS_AMONG_OBSTACLES
    if model.device.is_cpu:
        return 1, registers
    return min(_round_up(model.particle_count, WARP_THREADS), threads), registers


def _working_arrays(model: Model, traits: Traits, layout: Layout, room: Room) -> dict[str, Any]:
    """The memory of `BlockMemory`; arrays that a scene does not need are empty."""
    worlds, streaming = model.world_count, not layout.resident

    def vectors(needed: bool, count: int = model.particle_count) -> Any:
        return room.array((worlds, count if needed else 0), wp.vec3)

    return {
        "face_centers": vectors(streaming and traits.aims and not traits.rings, model.face_count),
        "face_area_vectors": vectors(streaming and traits.aims and not traits.rings, model.face_count),
        "aims": vectors(streaming and traits.keeps_aims),
        "velocities": vectors(streaming and not layout.fast_velocities),
        "other_velocities": vectors(traits.looks_at_velocities or (streaming and traits.keeps_velocities)),
        "inflations": vectors(streaming and traits.keeps_inflations and traits.pressures),
        "frame": room.array((1,), wp.int32),
    }


def fits_in_block(model: Model) -> bool:
    """Whether a world's points, in two buffers, fit in the shared memory of a block."""
    return model.particle_count <= _most_particles(model)


def _most_particles(model: Model, bytes_per_particle: int = BYTES_PER_PARTICLE) -> int:
    if model.device.is_cpu:
        return CPU_TILE_BYTES // bytes_per_particle
    sums = 1 << 10  # bytes for each further balloon or sphere, of the most warps
    presses = 1 << 13 if model.scene.contact == "impulse" else 0
    reserved = RESERVED_BYTES + presses + sums * (model.balloon_count + model.sphere_count)
    capacity = (model.device.max_shared_memory_per_block - reserved) // bytes_per_particle
    return capacity // CAPACITY_STEP * CAPACITY_STEP


def _round_up(count: int, step: int) -> int:
    return -(-count // step) * step

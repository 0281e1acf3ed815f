"""A launch of a thread block a world, whose points stay in shared memory for all substeps of a frame."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.contact.boxes import ARE_NEAR
from balloon_warp.kernels.schedules.block.memory import BlockMemory, Layout
from balloon_warp.kernels.schedules.block.resident import resident_kernel
from balloon_warp.kernels.schedules.block.streaming import streaming_kernel
from balloon_warp.kernels.traits import Traits
from balloon_warp.launching import begin_loading, launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Room
from balloon_warp.schedules.block_room import CAPACITY_STEP, most_particles
from balloon_warp.schedules.films import film_entries, film_layout, film_order, film_table, held_layout
from balloon_warp.schedules.fixtures import forget_looks, look_arrays
from balloon_warp.schedules.later import later_array
from balloon_warp.schedules.renumber import order_by_springs, renumbered
from balloon_warp.schedules.residence import Residence, residence
from balloon_warp.schedules.rings import least_valence
from balloon_warp.schedules.slots import kind_slots, slot_table
from balloon_warp.schedules.solids import solid_arrays
from balloon_warp.schedules.spring_ends import SpringEnds, spring_ends
from balloon_warp.schedules.tables import make_tables, world_state
from balloon_warp.schedules.touching import touch_arrays

BYTES_WITH_VELOCITY = 36
"""two buffers of points and a velocity"""
THREADS_BESIDE = ((416, 72), (384, 80), (256, 80))
"""of a block whose threads go through many particles, and registers of each, where a multiprocessor has memory for two
such blocks: those whose last turn is fullest"""
THREADS_IN_CONTACT = 256, 128
"""the same where particles meet obstacles or each other, which takes more registers"""
THREADS_ALONE = 768, 80
"""where it has not"""
WARP_THREADS = 32


class BlockLaunch:
    """Advances worlds by a frame in one launch: all of them, or those that the traits are for."""

    def __init__(self, model: Model, traits: Traits):
        self.model, self._traits = model, traits
        self._recipe = _recipe(model, traits)
        self.tables = self._recipe.tables
        self.memory = BlockMemory()
        for name, array in _working_arrays(model, traits, self._recipe.layout, Allocating(model.device)).items():
            setattr(self.memory, name, array)
        for arrays in (touch_arrays, solid_arrays):
            for name, array in arrays(model, traits, Allocating(model.device)).items():
                setattr(self.memory.contacts, name, array)
        self.memory.contacts.later = _later(model, traits, self._recipe.layout, Allocating(model.device))
        self.memory.contacts.near_balloons.fill_(int(ARE_NEAR))  # they may have been, in another schedule
        self.memory.numbers = wp.array(self._recipe.numbers, dtype=wp.int32, device=model.device)

    @staticmethod
    def allot(model: Model, traits: Traits, room: Room) -> None:
        """Ask for all memory that it keeps."""
        layout, _ = _layout(model, traits, spring_ends(model))
        _working_arrays(model, traits, layout, room)
        _later(model, traits, layout, room)
        touch_arrays(model, traits, room)
        solid_arrays(model, traits, room)
        look_arrays(model, room)

    @property
    def crowded(self) -> int:
        """As of a schedule."""
        return int(self.memory.contacts.crowded.numpy().sum())

    def keep_time(self, state: State) -> None:
        """As it is when a frame begins."""
        if self._traits.tells_time:
            wp.copy(self.memory.frame, state.frame)

    def begin_loading(self) -> None:
        """Compile ahead what a frame needs."""
        begin_loading(self._recipe.kernel, self.model.device)

    def advance(self, state: State) -> None:
        """A frame."""
        if self._traits.stands_on_fixtures:
            forget_looks(self.tables)
        launch_tiled(
            self._recipe.kernel,
            dim=[self.model.world_count],
            inputs=[self.tables, *self._recipe.slots, world_state(state), self.memory],
            block_dim=self._recipe.layout.threads,
            device=self.model.device,
        )


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
        own_order = film_order(model, layout.film)
        if layout.film and layout.film.own_slots:
            ordered = renumbered(model, own_order)
            slots = [slot_table(ordered, spring_ends(ordered), residing.rings)]
            tables = make_tables(ordered, traits, in_block=traits.in_water)
        else:
            slots = [slot_table(model, ends, residing.rings)]
            tables = make_tables(model, traits, in_block=traits.in_water)
        tables.membranes.films = film_table(model, layout.film, resident=True)
        return Recipe(resident_kernel(traits, layout), layout, tables, slots, own_order)
    # where balloons or solids touch, everyone finds everyone's points in the state, and in its order
    order = np.arange(model.particle_count) if traits.in_blocks else order_by_springs(model, ends)
    ordered = renumbered(model, order)
    tables = make_tables(ordered, traits, in_block=True)
    tables.membranes.films = film_table(ordered, layout.film, resident=False)
    return Recipe(streaming_kernel(traits, layout), layout, tables, [], order)


def _layout(model: Model, traits: Traits, ends: SpringEnds) -> tuple[Layout, Residence | None]:
    """How a world lies on a block, and, where its particles stay in registers, how."""
    odd, film = model.substeps % 2 == 1, film_layout(model, traits)
    residing = None if traits.meets_solids else residence(model, traits, ends, film)
    if residing:
        held = residing.held
        may_turn = residing.one_tile and model.balloon_count == 1
        film = held_layout(model, film, held, residing.threads, may_turn) if film else None
        layout = Layout(
            threads=residing.threads,
            capacity=residing.threads * residing.particles_a_thread,
            resident=True,
            two=residing.particles_a_thread == 2,
            faces=film_entries(model, film)
            if film
            else model.face_count
            if traits.aims and not traits.aims_on_the_way
            else 1,
            kind_slots=kind_slots(ends),
            rings=least_valence(residing.rings) if residing.rings else 0,
            one_tile=residing.one_tile,
            nothing_where_none=residing.rings is not None or (film is not None and film.areas and film.slots <= 4),
            odd_substeps=odd and not residing.one_tile,
            registers=residing.registers,
            film=film,
        )
        return layout, residing
    capacity = _round_up(model.particle_count, CAPACITY_STEP)
    threads, registers = _streaming_threads(model, traits)
    layout = Layout(
        threads,
        capacity,
        resident=False,
        odd_substeps=odd,
        fast_velocities=not traits.keeps_velocities and not traits.in_blocks and _room_for_velocities(model, traits),
        registers=registers,
        film=film._replace(areas=False) if film else None,  # from global memory they are no sooner read than found
    )
    return layout, None


def _room_for_velocities(model: Model, traits: Traits) -> bool:
    """Whether velocities fit in shared memory, too, and leave half of it to the cache of what is read from tables, by
    two blocks. A position correction reads and writes them so often that it wants them there all the same."""
    most = most_particles(model, BYTES_WITH_VELOCITY)
    return model.particle_count <= (most if traits.corrected else most // 4)


def _streaming_threads(model: Model, traits: Traits) -> tuple[int, int]:
    """Of a block, and the registers of each."""
    threads, registers = THREADS_ALONE
    if 2 * model.particle_count <= most_particles(model):
        threads, registers = min(THREADS_BESIDE, key=lambda each: _round_up(model.particle_count, each[0]))
        if traits.stands_on_fixtures or traits.in_blocks:
            threads, registers = THREADS_IN_CONTACT
    if model.device.is_cpu:
        return 1, registers
    return min(_round_up(model.particle_count, WARP_THREADS), threads), registers


def _working_arrays(model: Model, traits: Traits, layout: Layout, room: Room) -> dict[str, Any]:
    """The memory of `BlockMemory`; arrays that a scene does not need are empty."""
    worlds, streaming, film = model.world_count, not layout.resident, layout.film
    entries = film_entries(model, film) if film else 0
    shows_velocities = traits.looks_at_velocities
    keeps_velocities = not layout.fast_velocities if streaming else shows_velocities and traits.frames == "free"

    def vectors(needed: bool, count: int = model.particle_count) -> Any:
        return room.array((worlds, count if needed else 0), wp.vec3)

    return {
        "face_centers": vectors(streaming and traits.aims and not traits.rings, model.face_count),
        "face_area_vectors": vectors(streaming and traits.aims and not traits.rings, model.face_count),
        "aims": vectors(streaming and traits.keeps_aims),
        "velocities": vectors(keeps_velocities),
        "other_velocities": vectors(shows_velocities or (streaming and traits.keeps_velocities)),
        "inflations": vectors(streaming and traits.keeps_inflations and traits.pressures),
        "peaks": room.array((worlds, model.triangle_count if traits.softens else 0), wp.float32),
        "film_pulls": vectors(streaming and film is not None, entries),
        "frame": room.array((1,), wp.int32),
    }


def _later(model: Model, traits: Traits, layout: Layout, room: Room) -> Any:
    return later_array(model, traits.may_put_off and not layout.resident, room)


def _round_up(count: int, step: int) -> int:
    return -(-count // step) * step

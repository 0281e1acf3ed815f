"""The `block` schedule: a thread block a world, which advances it by a frame in one launch."""

from typing import Any

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.source import arguments_of_frame, kernel_of_frame
from balloon_warp.kernels.schedules.pieces import Step, values_of
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working
from balloon_warp.launching import begin_loading, launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.schedules.block_layout import layout_of, step_of
from balloon_warp.schedules.block_room import fits_in_block, most_particles
from balloon_warp.schedules.busy_worlds import BusyWorlds
from balloon_warp.schedules.films import film_entries, film_table
from balloon_warp.schedules.fixtures import look_arrays
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.launches import working_arrays
from balloon_warp.schedules.membranes import left_array
from balloon_warp.schedules.outlook import free_traits, has_free_frames
from balloon_warp.schedules.rings import quad_rings
from balloon_warp.schedules.slots import slot_table
from balloon_warp.schedules.spring_ends import spring_ends
from balloon_warp.schedules.tables import make_tables, world_state
from balloon_warp.schedules.traits import choosing_parameters, model_traits


class BlockSchedule:
    """Advances a state by whole frames, in place. Bit-reproducible.

    Raises:
        InputError: a world does not fit in a block's shared memory.
    """

    name = "block"
    capturable = True

    def __init__(self, model: Model):
        require_block(model, self.name)
        self.model, self._traits, room = model, model_traits(model), Allocating(model.device)
        self._busy = BusyWorlds(model, self._traits) if has_free_frames(self._traits) else None
        traits = free_traits(self._traits) if self._busy else self._traits
        self.layout = layout_of(model, traits)
        self.step = step_of(traits, self.layout)
        tables = make_tables(model, traits, in_block=not self.layout.held or traits.in_water)
        tables.membranes.films = film_table(model, self.layout.film)
        self._working = self._busy.working if self._busy else _working(model, traits, room)
        self._given = {"t": tables, "working": self._working, **_values(model, self.step, self.layout, room)}
        if self.layout.held:
            ring = quad_rings(model) if self.layout.rings else None
            self._given["slots"] = slot_table(model, spring_ends(model), ring)
        self._framing = Framing(model, self._traits, tables, self._working)

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        room, traits = Counting(), model_traits(model)
        if has_free_frames(traits):
            BusyWorlds.allot(model, traits, room)
            traits = free_traits(traits)
        layout = layout_of(model, traits)
        working_arrays(model, traits, room)
        _values(model, step_of(traits, layout), layout, room)
        left_array(model, room)
        look_arrays(model, room)
        return room.bytes // model.world_count

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernel is chosen by."""
        return choosing_parameters(self._traits)

    @property
    def crowded(self) -> int:
        """As of a schedule."""
        return self._busy.crowded if self._busy else 0

    @property
    def _kernel(self) -> Any:
        return kernel_of_frame(self.step, self.layout)

    def advance_frame(self, state: State) -> None:
        """One frame."""
        begin_loading(self._kernel, self.model.device)
        if self._busy:
            self._busy.begin_loading(self.capturable)
        self._framing.begin(state)
        if self._busy:
            self._busy.find(state)
        given = {**self._given, "state": world_state(state)}
        launch_tiled(
            self._kernel,
            dim=[self.model.world_count],
            inputs=[given[name] for name in arguments_of_frame(self.step, self.layout)],
            block_dim=self.layout.threads,
            device=self.model.device,
        )
        if self._busy:
            self._busy.advance(state)
        self._framing.end(state)


def require_block(model: Model, schedule: str) -> None:
    """Make sure that a world fits in a block.

    Raises:
        InputError: it does not.
    """
    if not fits_in_block(model):
        raise InputError(
            f"--schedule {schedule}: a world of {model.particle_count:,} particles is too large for a block's shared "
            f"memory, which holds {most_particles(model):,}; use gather"
        )


def _working(model: Model, traits: Traits, room: Room) -> Any:
    working = Working()
    for name, array in working_arrays(model, traits, room).items():
        setattr(working, name, array)
    return working


def _values(model: Model, step: Step, layout: Layout, room: Room) -> dict[str, Any]:
    """Allocate what lives from piece to piece, and has no place in the block."""
    counts = {"particle": model.particle_count, "face": model.face_count, "balloon": model.balloon_count}
    named, found = arguments_of_frame(step, layout), {}
    for value, dtype in values_of(step).items():
        if f"all_{value}" in named:
            shape = (model.world_count, counts[step.owner(value)])
            found[f"all_{value}"] = room.array(shape, wp.float32 if dtype is float else dtype)
    vectors = {
        "film_pulls": film_entries(model, layout.film) if layout.film else 0,
        "second_velocities": model.particle_count,
    }
    return found | {
        name: room.array((model.world_count, count), wp.vec3) for name, count in vectors.items() if name in named
    }

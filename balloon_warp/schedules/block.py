"""The `block` schedule: a thread block a world."""

from balloon_warp.errors import InputError
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Counting
from balloon_warp.schedules.block_launch import BlockLaunch
from balloon_warp.schedules.block_room import fits_in_block, most_particles
from balloon_warp.schedules.busy_worlds import BusyWorlds
from balloon_warp.schedules.outlook import free_traits, has_free_frames
from balloon_warp.schedules.ramp import note_pressures, refresh_ramp, weigh_air
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
        self.model, self._traits = model, model_traits(model)
        self.busy = BusyWorlds(model, self._traits) if has_free_frames(self._traits) else None
        self._worlds = BlockLaunch(model, free_traits(self._traits) if self.busy else self._traits)
        if self.busy:
            self._worlds.memory.free = self.busy.outlook.table

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        room, traits = Counting(), model_traits(model)
        if has_free_frames(traits):
            BusyWorlds.allot(model, traits, room)
            traits = free_traits(traits)
        BlockLaunch.allot(model, traits, room)
        return room.bytes // model.world_count

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernel is chosen by."""
        return choosing_parameters(self._traits)

    @property
    def crowded(self) -> int:
        """How often a triangle that a particle may touch had no place in its list since it was made, in all worlds."""
        return (self.busy.launch if self.busy else self._worlds).crowded

    def advance_frame(self, state: State) -> None:
        """One frame, after the ramp of the inflation: in one launch, or the worlds that may meet something in one of
        their own."""
        self._worlds.begin_loading()
        if self.busy:
            self.busy.begin_loading(self.capturable)
        refresh_ramp(self.model, state)
        weigh_air(self.model, self._traits, self._worlds.tables, state, self._worlds.memory.numbers)
        self._worlds.keep_time(state)
        if self.busy:
            self.busy.find(state)
        self._worlds.advance(state)
        if self.busy:
            self.busy.advance(state)
        note_pressures(self.model, self._traits, state)


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

"""The `block` schedule: a thread block a world, which advances it by a frame in one launch."""

from balloon_warp.errors import InputError
from balloon_warp.kernels.schedules.block.source import source_of_frame
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Counting
from balloon_warp.schedules.block_frames import BlockFrames
from balloon_warp.schedules.block_layout import layout_of, step_of
from balloon_warp.schedules.block_room import fits_in_block, most_particles
from balloon_warp.schedules.busy_worlds import BusyWorlds
from balloon_warp.schedules.features import choosing_parameters, model_features
from balloon_warp.schedules.fixtures import look_arrays
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.membranes import left_array
from balloon_warp.schedules.outlook import free_features, has_free_frames


class BlockSchedule:
    """Advances a state by whole frames, in place. Bit-reproducible.

    Raises:
        InputError: a world does not fit in a block's shared memory.
    """

    name = "block"
    capturable = True

    def __init__(self, model: Model):
        require_block(model, self.name)
        self.model, self._features, room = model, model_features(model), Allocating(model.device)
        self.busy = BusyWorlds(model, self._features) if has_free_frames(self._features) else None
        features = free_features(self._features) if self.busy else self._features
        self.frames = BlockFrames(model, features, room, self.busy.working if self.busy else None)
        tables, numbers = self.frames.tables, self.frames.numbers
        self._framing = Framing(model, self._features, tables, numbers=numbers, looks=self.busy is not None)

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Return the device memory that it keeps for each world, beside the state."""
        room, features = Counting(), model_features(model)
        shares = has_free_frames(features)
        if shares:
            BusyWorlds.allot(model, features, room)
            features = free_features(features)
        BlockFrames.allot(model, features, room, shares)
        left_array(model, room)
        look_arrays(model, room)
        return room.bytes // model.world_count

    @staticmethod
    def source_of(model: Model) -> str:
        """Return the text of the kernel that advances worlds, or those whose frame is free."""
        features = model_features(model)
        features = free_features(features) if has_free_frames(features) else features
        layout = layout_of(model, features)
        return source_of_frame(step_of(features, layout), layout)

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernel is chosen by."""
        return choosing_parameters(self._features)

    @property
    def overflow(self) -> int:
        """Number of candidate overflows, as for every schedule."""
        return self.busy.overflow if self.busy else 0

    def advance_frame(self, state: State) -> None:
        """Advance all worlds by a frame."""
        self.frames.begin_loading()
        if self.busy:
            self.busy.begin_loading(self.capturable)
        self._framing.begin(state)
        if self.busy:
            self.busy.find(state)
        self.frames.advance(state)
        if self.busy:
            self.busy.advance(state)
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

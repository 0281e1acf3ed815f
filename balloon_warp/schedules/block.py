"""The `block` schedule: a thread block a world, which advances it by a frame in one launch."""

from balloon_warp.errors import InputError
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.schedules.block import source_of_frame
from balloon_warp.model import Model, State
from balloon_warp.model.state import Allocating, Room
from balloon_warp.schedules.block_layout import BlockFrames, fits_in_block, layout_of, max_particles, step_of
from balloon_warp.schedules.contact_horizon import has_free_frames
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.free_frames import FreeFramesSchedule


class BlockSchedule(FreeFramesSchedule):
    """Advances a state by whole frames, in place. Bit-reproducible.

    Raises:
        InputError: a world does not fit in a block's shared memory.
    """

    name = "block"

    def __init__(self, model: Model):
        require_block(model, self.name)
        super().__init__(model)
        working = self.busy.working if self.busy else None
        self.frames = BlockFrames(model, self.features, Allocating(model.device), working)
        tables, numbers = self.frames.tables, self.frames.numbers
        self.framing = Framing(
            model, self.all_features, tables, numbers=numbers, checks_particles=self.busy is not None
        )

    @classmethod
    def leaves_busy(cls, features: Features) -> bool:
        """Return whether worlds may be busy."""
        return has_free_frames(features)

    @classmethod
    def allocate(cls, model: Model, features: Features, room: Room, shares_working: bool) -> None:
        """Allocate the memory of frames in blocks."""
        BlockFrames.allocate(model, features, room, shares_working)

    @classmethod
    def source_of(cls, model: Model) -> str:
        """Return the text of the kernel that advances worlds, or those whose frame is free."""
        features = cls.features_of(model)
        layout = layout_of(model, features)
        return source_of_frame(step_of(features, layout), layout)

    def begin_loading(self) -> None:
        """Compile the kernel ahead."""
        self.frames.begin_loading()

    def advance_free(self, state: State) -> None:
        """Run the substeps of a frame in blocks."""
        self.frames.advance(state)


def require_block(model: Model, schedule: str) -> None:
    """Make sure that a world fits in a block.

    Raises:
        InputError: it does not.
    """
    if not fits_in_block(model):
        raise InputError(
            f"schedule {schedule}: a world of {model.particle_count:,} particles is too large for a block's shared "
            f"memory, which holds {max_particles(model):,}; use gather"
        )

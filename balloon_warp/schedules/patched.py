"""The `gather` schedule of large worlds that may touch something: patches in free frames, and launches in others."""

from balloon_warp.kernels.features import Features
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.free_frames import FreeFramesSchedule
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.launched import Launches


class PatchedSchedule(FreeFramesSchedule):
    """Advances a state by whole frames, in place. Bit-reproducible.

    For models whose free frames can be moved in patches, see `choose`.
    """

    name = "gather"

    def __init__(self, model: Model):
        super().__init__(model)
        assert self.busy
        self._free = GatherSchedule(model, self.features, self.busy.working)
        self.framing = Framing(model, self.all_features, self._free.tables)

    @classmethod
    def leaves_busy(cls, features: Features) -> bool:
        """Return that worlds may be busy: others are moved by `GatherSchedule` itself."""
        return True

    @classmethod
    def allot(cls, model: Model, features: Features, room: Room, shares_working: bool) -> None:
        """Ask for the memory of launches and patches."""
        Launches.allot(model, GatherSchedule.step_of(model, features), room)
        GatherSchedule.allot(model, features, room)

    def begin_loading(self) -> None:
        """Compile nothing ahead: patches load as they are launched."""

    def advance_free(self, state: State) -> None:
        """Run the substeps of a frame in patches."""
        self._free.advance_patches(state)

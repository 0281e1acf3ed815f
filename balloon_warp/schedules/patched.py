"""The `gather` schedule of large worlds that may touch something: patches in free frames, and launches in others."""

from balloon_warp.model import Model, State
from balloon_warp.model.memory import Counting
from balloon_warp.schedules.busy_worlds import BusyWorlds
from balloon_warp.schedules.features import choosing_parameters, model_features
from balloon_warp.schedules.fixtures import look_arrays
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.launches import Launches
from balloon_warp.schedules.membranes import left_array
from balloon_warp.schedules.outlook import free_features


class PatchedSchedule:
    """Advances a state by whole frames, in place. Bit-reproducible.

    For models whose free frames can be moved in patches, see `choose`.
    """

    name = "gather"
    capturable = True

    def __init__(self, model: Model):
        self.model, self._features = model, model_features(model)
        self.busy = BusyWorlds(model, self._features)
        self._free = GatherSchedule(model, free_features(self._features), self.busy.working)
        self._framing = Framing(model, self._features, self._free.tables)

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Return the device memory that it keeps for each world, beside the state."""
        room, features = Counting(), model_features(model)
        BusyWorlds.allot(model, features, room)
        free = free_features(features)
        Launches.allot(model, GatherSchedule.step_of(model, free), room)
        GatherSchedule.allot(model, free, room)
        left_array(model, room)
        look_arrays(model, room)
        return room.bytes // model.world_count

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernels are chosen by."""
        return choosing_parameters(self._features)

    @property
    def overflow(self) -> int:
        """Number of candidate overflows, as for every schedule."""
        return self.busy.overflow

    def advance_frame(self, state: State) -> None:
        """Advance all worlds by a frame."""
        self.busy.begin_loading(self.capturable)
        self._framing.begin(state)
        self.busy.find(state)
        self._free.advance_patches(state)
        self.busy.advance(state)
        self._framing.end(state)

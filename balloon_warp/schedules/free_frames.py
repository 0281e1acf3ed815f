"""Frames of all worlds: those that are free by the schedule itself, and those that may touch something beside it."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

from balloon_warp.kernels.features import Features
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Counting, Room
from balloon_warp.schedules.contact_lists import ContactLists
from balloon_warp.schedules.features import choosing_parameters, model_features
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.membranes import left_array
from balloon_warp.schedules.outlook import free_features
from balloon_warp.schedules.tables import look_arrays

if TYPE_CHECKING:
    from balloon_warp.schedules.busy_worlds import BusyWorlds


class FreeFramesSchedule(ABC):
    """Advances a state by whole frames, in place. Bit-reproducible.

    Busy worlds, those that may touch something in the frame, are left to launches or blocks of their own.
    """

    name: ClassVar[str]
    capturable: bool = True
    busy_recorded: ClassVar[bool] = True
    """Whether a recorded frame has the kernels of busy worlds, even if there are none"""
    framing: Framing

    def __init__(self, model: Model):
        self.model, self.all_features = model, model_features(model)
        self.features = self.features_of(model)
        """Features of worlds that the schedule advances itself"""
        self.busy = _busy_worlds(model, self.all_features) if self.leaves_busy(self.all_features) else None

    @classmethod
    @abstractmethod
    def leaves_busy(cls, features: Features) -> bool:
        """Return whether worlds may be busy."""

    @classmethod
    @abstractmethod
    def allot(cls, model: Model, features: Features, room: Room, shares_working: bool) -> None:
        """Ask for all memory that free frames keep beside that of all schedules."""

    @abstractmethod
    def begin_loading(self) -> None:
        """Compile kernels of free frames ahead."""

    @abstractmethod
    def advance_free(self, state: State) -> None:
        """Run the substeps of a frame in the worlds that are free."""

    @classmethod
    def features_of(cls, model: Model) -> Features:
        """Return the features of worlds that the schedule advances itself."""
        features = model_features(model)
        return free_features(features) if cls.leaves_busy(features) else features

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Return the device memory that it keeps for each world, beside the state."""
        room, features = Counting(), model_features(model)
        shares = cls.leaves_busy(features)
        if shares:
            from balloon_warp.schedules.busy_worlds import BusyWorlds

            BusyWorlds.allot(model, features, room)
        cls.allot(model, cls.features_of(model), room, shares)
        left_array(model, room)
        look_arrays(model, room)
        return room.bytes // model.world_count

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernels are chosen by."""
        return choosing_parameters(self.all_features)

    @property
    def overflow(self) -> int:
        """Number of contacts in all worlds that were ignored, since lists had no place for them and could not grow."""
        return self.contact_lists.ignored if self.contact_lists else 0

    @property
    def contact_lists(self) -> ContactLists | None:
        """Lists of contacts that may have to grow, if there are any."""
        return self.busy.contact_lists if self.busy else None

    def advance_frame(self, state: State) -> None:
        """Advance all worlds by a frame."""
        self.begin_frame(state)
        if self.busy:
            self.busy.advance(state)
        self.framing.end(state)

    def begin_frame(self, state: State) -> None:
        """Begin a frame, find the busy worlds, and advance the others."""
        self.begin_loading()
        if self.busy:
            self.busy.begin_loading(self.capturable and self.busy_recorded)
        self.framing.begin(state)
        if self.busy:
            self.busy.find(state)
        self.advance_free(state)
        if self.busy:
            self.busy.outlook.look_back(state)


def _busy_worlds(model: Model, features: Features) -> "BusyWorlds":
    """Return the busy worlds of a model; their kernels load only where there may be any."""
    from balloon_warp.schedules.busy_worlds import BusyWorlds

    return BusyWorlds(model, features)

"""Schedules that launch a kernel for each piece of a substep: `gather`, `scatter`, and the projective solver."""

from abc import ABC
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.schedules.pieces import Step, cut
from balloon_warp.kernels.substep import NOTHING, Instead, phases_of
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.schedules.balloon_contact import TouchLaunches
from balloon_warp.schedules.contact_lists import ContactLists, has_lists, start_of_frame
from balloon_warp.schedules.features import choosing_parameters, model_features
from balloon_warp.schedules.fixtures import look_arrays
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.launches import Launches, Moving, Own
from balloon_warp.schedules.membranes import left_array
from balloon_warp.schedules.recorded_frame import FramePiece
from balloon_warp.schedules.rounds import Rounds
from balloon_warp.schedules.tables import make_tables
from balloon_warp.schedules.tears import tear_arrays
from balloon_warp.schedules.touch_table import substeps_of_search


class LaunchedSchedule(ABC):
    """Advances a state by whole frames, in place, piece by piece."""

    name: ClassVar[str]
    capturable = True
    watchable: ClassVar[bool] = True
    """Whether each substep ends in the state"""
    fast_math: ClassVar[bool] = False
    """Whether divisions and roots are a GPU's own, with errors in the last two bits"""
    phases: ClassVar[Sequence[Phase]] = ()
    """List of phases that the schedule executes; the step, when empty"""
    instead: ClassVar[Instead] = NOTHING
    look: ClassVar[Look]

    def __init__(self, model: Model, features: Features | None = None):
        self.model, self.features = model, features or model_features(model)
        self.tables = make_tables(model, self.features)
        self.vectors = self.allot(model, self.features, room := Allocating(model.device))
        """Memory of the schedule's own"""
        step = self.step_of(model, self.features)
        self.launches = Launches(model, step, self.tables, room, self.own(), fast_math=self.fast_math)
        self._touch = None
        if self.features.touches:
            self._touch = TouchLaunches(model, self.features, self.tables, self.launches.working, self.fast_math)
        self.contact_lists = None
        """Lists of contacts that may have to grow, if there are any"""
        if has_lists(self.features):
            self.contact_lists = ContactLists(model, self.features, self.launches.working)
        self.framing = Framing(model, self.features, self.tables, self.launches.working)
        self.rounds = Rounds(model, substeps_of_search(model) if self._touch else 0, self.launches.clock)

    @classmethod
    def step_of(cls, model: Model, features: Features) -> Step:
        """Return the phases of the model, in pieces."""
        return cut(phases_of(features, cls.phases, cls.instead), features, cls.look, doubles=not cls.watchable)

    def own(self) -> Mapping[str, Own]:
        """Return the phases that the schedule executes itself, by name."""
        return {"touch_balloons": self._press}

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernels are chosen by."""
        return choosing_parameters(self.features)

    @property
    def overflow(self) -> int:
        """Number of contacts in all worlds that were ignored, since lists had no place for them and could not grow."""
        return self.contact_lists.ignored if self.contact_lists else 0

    @property
    def pieces(self) -> list[FramePiece]:
        """Pieces of a frame that are recorded: one."""
        return [FramePiece(self.advance_frame, is_short=self.rounds.are_short)]

    @classmethod
    def allot(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Ask for its own memory, beside that of all launches."""
        return ()

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Return the device memory that it keeps for each world, beside the state."""
        room, features = Counting(), model_features(model)
        Launches.allot(model, cls.step_of(model, features), room)
        if has_lists(features):
            start_of_frame(model, room)
        left_array(model, room)
        tear_arrays(model, room)
        cls.allot(model, features, room)
        look_arrays(model, room)
        return room.bytes // model.world_count

    def advance_frame(self, state: State) -> None:
        """Advance all worlds by a frame."""
        self.launches.begin_loading()
        self.framing.begin(state)
        self.go_through(state, wp.copy)
        self.framing.end(state)

    def go_through(self, state: State, copy: Callable[[wp.array, wp.array], None]) -> None:
        """Launch the substeps of a frame.

        Args:
            copy: function of (target, source) that leaves points or velocities in the state.
        """

        def launch_substeps(numbers: range) -> None:
            now = kept = (state.points, state.velocities)
            for substep in numbers:
                now = self.launches.substep(state, substep, now)
            for target, source in zip(kept, now, strict=True):
                if source is not target:
                    copy(target, source)

        self.rounds.go_through(launch_substeps)

    def substeps(self, state: State) -> Iterator[int]:
        """Return the one frame that pauses after each substep, with its number from 0."""
        now = kept = (state.points, state.velocities)
        self.launches.begin_loading()
        self.framing.begin(state)
        for substep in range(self.model.substeps):
            now = self.launches.substep(state, substep, now)
            yield substep
        for source, target in zip(now, kept, strict=True):
            if source is not target:
                wp.copy(target, source)
        self.framing.end(state)

    def _press(self, state: State, substep: int, now: Moving) -> None:
        """Apply contact forces between balloons, and search for contacts now and then."""
        assert self._touch is not None
        self._touch.search(state, substep, *now)
        self._touch.press(state, *now)

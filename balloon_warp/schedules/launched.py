"""Schedules that launch a kernel for each piece of a substep: `gather`, `scatter`, and the projective solver."""

from abc import ABC
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

import warp as wp

from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.schedules.pieces import Step, cut
from balloon_warp.kernels.substep import NOTHING, Instead, phases_of
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.schedules.fixtures import look_arrays
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.launches import Launches, Moving, Own
from balloon_warp.schedules.membranes import left_array
from balloon_warp.schedules.tables import make_tables
from balloon_warp.schedules.tears import tear_arrays
from balloon_warp.schedules.touching import TouchLaunches
from balloon_warp.schedules.traits import choosing_parameters, model_traits
from balloon_warp.warp_lock import lock_of


class LaunchedSchedule(ABC):
    """Advances a state by whole frames, in place, piece by piece."""

    name: ClassVar[str]
    capturable = True
    watchable: ClassVar[bool] = True
    """Whether each substep ends in the state"""
    fast_math: ClassVar[bool] = False
    """Whether divisions and roots are a GPU's own, with errors in the last two bits"""
    phases: ClassVar[Sequence[Phase]] = ()
    """List that it executes; the step, when empty"""
    instead: ClassVar[Instead] = NOTHING
    look: ClassVar[Look]

    def __init__(self, model: Model, traits: Traits | None = None):
        self.model, self.traits = model, traits or model_traits(model)
        self.tables = make_tables(model, self.traits)
        self.vectors = self.allot(model, self.traits, room := Allocating(model.device))
        """Memory of the schedule's own"""
        step = self.step_of(model, self.traits)
        self.launches = Launches(model, step, self.tables, room, self.own(), fast_math=self.fast_math)
        self._touch = None
        if self.traits.touches:
            self._touch = TouchLaunches(model, self.traits, self.tables, self.launches.working, self.fast_math)
        self.framing = Framing(model, self.traits, self.tables, self.launches.working)

    @classmethod
    def step_of(cls, model: Model, traits: Traits) -> Step:
        """Return the phases of the model, in pieces."""
        return cut(phases_of(traits, cls.phases, cls.instead), traits, cls.look, doubles=not cls.watchable)

    def own(self) -> Mapping[str, Own]:
        """Return the phases that the schedule executes itself, by name."""
        return {"press": self._press}

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernels are chosen by."""
        return choosing_parameters(self.traits)

    @property
    def crowded(self) -> int:
        """Number of candidate overflows in all worlds.

        An overflow is a triangle that a particle may touch and that has no place in its list.
        """
        with lock_of(self.model.device):
            return int(self.launches.working.crowded.numpy().sum())

    @staticmethod
    def allot(model: Model, traits: Traits, room: Room) -> tuple[Any, ...]:
        """Ask for its own memory, beside what launches share."""
        return ()

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Return the device memory that it keeps for each world, beside the state."""
        room, traits = Counting(), model_traits(model)
        Launches.allot(model, cls.step_of(model, traits), room)
        left_array(model, room)
        tear_arrays(model, room)
        cls.allot(model, traits, room)
        look_arrays(model, room)
        return room.bytes // model.world_count

    def advance_frame(self, state: State) -> None:
        """Advance all worlds by a frame."""
        for _ in self.substeps(state):
            pass

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

    def _press(self, state: State, substep: int, time_in_frame: float, now: Moving) -> None:
        """Apply contact forces between balloons, and search for contacts now and then."""
        assert self._touch is not None
        self._touch.search(state, substep, *now)
        self._touch.press(state, *now)

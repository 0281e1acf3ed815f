"""Worlds whose particles may touch obstacles or each other in a frame.

They are found as it begins, and advanced after those that are free, by blocks that know of obstacles, or where balloons
touch by launches.
"""

from typing import Any, Protocol

import warp as wp

from balloon_warp.kernels.contact.free_frames import busy_kernel
from balloon_warp.kernels.traits import Traits
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Room
from balloon_warp.schedules.block_frames import BlockFrames
from balloon_warp.schedules.block_room import fits_in_block
from balloon_warp.schedules.fixtures import forget_looks
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.launches import Launches
from balloon_warp.schedules.outlook import Outlook, busy_traits, outlook_arrays


class BusyFrames(Protocol):
    """Advance worlds that are not free by frames."""

    tables: Any
    working: Any

    @property
    def crowded(self) -> int:
        """Number of candidate overflows, as for every schedule."""
        ...

    def begin_loading(self) -> None:
        """Compile kernels ahead."""

    def advance(self, state: State) -> None:
        """Advance by a frame."""


class LaunchedFrames:
    """Advance them by launches, in place: no other world is touched."""

    def __init__(self, model: Model, traits: Traits):
        self._gather = GatherSchedule(model, traits)
        self.tables, self.working = self._gather.tables, self._gather.launches.working

    @property
    def crowded(self) -> int:
        """Number of candidate overflows, as for every schedule."""
        return self._gather.crowded

    def begin_loading(self) -> None:
        """Compile kernels ahead."""
        self._gather.launches.begin_loading()

    def advance(self, state: State) -> None:
        """Advance by a frame."""
        now = kept = (state.points, state.velocities)
        for substep in range(self._gather.model.substeps):
            now = self._gather.launches.substep(state, substep, now)
        for source, target in zip(now, kept, strict=True):
            if source is not target:
                inputs = [self.working.verdicts, source, target]
                launch(busy_kernel(source.dtype), source.shape, inputs=inputs, device=self._gather.model.device)


class BusyWorlds:
    """Busy worlds beside a schedule that advances the free ones."""

    def __init__(self, model: Model, traits: Traits):
        busy = busy_traits(traits)
        self._model = model
        self._frames: BusyFrames = (
            BlockFrames(model, busy, Allocating(model.device))
            if _in_blocks(model, traits)
            else LaunchedFrames(model, busy)
        )
        self.working = self._frames.working
        self.outlook = Outlook(model, traits, self._frames.tables, self.working)

    @staticmethod
    def allot(model: Model, traits: Traits, room: Room) -> None:
        """Ask for all memory that it keeps."""
        busy = busy_traits(traits)
        if _in_blocks(model, traits):
            BlockFrames.allot(model, busy, room)
        else:
            Launches.allot(model, GatherSchedule.step_of(model, busy), room)
        outlook_arrays(model, traits, room)

    @property
    def crowded(self) -> int:
        """Number of candidate overflows, as for every schedule."""
        return self._frames.crowded

    def begin_loading(self, are_recorded: bool) -> None:
        """Compile ahead what a frame needs.

        Args:
            are_recorded: whether frames become a graph, which has what busy worlds need even if there are none.
        """
        self.outlook.begin_loading()
        if are_recorded:
            self._frames.begin_loading()

    def find(self, state: State) -> None:
        """Find the busy worlds, before the free ones are advanced."""
        self.outlook.look(state)

    def advance(self, state: State) -> None:
        """Advance the busy worlds, and those that were not free after all.

        On a GPU this takes no time if there are none.
        """
        if self._model.device.is_cpu or wp.is_conditional_graph_supported():
            wp.capture_if(self.working.any_busy, self._advance, state=state)
        else:
            self._advance(state)

    def _advance(self, state: State) -> None:
        self.outlook.put_back(state)
        forget_looks(self._frames.tables)
        self._frames.advance(state)
        if isinstance(self._frames, LaunchedFrames):
            self.outlook.keep_forces(state)


def _in_blocks(model: Model, traits: Traits) -> bool:
    return not (traits.touches or traits.meets_solids) and fits_in_block(model)

"""Worlds whose particles may meet obstacles or each other in a frame: found as it begins, and advanced by launches, after
those that are free."""

import warp as wp

from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.fixtures import forget_looks
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.launches import Launches
from balloon_warp.schedules.outlook import Outlook, busy_traits, outlook_arrays


class BusyWorlds:
    """Beside a schedule that advances the others."""

    def __init__(self, model: Model, traits: Traits):
        self._gather = GatherSchedule(model, busy_traits(traits))
        self.working = self._gather.launches.working
        self.outlook = Outlook(model, traits, self._gather.tables, self.working)

    @staticmethod
    def allot(model: Model, traits: Traits, room: Room) -> None:
        """Ask for all memory that it keeps."""
        Launches.allot(model, GatherSchedule.step_of(model, busy_traits(traits)), room)
        outlook_arrays(model, traits, room)

    @property
    def crowded(self) -> int:
        """As of a schedule."""
        return self._gather.crowded

    def begin_loading(self, are_recorded: bool) -> None:
        """Compile ahead what a frame needs.

        Args:
            are_recorded: whether frames become a graph, which has what busy worlds need even if there are none.
        """
        self.outlook.begin_loading()
        if are_recorded:
            self._gather.launches.begin_loading()

    def find(self, state: State) -> None:
        """Before the free worlds are advanced."""
        self.outlook.look(state)

    def advance(self, state: State) -> None:
        """Once they are: with those that were not free after all; on a GPU in no time if there are none."""
        device = self._gather.model.device
        if device.is_cpu or wp.is_conditional_graph_supported():
            wp.capture_if(self.working.any_busy, self._advance, state=state)
        else:
            self._advance(state)

    def _advance(self, state: State) -> None:
        self.outlook.put_back(state)
        forget_looks(self._gather.tables)
        now = kept = (state.points, state.velocities)
        for substep in range(self._gather.model.substeps):
            now = self._gather.launches.substep(state, substep, now)
        for source, target in zip(now, kept, strict=True):
            if source is not target:
                self.outlook.keep(source, target)

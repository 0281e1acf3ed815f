"""Worlds whose particles may meet obstacles or each other in a frame: found as it begins, and advanced by a block each,
after those that are free."""

import warp as wp

from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.block_launch import BlockLaunch
from balloon_warp.schedules.outlook import Outlook, busy_traits, outlook_arrays


class BusyWorlds:
    """Beside a schedule that advances the others."""

    def __init__(self, model: Model, traits: Traits):
        self.launch = BlockLaunch(model, busy_traits(traits))
        self.outlook = Outlook(model, traits, self.launch.tables)
        self.launch.memory.free = self.outlook.table

    @staticmethod
    def allot(model: Model, traits: Traits, room: Room) -> None:
        """Ask for all memory that it keeps."""
        BlockLaunch.allot(model, busy_traits(traits), room)
        outlook_arrays(model, traits, room)

    def begin_loading(self, are_recorded: bool) -> None:
        """Compile ahead what a frame needs.

        Args:
            are_recorded: whether frames become a graph, which has what busy worlds need even if there are none.
        """
        self.outlook.begin_loading()
        if are_recorded:
            self.launch.begin_loading()

    def find(self, state: State) -> None:
        """Before the free worlds are advanced."""
        self.launch.keep_time(state)
        self.outlook.look(state)

    def advance(self, state: State) -> None:
        """Once they are: with those that were not free after all; on a GPU in no time if there are none."""
        any_busy, device = self.outlook.table.any_busy, self.launch.model.device
        if device.is_cpu or wp.is_conditional_graph_supported():
            wp.capture_if(any_busy, self._advance, state=state)
        else:
            self._advance(state)

    def _advance(self, state: State) -> None:
        self.outlook.put_back(state)
        self.launch.advance(state)

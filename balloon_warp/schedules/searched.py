"""Schedule `block` of balloons that touch themselves: rounds of substeps, each from a search for contacts to the next.

A search lists all that may touch until the next one. Worlds for which it has listed nothing are clear: a block of
threads advances each by a round, with kernels that know of no contact. The others go on by launches.
"""

from functools import partial

import warp as wp

from balloon_warp.kernels.contact.free_frames import busy_kernel
from balloon_warp.kernels.contact.response import find_clear_worlds
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.schedules.block import source_of_frame
from balloon_warp.kernels.schedules.launched import source_of
from balloon_warp.model import Model, State
from balloon_warp.model.state import Allocating, Counting
from balloon_warp.schedules.framing import busy_features
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.layouts import BlockFrames, layout_of, require_block, step_of
from balloon_warp.schedules.membranes import left_array
from balloon_warp.schedules.tables import (
    clear_clearances,
    clearance_arrays,
    model_features,
    place_anchors,
    place_obstacles,
)
from balloon_warp.system.warp_threads import launch


def clear_features(features: Features) -> Features:
    """Return the features of kernels for rounds in which nothing touches."""
    return features._replace(frames="clear", touches=False, touches_itself=False, edges_meet=False)


class SearchedSchedule(GatherSchedule):
    """Advances a state by whole frames, in place. Bit-reproducible.

    Raises:
        InputError: a world does not fit in a block's shared memory.
    """

    name = "block"

    def __init__(self, model: Model):
        require_block(model, self.name)
        features = model_features(model)
        super().__init__(model, busy_features(features))
        self._blocks = BlockFrames(model, clear_features(features), Allocating(model.device), self.launches.working)

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Return the device memory that it keeps for each world, beside the state."""
        BlockFrames.allocate(model, clear_features(model_features(model)), room := Counting(), shares_working=True)
        left_array(model, room)  # of tables of their own
        clearance_arrays(model, room)
        return super().world_bytes(model) + room.bytes // model.world_count

    @classmethod
    def source_of(cls, model: Model) -> str:
        """Return the text of the kernel of a round of clear worlds, and of those of a substep of the others."""
        features = model_features(model)
        layout = layout_of(model, clear_features(features))
        of_round = source_of_frame(step_of(clear_features(features), layout), layout)
        return f"{of_round}\n\n{source_of(cls.step_of(model, busy_features(features)))}"

    def begin_loading(self) -> None:
        """Compile the kernels of a substep and of a round ahead."""
        super().begin_loading()
        self._blocks.begin_loading()

    def advance_frame(self, state: State) -> None:
        """Advance all worlds by a frame."""
        self.begin_loading()
        self.framing.begin(state)
        place_obstacles(self.model, self._blocks.tables, state)
        place_anchors(self.model, self._blocks.tables, state)
        clear_clearances(self._blocks.tables)
        self.rounds.go_from_search_to_search(partial(self._advance_round, state))
        self.framing.end(state)

    def _advance_round(self, state: State, first: int, count: int) -> None:
        """Search, and advance clear worlds by so many substeps, and then the others."""
        assert self._touch
        working, threads = self.launches.working, 1 if self.model.device.is_cpu else self.model.particle_count
        self._touch.search(state, first, state.points, state.velocities)
        working.any_busy.zero_()
        launch(find_clear_worlds, (self.model.world_count, threads), [threads, working], device=self.model.device)
        self._blocks.advance_round(state, self.launches.clock, first, count)
        advance_busy = partial(self._advance_busy, state, first, count)
        if self.model.device.is_cpu or wp.is_conditional_graph_supported():
            wp.capture_if(working.any_busy, advance_busy)
        else:
            advance_busy()

    def _advance_busy(self, state: State, first: int, count: int) -> None:
        def launch_substeps(numbers: range) -> None:
            now = kept = (state.points, state.velocities)
            for substep in numbers:
                now = self.launches.execute(state, substep, now, begins=substep == first)
            for target, source in zip(kept, now, strict=True):
                if source is not target:
                    self._copy_busy(target, source)

        self.rounds.launch_round(launch_substeps, first, count)

    def _copy_busy(self, target: wp.array, source: wp.array) -> None:
        inputs = [self.launches.working.verdicts, source, target]
        launch(busy_kernel(source.dtype), source.shape, inputs=inputs, device=self.model.device)

    def _press(self, state: State, substep: int, now: tuple[wp.array, wp.array]) -> None:
        """Apply contact forces between balloons: a search has been before the round."""
        assert self._touch
        self._touch.press(state, *now)

"""Schedules with a frame in one launch, `block`, `lanes` and `octets`; worlds that may touch something run beside it.

Worlds whose particles may touch obstacles or each other are found as a frame begins, and advanced after those that are
free, by blocks that know of obstacles, or where balloons touch by launches.

`lanes` and `octets` have eight worlds, or eight particles of a world, side by side in vector registers. Worlds are
divided among threads of a CPU. Bit-reproducible, whatever the number of threads.

Where balloons touch themselves, `block` goes in rounds of substeps, each from a search for contacts to the next. A
search lists all that may touch until the next one. Worlds for which it has listed nothing are clear: a block of threads
advances each by a round, with kernels that know of no contact. The others go on by launches.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar, Protocol

import numpy as np
import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.contact.free_frames import busy_kernel
from balloon_warp.kernels.contact.response import find_clear_worlds
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import Solids
from balloon_warp.kernels.schedules.block import source_of_frame
from balloon_warp.kernels.schedules.lanes import ACCESS, arguments_of, kernel_of
from balloon_warp.kernels.schedules.lanes import source_of as source_of_lanes
from balloon_warp.kernels.schedules.lanes_layouts import OCTETS, WORLDS, WORLDS_AS_OCTETS, Layout
from balloon_warp.kernels.schedules.launched import source_of as source_of_launches
from balloon_warp.kernels.schedules.writer import Step, cut
from balloon_warp.kernels.substep import SHARED, phases_of
from balloon_warp.kernels.working import Working
from balloon_warp.model import Model, State
from balloon_warp.model.state import Allocating, Counting, Room
from balloon_warp.schedules.frames import FramePiece
from balloon_warp.schedules.framing import (
    ContactHorizon,
    Framing,
    busy_features,
    contact_horizon_arrays,
    free_features,
    has_free_frames,
)
from balloon_warp.schedules.gather import GatherSchedule, PullingOctets
from balloon_warp.schedules.launched import Launches
from balloon_warp.schedules.layouts import (
    BlockFrames,
    allocate_lanes,
    fits_in_block,
    layout_of,
    make_lane_tables,
    put_far_away,
    require_block,
    rows_of,
    shares_of,
    step_of,
)
from balloon_warp.schedules.membranes import left_array
from balloon_warp.schedules.tables import (
    choosing_parameters,
    clear_clearances,
    clearance_arrays,
    kept_arguments,
    make_tables,
    model_features,
    place_anchors,
    place_obstacles,
    world_state,
)
from balloon_warp.schedules.touch_table import ContactLists, has_lists, start_of_frame
from balloon_warp.system.process import Threads
from balloon_warp.system.warp_threads import begin_loading, launch


class BusyFrames(Protocol):
    """Advance worlds that are not free by frames."""

    tables: Any
    working: Any

    @property
    def contact_lists(self) -> ContactLists | None:
        """Lists of contacts, as of every schedule."""
        ...

    def begin_loading(self) -> None:
        """Compile kernels ahead."""

    def advance(self, state: State) -> None:
        """Advance by a frame."""


class LaunchedFrames:
    """Launches that advance the busy worlds, in place: no other world is touched."""

    def __init__(self, model: Model, features: Features):
        self._gather = launches_for(model)(model, features)
        self.tables, self.working = self._gather.tables, self._gather.launches.working

    @property
    def contact_lists(self) -> ContactLists | None:
        """Lists of contacts, as of every schedule."""
        return self._gather.contact_lists

    def begin_loading(self) -> None:
        """Compile kernels ahead."""
        self._gather.begin_loading()

    def advance(self, state: State) -> None:
        """Advance by a frame."""
        self._gather.go_through(state, self._copy_busy)

    @property
    def are_short(self) -> bool:
        """Return whether far fewer substeps are launched, or recorded, than a frame has."""
        return self._gather.rounds.are_short

    def _copy_busy(self, target: wp.array, source: wp.array) -> None:
        inputs = [self.working.verdicts, source, target]
        launch(busy_kernel(source.dtype), source.shape, inputs=inputs, device=self._gather.model.device)


class BusyWorlds:
    """Busy worlds beside a schedule that advances the free ones."""

    def __init__(self, model: Model, features: Features):
        busy = busy_features(features)
        self._model = model
        self._frames: BusyFrames = (
            BlockFrames(model, busy, Allocating(model.device))
            if busy_in_blocks(model, features)
            else LaunchedFrames(model, busy)
        )
        self.working = self._frames.working
        self.contact_horizon = ContactHorizon(model, features, self._frames.tables, self.working)

    @staticmethod
    def allocate(model: Model, features: Features, room: Room) -> None:
        """Allocate the arrays that frames need."""
        busy = busy_features(features)
        if busy_in_blocks(model, features):
            BlockFrames.allocate(model, busy, room)
        else:
            launches = launches_for(model)
            Launches.allocate(model, launches.step_of(model, busy), room)
            launches.allocate(model, busy, room)
            if has_lists(busy):
                start_of_frame(model, room)
        contact_horizon_arrays(model, features, room)

    @property
    def contact_lists(self) -> ContactLists | None:
        """Lists of contacts, as of every schedule."""
        return self._frames.contact_lists

    @property
    def are_short(self) -> bool:
        """Return whether far fewer substeps are launched, or recorded, than a frame has."""
        return isinstance(self._frames, LaunchedFrames) and self._frames.are_short

    def begin_loading(self, are_recorded: bool) -> None:
        """Compile ahead the kernels of a frame.

        Args:
            are_recorded: whether frames become a graph, which has the kernels of busy worlds even if there are none.
        """
        self.contact_horizon.begin_loading()
        if are_recorded:
            self._frames.begin_loading()

    def find(self, state: State) -> None:
        """Find the busy worlds, before the free ones are advanced."""
        place_obstacles(self._model, self._frames.tables, state)
        place_anchors(self._model, self._frames.tables, state)
        self.contact_horizon.judge(state)

    def advance(self, state: State) -> None:
        """Advance the busy worlds, and those that were not free after all.

        On a GPU this takes no time if there are none.
        """
        if self._model.device.is_cpu or wp.is_conditional_graph_supported():
            wp.capture_if(self.working.any_busy, self.advance_busy, state=state)
        else:
            self.advance_busy(state)

    def are_there(self) -> bool:
        """Return whether any world is busy, once the free ones are advanced; for a CPU, whose memory is at hand."""
        return bool(self.working.any_busy.numpy()[0])

    def advance_busy(self, state: State) -> None:
        """Put the busy worlds back to where the frame began, and advance them."""
        self.contact_horizon.put_back(state)
        clear_clearances(self._frames.tables)
        self._frames.advance(state)
        if isinstance(self._frames, LaunchedFrames):
            self.contact_horizon.keep_forces(state)


def launches_for(model: Model) -> type[GatherSchedule]:
    """Return the schedule whose launches advance busy worlds."""
    return PullingOctets if model.device.is_cpu else GatherSchedule


def busy_in_blocks(model: Model, features: Features) -> bool:
    """Return whether busy worlds are advanced by blocks, and not by launches."""
    return not (features.touches or features.meets_solids) and fits_in_block(model)


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
    def allocate(cls, model: Model, features: Features, room: Room, shares_working: bool) -> None:
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
            BusyWorlds.allocate(model, features, room)
        cls.allocate(model, cls.features_of(model), room, shares)
        left_array(model, room)
        clearance_arrays(model, room)
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
            self.busy.contact_horizon.judge_afterwards(state)


def _busy_worlds(model: Model, features: Features) -> "BusyWorlds":
    """Return the busy worlds of a model; their kernels load only where there may be any."""

    return BusyWorlds(model, features)


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
    def allocate(cls, model: Model, features: Features, room: Room, shares_working: bool) -> None:
        """Ask for the memory of launches and patches."""
        Launches.allocate(model, GatherSchedule.step_of(model, features), room)
        GatherSchedule.allocate(model, features, room)

    def begin_loading(self) -> None:
        """Compile nothing ahead: patches load as they are launched."""

    def advance_free(self, state: State) -> None:
        """Run the substeps of a frame in patches."""
        self._free.advance_patches(state)


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


class LanesSchedule(FreeFramesSchedule):
    """Advances a state by whole frames, in place; eight worlds side by side.

    A launch on the CPU runs on the thread that calls it and leaves the interpreter free meanwhile, so that each Python
    thread advances its own groups of worlds.

    Raises:
        InputError: the device is not the CPU.
    """

    name: ClassVar[str] = "lanes"
    layout: ClassVar[Layout] = WORLDS
    busy_recorded: ClassVar[bool] = False

    def __init__(self, model: Model, thread_count: int | None = None):
        if not model.device.is_cpu:
            raise InputError(f"schedule {self.name}: runs on the CPU (got {model.device}); use block on a GPU")
        super().__init__(model)
        step = self.step_of(self.features)
        self._kernel = kernel_of(step, self.layout)
        self.tables = make_tables(model, self.features)
        self._inputs = self._arguments(step)
        self.framing = Framing(model, self.features, self.tables)
        self._share_out(thread_count)

    @classmethod
    def leaves_busy(cls, features: Features) -> bool:
        """Return whether worlds may be busy: balloons touch, bodies move or small spheres meet faces."""
        return features.in_blocks

    @classmethod
    def step_of(cls, features: Features) -> Step:
        """Return the phases of a model, in pieces."""
        return cut(phases_of(features, instead=SHARED), features, ACCESS[cls.layout], sums_along=True, apart=("pull",))

    @classmethod
    def source_of(cls, model: Model) -> str:
        """Return the source of the kernel that a model gets."""
        return source_of_lanes(cls.step_of(cls.features_of(model)), cls.layout)

    def _arguments(self, step: Step) -> dict[str, Any]:
        """Return the kernel's arguments by name, in order; None for those that differ from launch to launch."""
        t, solids = make_lane_tables(self.model, self.features, self.layout, self.tables), Solids()
        working, memory = Working(), allocate_lanes(self.model, step, self.layout, Allocating(self.model.device))
        put_far_away(memory.of_kernel, self.layout)
        for struct, arrays in ((t, memory.of_tables), (solids, memory.solids), (working, memory.working)):
            for name, array in arrays.items():
                setattr(struct, name, array)
        if self.busy:
            for name in ("verdicts", "travel_limits", "any_busy"):
                setattr(working, name, getattr(self.busy.working, name))
        t.rows = rows_of(memory.of_tables["numbers"])
        has = {"t": t, "tables": self.tables, "working": working, "solids": solids, **memory.of_kernel}
        return {name: has.get(name) for name in arguments_of(step, self.layout)}

    def _share_out(self, thread_count: int | None) -> None:
        self._shares = shares_of(self.model, self.layout, thread_count)
        self.capturable = len(self._shares) == 1
        if not self.capturable:
            self._threads = Threads(len(self._shares))

    @classmethod
    def allocate(cls, model: Model, features: Features, room: Room, shares_working: bool) -> None:
        """Ask for the memory of eight worlds, or eight particles, side by side."""
        allocate_lanes(model, cls.step_of(features), cls.layout, room)

    @property
    def pieces(self) -> list[FramePiece]:
        """Pieces of a frame that are recorded: busy worlds by themselves, where there are any."""
        if not self.busy:
            return [FramePiece(self.advance_frame)]
        busy = FramePiece(self.busy.advance_busy, self.busy.are_there, self.busy.are_short)
        return [FramePiece(self.begin_frame), busy, FramePiece(self.framing.end)]

    def begin_loading(self) -> None:
        """Compile the kernel ahead."""
        begin_loading(self._kernel, self.model.device)

    def advance_free(self, state: State) -> None:
        """Run the substeps of a frame, the groups of worlds on as many threads as there are cores."""
        named_inputs = {"state": world_state(state), **kept_arguments(state)}
        if len(self._shares) == 1:
            self._advance_groups(named_inputs, self._shares[0])
        else:
            for done in [self._threads.submit(self._advance_groups, named_inputs, share) for share in self._shares]:
                done.result()

    def _advance_groups(self, named_inputs: Mapping[str, Any], groups: np.ndarray) -> None:
        named_inputs = {**named_inputs, "first_group": int(groups[0])}
        inputs = [named_inputs.get(name, has) for name, has in self._inputs.items()]
        launch(self._kernel, len(groups), inputs, device=self.model.device)


class OctetsSchedule(LanesSchedule):
    """Advances a state by whole frames, in place; eight particles of a world side by side."""

    name: ClassVar[str] = "octets"
    layout: ClassVar[Layout] = OCTETS


class LanesAsOctetsSchedule(LanesSchedule):
    """Advances worlds side by side as `octets` does one, to the bit: sums over a world's particles have its order."""

    layout: ClassVar[Layout] = WORLDS_AS_OCTETS


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
        return f"{of_round}\n\n{source_of_launches(cls.step_of(model, busy_features(features)))}"

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

"""Schedules `lanes` and `octets`: eight worlds, or eight particles of a world, side by side in vector registers.

Worlds are divided among threads of a CPU. Bit-reproducible, whatever the number of threads.
"""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.near_solids import Solids
from balloon_warp.kernels.schedules.lanes.layouts import OCTETS, WORLDS, Layout
from balloon_warp.kernels.schedules.lanes.looks import LOOKS
from balloon_warp.kernels.schedules.lanes.source import arguments_of, kernel_of, source_of
from balloon_warp.kernels.schedules.pieces import Step, cut
from balloon_warp.kernels.substep import SHARED, phases_of
from balloon_warp.kernels.working import Working
from balloon_warp.launching import begin_loading, launch
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Counting
from balloon_warp.schedules.features import choosing_parameters, model_features
from balloon_warp.schedules.fixtures import forget_looks, look_arrays, place_obstacles
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.lane_memory import allot_lanes, group_count, put_far_away, rows_of
from balloon_warp.schedules.lane_tables import make_lane_tables
from balloon_warp.schedules.membranes import left_array
from balloon_warp.schedules.outlook import free_features
from balloon_warp.schedules.ramp import note_pressures, refresh_ramp, weigh_air
from balloon_warp.schedules.recorded_frame import FramePiece
from balloon_warp.schedules.tables import kept_arguments, make_tables, world_state


class LanesSchedule:
    """Advances a state by whole frames, in place; eight worlds side by side.

    A launch on the CPU runs on the thread that calls it and leaves the interpreter free meanwhile, so that each Python
    thread advances its own groups of worlds.

    Raises:
        InputError: the device is not the CPU.
    """

    name: ClassVar[str] = "lanes"
    layout: ClassVar[Layout] = WORLDS

    def __init__(self, model: Model, thread_count: int | None = None):
        if not model.device.is_cpu:
            raise InputError(f"--schedule {self.name}: runs on the CPU (got {model.device}); use block on a GPU")
        self.model, self._features, all_features = model, features_of(model), model_features(model)
        self.busy = busy_worlds(model, all_features) if all_features.in_blocks else None
        step = self.step_of(self._features)
        self._kernel = kernel_of(step, self.layout)
        self.tables = make_tables(model, self._features)
        self._inputs = self._arguments(step)
        self._health = HealthCheck(model)
        self._share_out(thread_count)

    @classmethod
    def step_of(cls, features: Features) -> Step:
        """Return the phases of a model, in pieces."""
        return cut(phases_of(features, instead=SHARED), features, LOOKS[cls.layout], sums_along=True, apart=("pull",))

    @classmethod
    def source_of(cls, model: Model) -> str:
        """Return the source of the kernel that a model gets."""
        return source_of(cls.step_of(features_of(model)), cls.layout)

    def _arguments(self, step: Step) -> dict[str, Any]:
        """Return the kernel's arguments by name, in order; None for those that differ from launch to launch."""
        t, solids = make_lane_tables(self.model, self._features, self.layout, self.tables), Solids()
        working, memory = Working(), allot_lanes(self.model, step, self.layout, Allocating(self.model.device))
        put_far_away(memory.of_kernel, self.layout)
        for struct, arrays in ((t, memory.of_tables), (solids, memory.solids), (working, memory.working)):
            for name, array in arrays.items():
                setattr(struct, name, array)
        if self.busy:
            for name in ("verdicts", "ways", "any_busy"):
                setattr(working, name, getattr(self.busy.working, name))
        t.rows = rows_of(memory.of_tables["numbers"])
        has = {"t": t, "tables": self.tables, "working": working, "solids": solids, **memory.of_kernel}
        return {name: has.get(name) for name in arguments_of(step, self.layout)}

    def _share_out(self, thread_count: int | None) -> None:
        groups = group_count(self.model, self.layout)
        thread_count = min(thread_count or os.cpu_count() or 1, groups)
        self.capturable = thread_count == 1
        self._shares = np.array_split(np.arange(groups), thread_count)
        if thread_count > 1:
            self._threads = ThreadPoolExecutor(thread_count)

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Return the device memory that it keeps for each world, beside the state."""
        room, features = Counting(), model_features(model)
        if features.in_blocks:
            from balloon_warp.schedules.busy_worlds import BusyWorlds

            BusyWorlds.allot(model, features, room)
        allot_lanes(model, cls.step_of(features_of(model)), cls.layout, room)
        left_array(model, room)
        look_arrays(model, room)
        return room.bytes // model.world_count

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernel is chosen by."""
        return choosing_parameters(self._features)

    @property
    def overflow(self) -> int:
        """Number of candidate overflows in all worlds.

        An overflow is a triangle that a particle may touch and that has no place in its list.
        """
        return self.busy.overflow if self.busy else 0

    @property
    def pieces(self) -> list[FramePiece]:
        """Pieces of a frame that are recorded: busy worlds by themselves, where there are any."""
        if not self.busy:
            return [FramePiece(self.advance_frame)]
        busy = FramePiece(self.busy.advance_busy, self.busy.are_there)
        return [FramePiece(self._begin_frame), busy, FramePiece(self._end_frame)]

    def advance_frame(self, state: State) -> None:
        """Advance all worlds by a frame, the groups of worlds on as many threads as there are cores."""
        self._begin_frame(state)
        if self.busy:
            self.busy.advance(state)
        self._end_frame(state)

    def _begin_frame(self, state: State) -> None:
        begin_loading(self._kernel, self.model.device)
        if self.busy:
            self.busy.begin_loading(are_recorded=False)
        refresh_ramp(self.model, state)
        weigh_air(self.model, self._features, self.tables, state)
        place_obstacles(self.model, self.tables, state)
        forget_looks(self.tables)
        given = {"state": world_state(state), **kept_arguments(state)}
        if self.busy:
            self.busy.find(state)
        if len(self._shares) == 1:
            self._advance_groups(given, self._shares[0])
        else:
            for done in [self._threads.submit(self._advance_groups, given, share) for share in self._shares]:
                done.result()

    def _end_frame(self, state: State) -> None:
        note_pressures(self.model, self._features, state)
        self._health.end_frame(state)

    def _advance_groups(self, given: Mapping[str, Any], groups: np.ndarray) -> None:
        given = {**given, "first_group": int(groups[0])}
        inputs = [given.get(name, has) for name, has in self._inputs.items()]
        launch(self._kernel, len(groups), inputs, device=self.model.device)


def features_of(model: Model) -> Features:
    """Return the features of the kernel: of worlds that may be busy, those of free frames."""
    features = model_features(model)
    return free_features(features) if features.in_blocks else features


def busy_worlds(model: Model, features: Features) -> Any:
    """Return the worlds in which balloons may touch, bodies move or small spheres meet faces.

    Kernels load only where they do.
    """
    from balloon_warp.schedules.busy_worlds import BusyWorlds

    return BusyWorlds(model, features)


class OctetsSchedule(LanesSchedule):
    """Advances a state by whole frames, in place; eight particles of a world side by side."""

    name: ClassVar[str] = "octets"
    layout: ClassVar[Layout] = OCTETS

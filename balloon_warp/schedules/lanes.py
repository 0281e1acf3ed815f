"""Schedules `lanes` and `octets`: eight worlds, or eight particles of a world, side by side in vector registers.

Worlds are divided among threads of a CPU. Bit-reproducible, whatever the number of threads.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import Solids
from balloon_warp.kernels.schedules.lanes import ACCESS, arguments_of, kernel_of, source_of
from balloon_warp.kernels.schedules.lanes_layouts import OCTETS, WORLDS, WORLDS_AS_OCTETS, Layout
from balloon_warp.kernels.schedules.writer import Step, cut
from balloon_warp.kernels.substep import SHARED, phases_of
from balloon_warp.kernels.working import Working
from balloon_warp.model import Model, State
from balloon_warp.model.state import Allocating, Room
from balloon_warp.schedules.frames import FramePiece
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.free_frames import FreeFramesSchedule
from balloon_warp.schedules.lane_tables import allocate_lanes, make_lane_tables, put_far_away, rows_of, shares_of
from balloon_warp.schedules.tables import kept_arguments, make_tables, world_state
from balloon_warp.system.loading import Threads
from balloon_warp.system.warp_threads import begin_loading, launch


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
        return source_of(cls.step_of(cls.features_of(model)), cls.layout)

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

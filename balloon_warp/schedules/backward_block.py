"""Frames backwards in blocks: a block of threads has a world of one balloon, and runs a frame in one launch."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import STATE
from balloon_warp.kernels.schedules.block.backward import arguments_backwards, kernel_backwards
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.looks import look_of
from balloon_warp.kernels.schedules.pieces import Step, cut, values_of
from balloon_warp.kernels.substep import phases_of
from balloon_warp.kernels.working import Working
from balloon_warp.launching import launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Room
from balloon_warp.schedules.backward import BackwardFrames
from balloon_warp.schedules.block_room import CAPACITY_STEP, most_particles
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.framing import Framing
from balloon_warp.schedules.launches import working_arrays
from balloon_warp.schedules.tables import make_tables, world_state

THREADS, REGISTERS = 256, 128
"""Threads of a block, and registers of each"""
BYTES_PER_PARTICLE = 48
"""Shared memory for two buffers of points, and for the bars of forces and area vectors"""


def fits_in_block_backwards(model: Model) -> bool:
    """Return whether a block can run a world backwards: one balloon, which fits in shared memory.

    Gas that comes and goes is left to launches, water, spheres, normal forces, and what touches itself.
    """
    features = model_features(model)
    fits = model.balloon_count == 1 and model.particle_count <= most_particles(model, BYTES_PER_PARTICLE)
    left = features.gas_changes or features.in_water or features.spheres or features.inflation_directions
    left = left or features.touches
    return fits and not left


def layout_backwards(model: Model) -> Layout:
    """Return the layout of a world on a block."""
    threads = 1 if model.device.is_cpu else min(-(-model.particle_count // 32) * 32, THREADS)
    capacity = -(-model.particle_count // CAPACITY_STEP) * CAPACITY_STEP
    return Layout(threads, capacity, registers=REGISTERS)


def step_backwards(features: Features, layout: Layout) -> Step:
    """Return the phases of a model, in pieces: what particles see of each other, and what they add up, is kept."""
    phases, look = phases_of(features), look_of(layout, features.spheres)
    looking = (
        phase for phase in phases if not phase.light and (phase.views(features, look) or phase.item == "balloon")
    )
    sums = (phase for phase in phases if phase.sums)
    shown = [name for phase in (*looking, *sums) for name in phase.writes]
    return cut(phases, features, look, sums_along=True, shown=shown)


class BlockBackward(BackwardFrames):
    """Run frames backwards in blocks."""

    def __init__(self, model: Model, state: State, columns: Sequence[int]):
        features, room = model_features(model), Allocating(model.device)
        self._layout = layout_backwards(model)
        step, tables = step_backwards(features, self._layout), make_tables(model, features, in_block=True)
        super().__init__(model, state, columns, step, tables, room, one_by_one=False)
        working = Working()
        for name, array in working_arrays(model, features, room).items():
            setattr(working, name, array)
        self._framing = Framing(model, features, tables, working)
        self._given = {"t": tables, "working": working, **rows(model, step, room), **self.arrays}
        self.carries_loads = features.gas and features.obstacles
        self._kernel = kernel_backwards(step, self._layout, self.columns)

    @staticmethod
    def room_of_frame(model: Model, room: Room) -> None:
        """Ask for what the substeps of a frame note."""
        rows(model, step_backwards(model_features(model), layout_backwards(model)), room)

    def frame(self) -> None:
        """Launch a frame: forward, and then its substeps backwards."""
        self._framing.begin(self.state)
        given = {**self._given, "state": world_state(self.state)}
        launch_tiled(
            self._kernel,
            dim=[self.model.world_count],
            inputs=[given[name] for name in arguments_backwards(self.step, self._layout, self.columns)],
            block_dim=self._layout.threads,
            device=self.model.device,
        )


def rows(model: Model, step: Step, room: Room) -> dict[str, Any]:
    """Allocate what each substep of a frame notes, a row each, and one more for where it ends."""
    count = model.world_count * (model.substeps + 1)
    vectors = {f"all_{view}": room.array((count, model.particle_count), wp.vec3) for view in STATE.values()}
    shapes = {
        "particle": (count, model.particle_count), "balloon": (count, model.balloon_count),
        "face": (model.world_count, model.face_count),  # which is found again
    }  # fmt: skip
    return vectors | {
        f"all_{value}": room.array(shapes[step.owner(value)], wp.float32 if dtype is float else dtype)
        for value, dtype in values_of(step).items()
    }

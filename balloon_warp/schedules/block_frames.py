"""Frames of worlds in blocks: all worlds, or those that the features are for, in one launch."""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.schedules.block import arguments_of_frame, kernel_of_frame
from balloon_warp.kernels.schedules.block_names import Layout
from balloon_warp.kernels.schedules.writer import Step, values_of
from balloon_warp.kernels.working import Working
from balloon_warp.launching import begin_loading, launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.block_layout import layout_of, step_of
from balloon_warp.schedules.launched import working_arrays
from balloon_warp.schedules.membranes import membrane_face_entries, membrane_face_table
from balloon_warp.schedules.slices import order_by_springs, quad_rings, renumbered, slot_table, spring_ends
from balloon_warp.schedules.tables import kept_arguments, make_tables, world_state


class BlockFrames:
    """Advance worlds by frames.

    Args:
        working: the memory beside the state, where others share it.
    """

    contact_lists = None
    """Lists of contacts: balloons do not touch in blocks"""

    def __init__(self, model: Model, features: Features, room: Room, working: Any | None = None):
        self.model, self.layout = model, layout_of(model, features)
        self.step = step_of(features, self.layout)
        self.numbers: wp.array | None = None
        """Numbers in the state of the particles in the tables, where these have them in another order"""
        laid_out = model
        if self.layout.ordered:
            order = order_by_springs(model, spring_ends(model))
            laid_out = renumbered(model, order)
            self.numbers = wp.array(order, dtype=wp.int32, device=model.device)
        self.tables = make_tables(laid_out, features, in_block=not self.layout.held or features.in_water)
        self.tables.membranes.membrane_faces = membrane_face_table(model, self.layout.membrane_face)
        self.working = working or _working(model, features, room)
        self._given = {"t": self.tables, "working": self.working, **_values(model, self.step, self.layout, room)}
        self._given["state_numbers"] = self.numbers
        if self.layout.held:
            ring = quad_rings(model) if self.layout.rings else None
            self._given["slots"] = slot_table(model, spring_ends(model), ring)

    @staticmethod
    def allot(model: Model, features: Features, room: Room, shares_working: bool = False) -> None:
        """Ask for all memory that they keep, or that they do not share."""
        layout = layout_of(model, features)
        if not shares_working:
            working_arrays(model, features, room)
        _values(model, step_of(features, layout), layout, room)

    @property
    def _kernel(self) -> Any:
        return kernel_of_frame(self.step, self.layout)

    def begin_loading(self) -> None:
        """Compile the kernel ahead."""
        begin_loading(self._kernel, self.model.device)

    def advance(self, state: State) -> None:
        """Advance by a frame."""
        given = {**self._given, "state": world_state(state), **kept_arguments(state)}
        launch_tiled(
            self._kernel,
            dim=[self.model.world_count],
            inputs=[given[name] for name in arguments_of_frame(self.step, self.layout)],
            block_dim=self.layout.threads,
            device=self.model.device,
        )


def _working(model: Model, features: Features, room: Room) -> Any:
    working = Working()
    for name, array in working_arrays(model, features, room).items():
        setattr(working, name, array)
    return working


def _values(model: Model, step: Step, layout: Layout, room: Room) -> dict[str, Any]:
    """Allocate the values that live from piece to piece, and have no place in the block."""
    counts = {"particle": model.particle_count, "face": model.face_count, "balloon": model.balloon_count}
    named, found = arguments_of_frame(step, layout), {}
    for value, dtype in values_of(step).items():
        if f"all_{value}" in named:
            shape = (model.world_count, counts[step.owner(value)])
            found[f"all_{value}"] = room.array(shape, wp.float32 if dtype is float else dtype)
    vectors = {
        "membrane_face_pulls": membrane_face_entries(model, layout.membrane_face) if layout.membrane_face else 0,
        "second_velocities": model.particle_count,
    }
    return found | {
        name: room.array((model.world_count, count), wp.vec3) for name, count in vectors.items() if name in named
    }

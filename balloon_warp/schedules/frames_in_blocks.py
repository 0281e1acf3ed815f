"""The `block` schedule: a thread block a world, in one launch a frame."""

from typing import Any

import warp as wp

from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.looks import look_of
from balloon_warp.kernels.schedules.block.source import arguments_of_frame, kernel_of_frame
from balloon_warp.kernels.schedules.pieces import Step, cut, values_of
from balloon_warp.kernels.substep import FACING, FILMED, STEP, phases_of
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working
from balloon_warp.launching import begin_loading, launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.launches import working_arrays
from balloon_warp.schedules.membranes import membrane_quads
from balloon_warp.schedules.slots import slot_table
from balloon_warp.schedules.spring_ends import spring_ends
from balloon_warp.schedules.tables import world_state


def step_of(traits: Traits, layout: Layout) -> Step:
    """The phases of a model, in pieces, as a block executes them."""
    step = FILMED if layout.film else FACING if traits.aims_on_the_way else STEP
    return cut(phases_of(traits, step), traits, look_of(layout), doubles=layout.doubled, sums_along=True)


class FramesInBlocks:
    """Advance all worlds by a frame, in one launch."""

    def __init__(self, model: Model, traits: Traits, layout: Layout, tables: Any, room: Room, rings: Any = None):
        self.model, self.layout, self.step = model, layout, step_of(traits, layout)
        self.working = Working()
        for name, array in working_arrays(model, traits, room).items():
            setattr(self.working, name, array)
        self._given = {
            "t": tables,
            "working": self.working,
            **values(model, self.step, layout, room),
        }
        if layout.held:
            self._given["slots"] = slot_table(model, spring_ends(model), rings)

    @property
    def kernel(self) -> Any:
        """Return the kernel."""
        return kernel_of_frame(self.step, self.layout)

    def begin_loading(self) -> None:
        """Compile it ahead."""
        begin_loading(self.kernel, self.model.device)

    def advance(self, state: State) -> None:
        """Advance by a frame."""
        given = {**self._given, "state": world_state(state)}
        launch_tiled(
            self.kernel,
            dim=[self.model.world_count],
            inputs=[given[name] for name in arguments_of_frame(self.step, self.layout)],
            block_dim=self.layout.threads,
            device=self.model.device,
        )


def values(model: Model, step: Step, layout: Layout, room: Room) -> dict[str, Any]:
    """Allocate what lives from piece to piece, and has no place in the block."""
    counts = {"particle": model.particle_count, "face": model.face_count, "balloon": model.balloon_count}
    named, found = arguments_of_frame(step, layout), {}
    for value, dtype in values_of(step).items():
        if f"all_{value}" in named:
            shape = (model.world_count, counts[step.owner(value)])
            found[f"all_{value}"] = room.array(shape, wp.float32 if dtype is float else dtype)
    if "film_pulls" in named:
        entries = 4 * len(membrane_quads(model).corners) + 1
        found["film_pulls"] = room.array((model.world_count, entries), wp.vec3)
    if "second_velocities" in named:
        found["second_velocities"] = room.array((model.world_count, model.particle_count), wp.vec3)
    return found

"""Balloons that touch, in schedules that launch a kernel for each piece of a substep: memory and launches."""

from typing import Any

import warp as wp

from balloon_warp.kernels.schedules.launched_press import press_kernel
from balloon_warp.kernels.schedules.touch_boxes import box_balloons, box_patches, meet_kernel
from balloon_warp.kernels.schedules.touch_lists import MOST_TRIANGLES, find_kernel
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.tables import world_state
from balloon_warp.schedules.touch_table import patches_of, substeps_of_search

BOX_THREADS = 128
"""that go through the particles of a balloon on a GPU"""


class TouchPieces:
    """Launches what finds and presses balloons that touch."""

    def __init__(self, model: Model, traits: Traits, tables: Any, working: Any):
        self.model, self._traits, self._tables, self._working = model, traits, tables, working
        self._interval = substeps_of_search(model)
        # a thread for each item on a GPU; on a CPU one goes through them, and is soon done where nothing is near
        self._patch_threads = tables.touch.patch_offsets.shape[0] - 1 if model.device.is_cuda else 1
        self._particle_threads = model.particle_count if model.device.is_cuda else 1

    def search(self, state: State, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Who may touch whom, at a frame's first substep and now and then after it."""
        if substep % self._interval:
            return
        m, t, working = self.model, self._tables, self._working
        wp.launch_tiled(
            box_balloons,
            dim=(m.world_count, m.balloon_count),
            inputs=[t, points, velocities, working],
            block_dim=BOX_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )
        wp.launch(meet_kernel(self._traits), m.world_count, [t, int(substep == 0), working], device=m.device)
        patches, particles = self._patch_threads, self._particle_threads
        inputs = [t, patches, points, velocities, working]
        wp.launch(box_patches, (m.world_count, patches), inputs, device=m.device)
        inputs = [t, particles, int(substep == 0), world_state(state), points, velocities, working]
        wp.launch(find_kernel(self._traits), (m.world_count, particles), inputs, device=m.device)

    def press(self, state: State, points: wp.array, velocities: wp.array) -> None:
        """Particles that touch push and are pushed, until the forces are taken."""
        m, threads = self.model, self._particle_threads
        inputs = [self._tables, threads, points, velocities, world_state(state), self._working]
        wp.launch(press_kernel(self._traits), (m.world_count, threads), inputs, device=m.device)


def touch_arrays(model: Model, traits: Traits, room: Room) -> dict[str, Any]:
    """What of `Working` is for balloons that touch."""
    worlds = model.world_count
    balloons, particles = (model.balloon_count, model.particle_count) if traits.touches else (0, 0)
    patches = sum(len(patches_of(shape.mesh)[1]) - 1 for shape in model.shapes) if traits.touches else 0
    return {
        "balloon_boxes": room.array((worlds, balloons, 3), wp.vec3),
        "patch_boxes": room.array((worlds, patches, 2), wp.vec3),
        "near_balloons": room.array((worlds, balloons + 1 if traits.touches else 0), wp.int32),
        "candidate_counts": room.array((worlds, particles), wp.int32),
        "candidates": room.array((worlds, int(MOST_TRIANGLES), particles), wp.int32),
        "touch_quanta": room.array((worlds, particles, 3), wp.int64),
        "crowded": room.array(worlds if traits.touches else 0, wp.int32),
    }

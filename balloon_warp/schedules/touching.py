"""Balloons that touch, in schedules that launch a kernel for each piece of a substep: memory and launches."""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import ARE_NEAR, box_balloons, meet_kernel
from balloon_warp.kernels.contact.edges import MOST_EDGES, find_edges_kernel
from balloon_warp.kernels.contact.forces import take_counts
from balloon_warp.kernels.contact.lists import MOST_OF_BALLOON, MOST_TRIANGLES
from balloon_warp.kernels.contact.parts import box_parts_of_worlds
from balloon_warp.kernels.contact.press import press_kernel
from balloon_warp.kernels.contact.search import find_kernel, looking_kernel
from balloon_warp.kernels.traits import Traits
from balloon_warp.launching import launch, launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.model.sharp_edges import sharp_edges
from balloon_warp.schedules.later import FEW_THREADS, threads_of_list
from balloon_warp.schedules.tables import world_state
from balloon_warp.schedules.touch_table import part_count, substeps_of_search

BOX_THREADS = 128
"""Threads that loop over the particles of a balloon on a GPU"""
MEET_THREADS = 32
"""Threads that loop over the balloons of a world on a GPU"""
PART_THREADS = 512
"""Threads that loop over the parts of a world on a GPU"""


class TouchLaunches:
    """Launches what finds and presses balloons that touch."""

    def __init__(self, model: Model, traits: Traits, tables: Any, working: Any, fast_math: bool = False):
        self.model, self._traits, self._tables, self._working = model, traits, tables, working
        self._interval, self._fast_math = substeps_of_search(model), fast_math
        working.near_balloons.fill_(int(ARE_NEAR))  # before the first search they may have been, in another schedule
        # a thread for each item on a GPU; on a CPU one goes through them, and is soon done where nothing is near
        self._edge_threads = working.edge_counts.shape[1] if model.device.is_cuda else 1
        self._particle_threads = model.particle_count if model.device.is_cuda else 1
        self._list_threads = threads_of_list(model)

    def search(self, state: State, substep: int, points: wp.array, velocities: wp.array) -> None:
        """Search for contacts, at a frame's first substep, and now and then after it where particles have strayed."""
        if substep % self._interval:
            return
        m, t, working = self.model, self._tables, self._working
        launch_tiled(
            box_balloons,
            dim=(m.world_count, m.balloon_count),
            inputs=[t, points, velocities, int(substep == 0), working],
            block_dim=BOX_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )
        launch_tiled(
            meet_kernel(self._traits),
            dim=[m.world_count],
            inputs=[t, working],
            block_dim=MEET_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )
        particles = self._particle_threads
        launch_tiled(
            box_parts_of_worlds,
            dim=[m.world_count],
            inputs=[t, points, velocities, working],
            block_dim=PART_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )
        place: dict[str, Any] = {"dim": (m.world_count, particles), "device": m.device, "block_dim": FEW_THREADS}
        moving = world_state(state), points, velocities, working
        launch(looking_kernel(self._traits), inputs=[t, particles, *moving], **place)
        place["dim"] = m.world_count, self._list_threads
        launch(find_kernel(self._traits, self._fast_math), inputs=[t, self._list_threads, *moving], **place)
        if self._traits.edges_meet:
            threads = self._edge_threads
            inputs = [t, threads, points, velocities, working]
            launch(find_edges_kernel(self._traits), (m.world_count, threads), inputs, device=m.device)
        if substep == 0:  # what came before is not known where a run begins with a saved state
            wp.copy(working.pushes_taken, working.push_quanta)
            for counted in (working.contacts, working.touched):
                counted.zero_()
            self._press(state, points, velocities, only_counts=True)
            launch(take_counts, (m.world_count, particles), [particles, working], device=m.device)

    def press(self, state: State, points: wp.array, velocities: wp.array) -> None:
        """Add the contact forces of particles and triangles."""
        self._press(state, points, velocities, only_counts=False)

    def _press(self, state: State, points: wp.array, velocities: wp.array, only_counts: bool) -> None:
        m, threads = self.model, self._list_threads
        inputs = [self._tables, threads, int(only_counts), points, velocities, world_state(state), self._working]
        shape = (m.world_count, threads)
        launch(press_kernel(self._traits, self._fast_math), shape, inputs, block_dim=FEW_THREADS, device=m.device)


def crowding_remarks(crowded: int) -> list[str]:
    """Return the warning for a number of candidate overflows."""
    if not crowded:
        return []
    return [
        f"touch: contacts were too crowded {crowded:,} times and some were ignored: a particle keeps the "
        f"{int(MOST_OF_BALLOON)} nearest triangles of a balloon, a sharp edge {int(MOST_EDGES)}; more substeps help"
    ]


def touch_arrays(model: Model, traits: Traits, room: Room) -> dict[str, Any]:
    """Return the arrays of `Working` for balloons that touch."""
    worlds = model.world_count
    balloons, particles = (model.balloon_count, model.particle_count) if traits.touches else (0, 0)
    parts = sum(part_count(shape.mesh) for shape in model.shapes) if traits.touches else 0
    edges = sum(len(sharp_edges(shape.mesh)) for shape in model.shapes) if traits.edges_meet else 0
    return {
        "balloon_boxes": room.array((worlds, balloons, 3), wp.vec3),
        "sought": room.array((worlds, particles), wp.vec3),
        "part_boxes": room.array((worlds, 2 * parts), wp.vec4),
        "neighbors": room.array((worlds, balloons, balloons), wp.int32),
        "neighbor_counts": room.array((worlds, balloons), wp.int32),
        "near_balloons": room.array((worlds, balloons + 1 if traits.touches else 0), wp.int32),
        "candidate_counts": room.array((worlds, particles), wp.int32),
        "candidates": room.array((worlds, particles, int(MOST_TRIANGLES)), wp.int32),
        "particle_lists": room.array((worlds, 2, particles), wp.int32),
        "list_lengths": room.array((worlds, 3 if traits.touches else 0), wp.int32),
        "push_quanta": room.array((worlds, particles, 4), wp.int64),
        "pushes_taken": room.array((worlds, particles, 4), wp.int64),
        "contacts": room.array((worlds, particles), wp.float32),
        "touched": room.array((worlds, particles), wp.int8),
        "edge_candidates": room.array((worlds, edges, int(MOST_EDGES)), wp.int32),
        "edge_counts": room.array((worlds, edges), wp.int32),
        "crowded": room.array(worlds if traits.touches or traits.ridges else 0, wp.int32),
    }

"""Balloons that touch, in schedules that launch a kernel for each piece of a substep: memory and launches."""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import (
    ARE_NEAR,
    box_balloons,
    box_leaves,
    line_up_boxes,
    meet_kernel,
    row_count,
)
from balloon_warp.kernels.contact.edges import (
    QUERY_THREADS,
    box_edges,
    query_kernel,
)
from balloon_warp.kernels.contact.response import response_kernel, take_counts
from balloon_warp.kernels.contact.search import find_kernel, searching_kernel
from balloon_warp.kernels.contact.triangles import MOST_LEAVES, near_leaves_kernel
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.working import LENGTHS, EightBoxes, EightPlaces
from balloon_warp.model import Model, State
from balloon_warp.model.state import Room
from balloon_warp.schedules.contact_lists import ENOUGH_THREADS, FEW_THREADS, edge_count, threads_of_list
from balloon_warp.schedules.tables import Worlds
from balloon_warp.schedules.touch_table import leaf_count, substeps_of_search
from balloon_warp.system.warp_threads import launch, launch_tiled

BOX_THREADS = 128
"""Threads that loop over the particles of a balloon on a GPU"""
MEET_THREADS = 32
"""Threads that loop over the balloons of a world on a GPU"""
WARP_THREADS = 32
"""Threads of a warp of a GPU"""
MOST_SHARE = 4
"""Edges that each thread of a warp tests at most, until as many look at balloons as there are threads"""


class TouchLaunches:
    """Launches the kernels that find and press balloons that touch."""

    def __init__(self, model: Model, features: Features, tables: Any, working: Any, fast_math: bool = False):
        self.model, self._features, self._tables, self._working = model, features, tables, working
        self._interval, self._fast_math, self._worlds = substeps_of_search(model), fast_math, Worlds()
        self._eight = compares_eight(model.device)
        working.near_balloons.fill_(int(ARE_NEAR))  # before the first search they may have been, in another schedule
        # a thread for each item on a GPU; on a CPU one goes through them, and is soon done where nothing is near
        self._particle_threads = model.particle_count if model.device.is_cuda else 1
        leaves = working.leaf_boxes.shape[1] // 2
        self._leaf_threads = -(-leaves // WARP_THREADS) * WARP_THREADS if model.device.is_cuda else 1
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
            meet_kernel(self._features),
            dim=[m.world_count],
            inputs=[t, working],
            block_dim=MEET_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )
        particles = self._particle_threads
        threads = self._leaf_threads
        moving: tuple[Any, ...] = points, velocities, working
        launch(box_leaves, (m.world_count, threads), [t, threads, *moving], block_dim=FEW_THREADS, device=m.device)
        if self._eight:
            launch(line_up_boxes, m.world_count, [t, working], device=m.device)
            if self._features.touches_itself:
                launch(near_leaves_kernel(self._features), m.world_count, [t, working], device=m.device)
        if self._features.edges_meet:  # before particles note where they are
            self._query_edges(points, velocities)
        place: dict[str, Any] = {"dim": (m.world_count, particles), "device": m.device, "block_dim": FEW_THREADS}
        moving = self._worlds.of(state), *moving
        launch(searching_kernel(self._features, self._eight), inputs=[t, particles, *moving], **place)
        place["dim"] = m.world_count, self._list_threads
        kernel = find_kernel(self._features, self._fast_math, self._eight)
        launch(kernel, inputs=[t, self._list_threads, *moving], **place)
        if substep == 0:  # history is unknown where a run begins with a saved state
            wp.copy(working.forces_taken, working.force_quanta)
            for counted in (working.contacts, working.touched):
                counted.zero_()
            self._press(state, points, velocities, only_counts=True)
            launch(take_counts, (m.world_count, particles), [particles, working], device=m.device)

    def _query_edges(self, points: wp.array, velocities: wp.array) -> None:
        m, edges = self.model, self._tables.touch.edges.shape[0]
        warps = -(-edges // WARP_THREADS)
        most = max(m.world_count * warps * WARP_THREADS // ENOUGH_THREADS, 1)
        share = min(most, MOST_SHARE) * WARP_THREADS if m.device.is_cuda else edges
        boxing, asking = (edges, -(-edges // share) * WARP_THREADS) if m.device.is_cuda else (1, 1)
        kernel = query_kernel(self._features, self._eight)
        for each, threads, told in ((box_edges, boxing, boxing), (kernel, asking, share)):
            inputs = [self._tables, told, points, velocities, self._working]
            launch(each, (m.world_count, threads), inputs, block_dim=QUERY_THREADS, device=m.device)

    def press(self, state: State, points: wp.array, velocities: wp.array) -> None:
        """Add the contact forces of particles and triangles."""
        self._press(state, points, velocities, only_counts=False)

    def _press(self, state: State, points: wp.array, velocities: wp.array, only_counts: bool) -> None:
        m, threads = self.model, self._list_threads
        inputs = [self._tables, threads, int(only_counts), points, velocities, self._worlds.of(state), self._working]
        shape = (m.world_count, threads)
        kernel = response_kernel(self._features, self._fast_math, self._eight)
        launch(kernel, shape, inputs, block_dim=FEW_THREADS, device=m.device)


def compares_eight(device: wp.Device) -> bool:
    """Return whether a thread compares boxes, and measures triangles, eight at a time: in a CPU's vector registers."""
    return device.is_cpu


def touch_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Return the arrays of `Working` for balloons that touch, but for lists that grow."""
    worlds = model.world_count
    balloons, particles = (model.balloon_count, model.particle_count) if features.touches else (0, 0)
    eight = compares_eight(model.device)
    leaves = sum(leaf_count(shape.mesh) for shape in model.shapes) if features.touches else 0
    rows = row_count(leaves, balloons) if leaves and eight else 0
    own_leaves = leaves if eight and features.touches_itself else 0
    edges = edge_count(model, features)
    return {
        "balloon_boxes": room.array((worlds, balloons, 3), wp.vec3),
        "sought": room.array((worlds, particles), wp.vec3),
        "clearances": room.array((worlds, particles if features.touches_itself else 0), wp.float32),
        "leaf_boxes": room.array((worlds, 2 * leaves), wp.vec4),
        "row_boxes": room.array((worlds, 0 if eight else 2 * -(-leaves // WARP_THREADS)), wp.vec4),
        "eight_boxes": room.array((worlds, rows), EightBoxes),
        "eight_places": room.array((worlds, 1 if rows else 0), EightPlaces),
        "near_leaves": room.array((worlds, own_leaves, int(MOST_LEAVES)), wp.int32),
        "near_leaf_counts": room.array((worlds, own_leaves), wp.int32),
        "neighbors": room.array((worlds, balloons, balloons), wp.int32),
        "neighbor_counts": room.array((worlds, balloons), wp.int32),
        "near_balloons": room.array((worlds, balloons + 1 if features.touches else 0), wp.int32),
        "candidate_counts": room.array((worlds, particles), wp.int32),
        "particle_lists": room.array((worlds, 2, particles), wp.int32),
        "list_lengths": room.array((worlds, LENGTHS if features.touches else 0), wp.int32),
        "force_quanta": room.array((worlds, particles, 4), wp.int64),
        "forces_taken": room.array((worlds, particles, 4), wp.int64),
        "contacts": room.array((worlds, particles), wp.float32),
        "touched": room.array((worlds, particles), wp.int8),
        "edge_boxes": room.array((worlds, 2 * edges), wp.vec4),
        "edge_clearances": room.array((worlds, edges if features.touches_itself else 0), wp.float32),
    }

"""Balloons that touch, in schedules that launch a kernel for each piece of a substep: memory and launches."""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import (
    ARE_NEAR,
    box_balloons,
    box_parts_of_worlds,
    line_up_boxes,
    meet_kernel,
    row_count,
)
from balloon_warp.kernels.contact.edges import (
    BOXED_OF_EDGE,
    SEEKING_OF_EDGE,
    edge_query_kernel,
    leaves_kernel,
    measuring_kernel,
    trees_kernel,
)
from balloon_warp.kernels.contact.response import response_kernel, take_counts
from balloon_warp.kernels.contact.search import find_kernel, searching_kernel
from balloon_warp.kernels.contact.triangles import MOST_PARTS, near_parts_kernel
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.working import LENGTHS, EightBoxes, EightPlaces
from balloon_warp.model import Model, State
from balloon_warp.model.state import Room
from balloon_warp.schedules.contact_lists import FEW_THREADS, edge_count, threads_of_list
from balloon_warp.schedules.tables import Worlds
from balloon_warp.schedules.touch_table import part_count, substeps_of_search
from balloon_warp.system.warp_threads import launch, launch_tiled

BOX_THREADS = 128
"""Threads that loop over the particles of a balloon on a GPU"""
MEET_THREADS = 32
"""Threads that loop over the balloons of a world on a GPU"""
SEEKING_SHARE = 4
"""Edges of a thread on a GPU, if all go through trees"""
LEAF_TURNS = 4
"""Threads on a GPU that share the leaves near a leaf"""
PART_THREADS = 512
"""Threads that loop over the parts of a world on a GPU"""


class TouchLaunches:
    """Launches the kernels that find and press balloons that touch."""

    def __init__(self, model: Model, features: Features, tables: Any, working: Any, fast_math: bool = False):
        self.model, self._features, self._tables, self._working = model, features, tables, working
        self._interval, self._fast_math, self._worlds = substeps_of_search(model), fast_math, Worlds()
        self._eight = compares_eight(model.device)
        working.near_balloons.fill_(int(ARE_NEAR))  # before the first search they may have been, in another schedule
        # a thread for each item on a GPU; on a CPU one goes through them, and is soon done where nothing is near
        self._part_threads = working.near_parts.shape[1] if model.device.is_cuda else 1
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
            meet_kernel(self._features),
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
        if self._features.touches_itself:
            dim = m.world_count, self._part_threads
            launch(near_parts_kernel(self._features), dim, [t, self._part_threads, working], device=m.device)
        if self._features.edges_meet:  # before particles note where they are
            self._query_edges(points, velocities)
        place: dict[str, Any] = {"dim": (m.world_count, particles), "device": m.device, "block_dim": FEW_THREADS}
        moving = self._worlds.of(state), points, velocities, working
        launch(searching_kernel(self._features, self._eight), inputs=[t, particles, *moving], **place)
        place["dim"] = m.world_count, self._list_threads
        if self._eight:
            launch(line_up_boxes, m.world_count, [t, working], device=m.device)
        kernel = find_kernel(self._features, self._fast_math, self._eight)
        launch(kernel, inputs=[t, self._list_threads, *moving], **place)
        if substep == 0:  # history is unknown where a run begins with a saved state
            wp.copy(working.forces_taken, working.force_quanta)
            for counted in (working.contacts, working.touched):
                counted.zero_()
            self._press(state, points, velocities, only_counts=True)
            launch(take_counts, (m.world_count, particles), [particles, working], device=m.device)

    def _query_edges(self, points: wp.array, velocities: wp.array) -> None:
        m, features, edges = self.model, self._features, self._tables.touch.edges.shape[0]
        kernels = [(edge_query_kernel, edges, 1), (trees_kernel, -(-edges // SEEKING_SHARE), 1)]
        if features.touches_itself:
            kernels.append((leaves_kernel, LEAF_TURNS * self._working.near_parts.shape[1] // 2, LEAF_TURNS))
        for kernel, threads, turns in [*kernels, (measuring_kernel, edges, 1)]:
            threads, turns = threads_on(m.device, threads, turns)
            inputs = [self._tables, threads, turns, points, velocities, self._working]
            launch(kernel(features), (m.world_count, threads), inputs, block_dim=FEW_THREADS, device=m.device)

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


def threads_on(device: wp.Device, threads: int, turns: int) -> tuple[int, int]:
    """Return the threads of a world, and how many of them share an item: on a CPU one goes through all."""
    return (threads, turns) if device.is_cuda else (1, 1)


def touch_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Return the arrays of `Working` for balloons that touch, but for lists that grow."""
    worlds = model.world_count
    balloons, particles = (model.balloon_count, model.particle_count) if features.touches else (0, 0)
    parts = sum(part_count(shape.mesh) for shape in model.shapes) if features.touches else 0
    rows = row_count(parts, (parts + balloons) // 2, balloons) if parts and compares_eight(model.device) else 0
    own_parts = parts if features.touches_itself else 0
    edges = edge_count(model, features)
    return {
        "balloon_boxes": room.array((worlds, balloons, 3), wp.vec3),
        "sought": room.array((worlds, particles), wp.vec3),
        "clearances": room.array((worlds, particles if features.touches_itself else 0), wp.float32),
        "part_boxes": room.array((worlds, 2 * parts), wp.vec4),
        "eight_boxes": room.array((worlds, rows), EightBoxes),
        "eight_places": room.array((worlds, 1 if rows else 0), EightPlaces),
        "near_parts": room.array((worlds, own_parts, int(MOST_PARTS)), wp.int32),
        "near_part_counts": room.array((worlds, own_parts), wp.int32),
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
        "query_edges": room.array((worlds, edges * SEEKING_OF_EDGE), wp.vec2i),
        "boxed_edges": room.array((worlds, edges * BOXED_OF_EDGE), wp.vec2i),
        "edge_clearances": room.array((worlds, edges if features.touches_itself else 0), wp.float32),
    }

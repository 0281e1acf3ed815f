"""Work around the substeps of a frame, and its contact horizon: whether particles may touch anything at all.

Worlds in which they cannot are advanced by kernels that know of neither obstacles nor balloons that touch; those that
touch themselves are judged by parts. See `kernels.contact.free_frames`.
"""

from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.contact.free_frames import (
    FreeFrames,
    OwnParts,
    box_groups,
    busy_kernel,
    find_strayed_balloons,
    judge_kernel,
    judge_parts_kernel,
    keep_sphere_forces,
    place_parts,
    put_worlds_back,
    surround_kernel,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.schedules.launched import read_sphere_forces, write_sphere_forces
from balloon_warp.kernels.tables import WorldState
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.thickness import min_gaps
from balloon_warp.model import Model, State
from balloon_warp.model.state import Allocating, Room, kept_arrays
from balloon_warp.model.touch import APART, edge_length, is_folded
from balloon_warp.schedules.frames import ContactSums, HealthCheck
from balloon_warp.schedules.tables import (
    clear_clearances,
    note_pressures,
    place_anchors,
    place_obstacles,
    refresh_ramp,
    update_air,
    world_state,
)
from balloon_warp.schedules.touch_table import ITSELF, surface_of
from balloon_warp.system.warp_threads import begin_loading, launch, launch_tiled


class Framing:
    """Begin and end frames of a model.

    Args:
        tables: that the schedule has made of it.
        working: the memory of its kernels beside the state; None where they keep nothing from frame to frame.
        numbers: of particles in the state, if tables have them in another order.
        checks_particles: whether particles are looked at as a frame ends; otherwise kernels have done so.
    """

    def __init__(
        self,
        model: Model,
        features: Features,
        tables: Any,
        working: Any | None = None,
        *,
        numbers: wp.array | None = None,
        checks_particles: bool = True,
    ):
        self.model, self.features, self.tables, self.working = model, features, tables, working
        self._numbers = numbers
        self._contact_sums = ContactSums(model) if features.tells_contacts else None
        self._health = HealthCheck(model, particles=checks_particles)

    def begin(self, state: State) -> None:
        """Update the values that depend on the frame, and read the forces that the last frame left on spheres."""
        refresh_ramp(self.model, state)
        update_air(self.model, self.features, self.tables, state, self._numbers)
        place_obstacles(self.model, self.tables, state)
        place_anchors(self.model, self.tables, state)
        clear_clearances(self.tables)
        if self.working and self.features.tells_contacts:
            self.working.contact_impulses.zero_()
        if self.working and self.features.penalties:
            self._over_spheres(read_sphere_forces, state.sphere_forces, self.working.sphere_quanta)

    def end(self, state: State) -> None:
        """End a frame: store sphere forces and pressures of the last substep, count it, and check all particles."""
        if self.working and self.features.penalties:
            self._over_spheres(write_sphere_forces, self.working.sphere_quanta, state.sphere_forces)
        note_pressures(self.model, self.features, state)
        if self.working and self._contact_sums:
            wp.copy(state.contact_impulses, self.working.contact_impulses)
            self._contact_sums(state)
        self._health.end_frame(state)

    def _over_spheres(self, kernel: Any, *arguments: Any) -> None:
        shape = (self.model.world_count, self.model.sphere_count)
        launch(kernel, shape, inputs=list(arguments), device=self.model.device)


TRIANGLES = 24
"""Largest number of triangles of a part: of fewer more parts are compared, larger ones deform more"""
FAR, FAR_FOLDED = 1.5, 1.0
"""Largest distances at the start that matter between triangles that may touch, in edges: otherwise, and of a balloon
all of which may touch"""
PARTS = 16
"""Largest number of parts of a group"""


class Parts(NamedTuple):
    """The parts of a mesh."""

    particles: list[NDArray[np.int64]]
    offsets: list[NDArray[np.float64]]
    weights: list[NDArray[np.float64]]
    axes: list[NDArray[np.float64]]
    centers: list[NDArray[np.float64]]
    sizes: list[tuple[float, float]]


def own_parts(model: Model) -> Any:
    """Return the parts of all balloons of a model; without places in worlds."""
    own, device = OwnParts(), model.device
    parts = [parts_of(shape.mesh) for shape in model.shapes]
    firsts = model.particle_offsets
    particles = [entry + first for each, first in zip(parts, firsts, strict=False) for entry in each.particles]
    counts = [len(each.particles) for each in parts]
    ends = np.cumsum([0, *counts])
    groups = [np.arange(begin, end, PARTS) for begin, end in pairwise(ends)]

    def array(values: Any, dtype: Any) -> wp.array:
        return wp.array(np.asarray(values), dtype=dtype, device=device)

    def joined(rows: list[Any], width: int) -> NDArray[Any]:
        return np.concatenate([np.zeros((0, width)), *rows])

    own.particles = array(np.concatenate([np.zeros(0, dtype=np.int64), *particles]), wp.int32)
    own.first = array(np.cumsum([0, *map(len, particles)]), wp.int32)
    own.offsets = array(joined([entry for each in parts for entry in each.offsets], 3), wp.vec3)
    own.weights = array(joined([entry for each in parts for entry in each.weights], 2), wp.vec2)
    own.axes = array(np.reshape([entry for each in parts for entry in each.axes], (-1, 3, 3)), wp.mat33)
    own.centers = array(np.reshape([entry for each in parts for entry in each.centers], (-1, 3)), wp.vec3)
    own.sizes = array(np.reshape([entry for each in parts for entry in each.sizes], (-1, 2)), wp.vec2)
    own.balloons = array(np.repeat(np.arange(len(parts)), counts), wp.int32)
    own.groups = array(np.concatenate([*groups, ends[-1:]]), wp.int32)
    return own


def looks_at_parts(model: Model) -> bool:
    """Return whether balloons that touch themselves may have free frames: on a GPU, which searches fast, slender."""
    return model.scene.touches_itself and (model.device.is_cpu or model.scene.touches_softly)


def own_parts_arrays(model: Model, room: Room) -> dict[str, Any]:
    """Return the memory of where parts are in each world."""
    counts = [part_count(shape.mesh) for shape in model.shapes]
    worlds, parts, groups = model.world_count, sum(counts), sum(-(-count // PARTS) for count in counts)
    return {
        "needs_check": room.array((worlds, model.balloon_count), wp.int32),
        "drifts": room.array((worlds, model.balloon_count), wp.vec3),
        "means": room.array((worlds, parts), wp.vec3),
        "maps": room.array((worlds, parts), wp.mat33),
        "misfits": room.array((worlds, parts), wp.float32),
        "boxes": room.array((worlds, parts, 2), wp.vec3),
        "group_boxes": room.array((worlds, groups, 2), wp.vec3),
    }


def parts_of(mesh: PolygonMesh) -> Parts:
    """Return the parts of a mesh: compact, of up to `TRIANGLES` triangles."""
    parts, surface, points = Parts([], [], [], [], [], []), surface_of(mesh), mesh.points
    gaps = _gaps(mesh)
    sizes, after = surface.ranges[:, 1] - surface.ranges[:, 0], 0
    for part, (begin, end) in enumerate(surface.ranges):
        if part < after or not 0 < sizes[part] <= TRIANGLES:
            continue
        after = surface.ends[part]
        own = np.unique(surface.triangles[begin:end])
        center = points[own].mean(axis=0)
        offsets = points[own] - center
        squares, axes = np.linalg.eigh(offsets.T @ offsets)  # from the shortest to the longest
        axes = axes[:, ::-1].copy()
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        along = offsets @ axes[:, :2]
        flat = squares[1] <= 1e-12 * squares[2]  # on a line, which has no rotation
        parts.particles.append(own)
        parts.offsets.append(offsets)
        parts.weights.append(np.zeros_like(along) if flat else along / (along**2).sum(axis=0))
        parts.axes.append(axes)
        parts.centers.append(center)
        parts.sizes.append((float(np.linalg.norm(offsets, axis=1).max()), float(gaps[own].min())))
    return parts


def _gaps(mesh: PolygonMesh) -> NDArray[np.float64]:
    edge = edge_length(mesh)
    apart, most = (ITSELF, FAR_FOLDED) if is_folded(mesh) else (APART, FAR)
    return min_gaps(mesh, apart * edge, most * edge)


def part_count(mesh: PolygonMesh) -> int:
    """Return the number of parts of a mesh, without looking for them."""
    return _parts_of(int(np.maximum(mesh.face_vertex_counts - 2, 0).sum()))


@cache
def _parts_of(triangles: int) -> int:
    half = triangles // 2
    return min(triangles, 1) if triangles <= TRIANGLES else _parts_of(half) + _parts_of(triangles - half)


THREADS = 128
"""Threads of a block that surveys a balloon on a GPU"""


def has_free_frames(features: Features) -> bool:
    """Return whether a block leaves worlds to launches in some frames: not where it does all itself."""
    return features.touches or features.meets_solids or (features.fixtures and not features.always_busy)


def free_features(features: Features) -> Features:
    """Return the features of kernels for free frames."""
    return features._replace(
        frames="apart" if features.fixtures and features.touches_alone else "free",
        touches=False,
        touches_itself=False,
        edges_meet=False,
        bodies=0,
        ties=False,
        small_spheres=False,
        ridges=False,
        round_ridges=False,
    )


def busy_features(features: Features) -> Features:
    """Return the features of kernels for other frames."""
    return features._replace(frames="busy")


class ContactHorizon:
    """Launches of the kernels that find the worlds free of contact in a frame, and that restore misjudged ones."""

    def __init__(self, model: Model, features: Features, tables: Any, working: Any):
        self.model, self._features, self._tables, self._working = model, features, tables, working
        self.table, self._before = FreeFrames(), WorldState()
        arrays, before, own, self._kept = contact_horizon_arrays(model, features, Allocating(model.device))
        for name, array in arrays.items():
            setattr(self.table, name, array)
        for name in ("verdicts", "travel_limits", "any_busy"):
            setattr(self.table, name, getattr(working, name))
        for name, array in before.items():
            setattr(self._before, name, array)
        self._own = own_parts(model) if own else None
        for name, array in own.items():
            setattr(self._own, name, array)
        self._judging = judge_kernel(features, looks_at_parts=self._own is not None)

    def begin_loading(self) -> None:
        """Compile ahead the kernels of a look."""
        of_kept = (busy_kernel(array.dtype) for array in self._kept.values())
        for kernel in (surround_kernel(self._features), self._judging, *of_kept):
            begin_loading(kernel, self.model.device)

    def judge(self, state: State) -> None:
        """Judge the worlds before the frame."""
        m, threads = self.model, THREADS if self.model.device.is_cuda else 1
        for name, array in self._kept.items():
            wp.copy(array, state.kept[name])
        launch_tiled(
            surround_kernel(self._features),
            dim=(m.world_count, m.balloon_count),
            inputs=[self._tables, world_state(state), self.table, self._before],
            block_dim=threads,
            device=m.device,
        )
        launch(self._judging, m.world_count, [self._tables, self.table], device=m.device)
        self._judge_parts(state, is_over=False)

    def judge_afterwards(self, state: State) -> None:
        """Judge the worlds that were free after the frame, where balloons touch themselves: by how they moved in it."""
        self._judge_parts(state, is_over=True)

    def _judge_parts(self, state: State, is_over: bool) -> None:
        if not self._own:
            return
        m, now, groups = self.model, world_state(state), self._own.group_boxes.shape[:2]
        places = now, self._before if is_over else now
        inputs = [self._tables, self._working.verdicts, *places, state.seen_points, state.rooms, self._own]
        threads = THREADS if m.device.is_cuda else 1
        launch_tiled(
            find_strayed_balloons, (m.world_count, m.balloon_count), inputs, block_dim=threads, device=m.device
        )
        launch(place_parts, self._own.means.shape, [*places, self._own], device=m.device)
        launch(box_groups, groups, [self._own], device=m.device)
        inputs = [self._tables, self._own, int(is_over), state.rooms, self.table]
        launch(judge_parts_kernel(self._features), groups, inputs, device=m.device)

    def put_back(self, state: State) -> None:
        """Restore worlds whose frame was not free, once the free frames are over."""
        threads = THREADS if self.model.device.is_cuda else 1
        inputs = [self.table, self._before, threads, world_state(state), self._working.sphere_quanta]
        launch(put_worlds_back, (self.model.world_count, threads), inputs=inputs, device=self.model.device)
        for name, array in self._kept.items():
            inputs = [self._working.verdicts, array, state.kept[name]]
            launch(busy_kernel(array.dtype), array.shape, inputs=inputs, device=self.model.device)

    def keep_forces(self, state: State) -> None:
        """Keep the forces on spheres of worlds whose frame was not free."""
        if self._features.penalties:
            inputs = [self.table, self._working.sphere_quanta, state.sphere_forces]
            launch(keep_sphere_forces, state.sphere_forces.shape, inputs=inputs, device=self.model.device)


def contact_horizon_arrays(model: Model, features: Features, room: Room) -> tuple[dict[str, Any], ...]:
    """Return the memory of `FreeFrames`, of a world's earlier state, of parts of balloons, and of items kept."""
    worlds, balloons, spheres = model.world_count, model.balloon_count, model.sphere_count
    gas = (worlds, balloons if features.gas else 0)
    free = {
        "boxes": room.array((worlds, balloons, 2), wp.vec3),
        "alone": room.array((worlds, balloons, 2), wp.float32),
    }
    particles = (worlds, model.particle_count)
    before = {
        "points": room.array(particles, wp.vec3),
        "velocities": room.array(particles, wp.vec3),
        "inflation_loads": room.array(gas, wp.vec2),
        "pressures": room.array(gas, wp.float32),
        "pressure_slopes": room.array(gas, wp.float32),
        "gas_amounts": room.array(gas, wp.float64),
        "free_volumes": room.array(gas, wp.float64),
        "tube_flows": room.array((worlds, model.tube_count), wp.float32),
        "sphere_positions": room.array((worlds, spheres), wp.vec3),
        "sphere_velocities": room.array((worlds, spheres), wp.vec3),
        "sphere_spins": room.array((worlds, spheres), wp.vec3),
        "sphere_forces": room.array((worlds, spheres), wp.vec3),
    }
    return free, before, own_parts_arrays(model, room) if looks_at_parts(model) else {}, kept_arrays(model, room)

"""Parts of balloons that touch themselves, as kernels read them, see `kernels.contact.free_frames`."""

from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.contact.free_frames import OwnParts
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.thickness import least_gaps
from balloon_warp.model import Model
from balloon_warp.model.memory import Room
from balloon_warp.model.touch import APART, edge_length, is_folded
from balloon_warp.schedules.touch_table import ITSELF, surface_of

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
        "looks": room.array((worlds, model.balloon_count), wp.int32),
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
    return least_gaps(mesh, apart * edge, most * edge)


def part_count(mesh: PolygonMesh) -> int:
    """Return the number of parts of a mesh, without looking for them."""
    return _parts_of(int(np.maximum(mesh.face_vertex_counts - 2, 0).sum()))


@cache
def _parts_of(triangles: int) -> int:
    half = triangles // 2
    return min(triangles, 1) if triangles <= TRIANGLES else _parts_of(half) + _parts_of(triangles - half)

"""Ridges of obstacles and bodies, and edges of balloons, that touch between particles.

Ridges of obstacles and free bodies, which balloon faces touch between their particles.

Ridges are the convex edges of boxes and meshes, and the axes of capsules.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import face_vector_areas
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import corner_faces, mesh_edges, next_corners
from balloon_warp.model.obstacles import BodyShape, ObstacleShape, is_thin, obstacle_motion
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.touch import THICKNESS, bends_freely, edge_length, is_folded
from balloon_warp.scene import Balloon, Scene

SHARP = 0.5
"""Cosine of the initial angle between the normals of an edge's two faces below which it is sharp: 60 degrees"""


def sharp_edges(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the ends of a mesh's sharp edges, shape (E, 2).

    They are in the order and direction in which faces first traverse them, independent of vertex numbers.
    """
    edges = mesh_edges(mesh)
    areas = face_vector_areas(mesh)
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    normals = normals[corner_faces(mesh)[edges.corners]] * np.where(edges.forward, 1.0, -1.0)[:, None]
    other = np.minimum(edges.starts + 1, len(edges.corners) - 1)
    cosine = -(normals[edges.starts] * normals[other]).sum(axis=1)  # the faces of an edge run along it both ways
    firsts = np.sort(edges.corners[edges.starts[(edges.face_counts != 2) | (cosine < SHARP)]])
    following = next_corners(mesh)[firsts]
    return mesh.face_vertex_indices[np.stack([firsts, following], axis=1)].astype(np.int64)


def edges_meet(scene: Scene, shapes: Sequence[BalloonShape]) -> bool:
    """Return whether edges of balloons may touch others."""
    if not scene.touches:
        return False
    have = [len(edges) > 0 for edges in meeting_edges(scene, shapes)]
    return any(have) if scene.touches_itself else sum(have) > 1


def meeting_edges(scene: Scene, shapes: Sequence[BalloonShape]) -> list[NDArray[np.int64]]:
    """Return the ends of the edges of each balloon that touch edges, each of shape (E, 2)."""
    said = scene.touch.edges if scene.touch else "auto"
    if said is False:
        return [np.zeros((0, 2), dtype=np.int64) for _ in shapes]
    takes_all = said is True or scene.touches_itself
    every = [takes_all or _may_fold(each, shape) for each, shape in zip(scene.balloon, shapes, strict=True)]
    return [_all_edges(shape) if own else sharp_edges(shape.mesh) for shape, own in zip(shapes, every, strict=True)]


def edges_by_leaf(
    triangles: NDArray[np.int64], leaves: NDArray[np.int64], edges: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return edges in the order of the triangles that have them first, and the leaf of each, shape (E, 2) and (E,).

    Args:
        leaves: that of each triangle, ascending.
    """
    count = int(triangles.max(initial=0)) + 1
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2) @ [count, 1]
    keys, firsts = np.unique(sides, return_index=True)
    own = firsts[np.searchsorted(keys, np.sort(edges, axis=1) @ [count, 1])]
    order = np.argsort(own, kind="stable")
    return edges[order], leaves[own[order] // 3]


def _may_fold(balloon: Balloon, shape: BalloonShape) -> bool:
    """Return whether a balloon may fold anywhere: it bends freely, and is folded, flat or open at the start."""
    return bends_freely(balloon) and (not shape.closed or is_folded(shape.mesh))


def _all_edges(shape: BalloonShape) -> NDArray[np.int64]:
    """Return all edges of a mesh, as contact cuts its faces into triangles."""
    triangles = triangles_of(shape.mesh)
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    return np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0)


FLAT = 0.2
"""Turn of a surface within an edge of a balloon [rad], up to which faces follow it within the thickness of a skin"""
THIN = 5.0
"""Width of a solid, in mean edges of a balloon, below which it also touches faces"""
LEVEL = 0.6
"""Slope of the most level side of a box [rad], from which on the box stands on an edge or a corner"""
KEPT = 0.5
"""Distance that faces keep from ridges, over the thickness of a skin"""
BOX_SIGNS = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
"""Signs of the corners of a box"""


class Ridges(NamedTuple):
    """Ridges of a solid, as seen from that."""

    ends: NDArray[np.float64]
    """Begin and end of each ridge [m], shape (n, 2, 3)"""
    inward: NDArray[np.float64]
    """Unit vectors from each ridge along the two sides beside it, or zero where there is none, shape (n, 2, 3)"""
    radius: float
    """Radius around each ridge [m]"""
    tips: NDArray[np.int32]
    """Owned ends of a ridge, 1 for its begin plus 2 for its end, shape (n,): each corner is one ridge's"""


NO_RIDGES = Ridges(np.zeros((0, 2, 3)), np.zeros((0, 2, 3)), 0.0, np.zeros(0, np.int32))
"""Ridges of a solid that has none, such as a plane"""


def faces_meet(
    scene: Scene, shapes: Sequence[BalloonShape], obstacles: Sequence[ObstacleShape], bodies: Sequence[BodyShape]
) -> bool:
    """Return whether faces of balloons touch ridges: the scene says so, or something is thin beside them, or tilted."""
    solids = solids_of(obstacles, bodies)
    if scene.faces is True or not scene.faces_may_meet:
        return scene.faces_may_meet and any(solid.kind != "plane" for solid in solids)
    widest = max(edge_length(shape.mesh) for shape in shapes)
    return any(is_thin(solid, THIN * widest) for solid in solids) or _any_on_edge(scene, obstacles)


def _any_on_edge(scene: Scene, obstacles: Sequence[ObstacleShape]) -> bool:
    """Return whether a box stands on an edge or a corner at the start: a balloon that falls on it meets such first."""
    boxes = [number for number, solid in enumerate(obstacles) if solid.kind == "box"]
    if not boxes:
        return False
    from scipy.spatial.transform import Rotation  # takes long to load

    turns = Rotation.from_quat(obstacle_motion(scene)[0][boxes, 3:])
    return bool((np.abs(turns.inv().apply(np.array(scene.up))).max(axis=1) < np.cos(LEVEL)).any())


def solids_of(obstacles: Sequence[ObstacleShape], bodies: Sequence[BodyShape]) -> list[ObstacleShape]:
    """Return obstacles, and after them bodies about their centers of mass."""
    return [*obstacles, *(body.solid for body in bodies)]


def ridges_of(solid: ObstacleShape, up: NDArray[np.float64], edge: float) -> Ridges:
    """Find the ridges of a solid; a plane has none.

    Args:
        edge: mean one of the balloons [m]: a surface that turns less within that is round to them, and no ridge.
    """
    if solid.kind == "box":
        ridges = _ridges_of_box(solid.size)
    elif solid.kind == "capsule":
        ends = np.stack([-solid.size[1] * up, solid.size[1] * up])[None]
        ridges = Ridges(ends, np.zeros((1, 2, 3)), float(solid.size[0]), np.array([3], np.int32))
    elif solid.mesh is not None:
        ridges = _ridges_of_mesh(solid.mesh, solid.triangles, solid.closed, edge)
    else:
        ridges = NO_RIDGES
    return ridges._replace(radius=ridges.radius + solid.thickness)


def _ridges_of_box(half: NDArray[np.float64]) -> Ridges:
    ends, inward = [], []
    for axis in range(3):
        for corner in BOX_SIGNS[BOX_SIGNS[:, axis] < 0.0]:
            along = np.eye(3)[axis]
            ends.append([corner * half, (corner + 2.0 * along) * half])
            inward.append([-corner[other] * np.eye(3)[other] for other in range(3) if other != axis])
    return with_tips(np.array(ends), np.array(inward), 0.0)


def _ridges_of_mesh(mesh: PolygonMesh, triangles: NDArray[np.int32], closed: bool, edge: float) -> Ridges:
    """Return rims of sheets, and edges between triangles that are not flat; of closed meshes, the convex ones."""
    points = mesh.points
    surface = PolygonMesh(points, np.full(len(triangles), 3, np.int32), triangles.ravel())
    areas = face_vector_areas(surface)
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    begin = triangles.ravel()
    end = np.roll(triangles, -1, axis=1).ravel()
    apex = np.roll(triangles, -2, axis=1).ravel()
    faces = np.repeat(np.arange(len(triangles)), 3)
    keys, numbers = np.unique(np.sort(np.stack([begin, end], axis=1), axis=1), axis=0, return_inverse=True)
    order = np.argsort(numbers.ravel(), kind="stable")
    starts = np.searchsorted(numbers.ravel()[order], np.arange(len(keys) + 1))
    ends, inward = [], []
    for number, (first, last) in enumerate(pairwise(starts)):
        sides = order[first:last]
        a, b = points[keys[number]]
        if np.array_equal(a, b):
            continue
        across = [_across(a, b, points[apex[side]]) for side in sides[:2]]
        lengths = [float(np.linalg.norm(way)) for way in across]
        within = [way / max(length, 1e-300) for way, length in zip(across, lengths, strict=True)]
        if len(sides) == 2:
            rise = float(normals[faces[sides[0]]] @ within[1])
            turn = np.arctan2(abs(rise), normals[faces[sides[0]]] @ normals[faces[sides[1]]])
            # the surface turns once on the way through half of both triangles
            if turn * max(1.0, 2.0 * edge / max(sum(lengths), 1e-300)) <= FLAT or (closed and rise > 0.0):
                continue
        known = within if len(sides) <= 2 else [np.zeros(3)]
        ends.append([a, b])
        inward.append([*known, np.zeros(3)][:2])
    return with_tips(np.array(ends).reshape(-1, 2, 3), np.array(inward).reshape(-1, 2, 3), 0.0)


def _across(a: NDArray[np.float64], b: NDArray[np.float64], apex: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vector from an edge, across it, to a triangle's third corner."""
    along = (b - a) / np.linalg.norm(b - a)
    return apex - a - ((apex - a) @ along) * along


def with_tips(ends: NDArray[np.float64], inward: NDArray[np.float64], radius: float) -> Ridges:
    """Assign each corner to the first ridge that ends there."""
    _, firsts = np.unique(ends.reshape(-1, 3), axis=0, return_index=True)
    own = np.zeros(2 * len(ends), np.int32)
    own[firsts] = 1
    tips = own[0::2] + 2 * own[1::2]
    return Ridges(ends, inward, radius, tips.astype(np.int32))


def all_ridges(
    scene: Scene, shapes: Sequence[BalloonShape], obstacles: Sequence[ObstacleShape], bodies: Sequence[BodyShape]
) -> list[Ridges]:
    """Find the ridges of obstacles, then of bodies, that faces of balloons meet; none where faces meet none."""
    if not faces_meet(scene, shapes, obstacles, bodies):
        return []
    edge = max(edge_length(shape.mesh) for shape in shapes)
    return [ridges_of(solid, np.array(scene.up), edge) for solid in solids_of(obstacles, bodies)]


def kept_distance(shapes: Sequence[BalloonShape]) -> float:
    """Return how far faces of balloons are kept from ridges [m]."""
    return KEPT * THICKNESS * min(edge_length(shape.mesh) for shape in shapes)


def ridge_tree(ridges: Ridges, device: wp.Device) -> wp.Bvh | None:
    """Make a tree of boxes around ridges; none of none."""
    if not len(ridges.ends):
        return None
    lower, upper = ridges.ends.min(axis=1) - ridges.radius, ridges.ends.max(axis=1) + ridges.radius
    return wp.Bvh(wp.array(lower, dtype=wp.vec3, device=device), wp.array(upper, dtype=wp.vec3, device=device))

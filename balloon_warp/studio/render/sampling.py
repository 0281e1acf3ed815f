"""Samples of a stage: its frames and an open shutter, triangles as rays see them, points in a pixel and on a light.

Stages of other programs count time in seconds, in 4,800 codes a second, or between codes. Such a stage is looked at
through another one whose time codes are its frames: USD scales the time of a sublayer by the two rates.

Points in a pixel and on a light are the same every time, so that pictures are.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from balloon_warp.errors import InputError
from balloon_warp.mesh.orientation import find_folds
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import component_labels, face_vector_areas, next_corners, triangulate, vertex_normals

SLOWEST, FASTEST = 8.0, 240.0
"""Range of the frame rate of a stage whose time codes are frames [1/s]"""
USUAL_RATE = 24.0
"""Frame rate of a stage that has none [1/s]"""
NEAR = 1e-3
"""Largest distance of a sample from a frame to count as there [frames]"""
EARLIER = 1e-6
"""Shift of samples, so that rounding leaves none behind its frame [frames]"""


class Timing(NamedTuple):
    """A stage whose frames are whole time codes."""

    stage: Usd.Stage
    first: int
    """Number of the first frame"""
    last: int
    """Number of the last frame"""
    rate: float
    """Frame rate [1/s]"""


def timing_of(stage: Usd.Stage, path: Path) -> Timing:
    """Find the frames of a stage: its samples within the range that it says, at their own times.

    Raises:
        InputError: the rate is not positive, or the range is not finite or not in order.
    """
    rate, frame_rate = stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()
    if not 0.0 < rate < math.inf:
        raise InputError(f"{path}: its timeCodesPerSecond is {rate:g}; expected a rate above 0")
    attributes = [attribute for prim in stage.Traverse() for attribute in prim.GetAttributes()]
    samples = np.array(Usd.Attribute.GetUnionedTimeSamples(attributes))
    begin, end = _range(stage, path, samples)
    samples = samples[(samples >= begin) & (samples <= end)]
    whole = np.abs(samples - np.round(samples)).max(initial=0.0) < NEAR
    if whole and (SLOWEST <= rate <= FASTEST or len(samples) < 2):
        first = math.ceil(begin)
        # Where no whole frame is between them, the next one shows the state of the last time code.
        return Timing(stage, first, max(first, math.floor(end)), rate)
    frames = _frame_rate(samples, rate, frame_rate if 0.0 < frame_rate < math.inf else USUAL_RATE)
    begin = float(samples[0]) if len(samples) else begin
    count = math.floor((end - begin) / rate * frames + NEAR)
    return Timing(_seen_through(stage, frames, -begin / rate * frames - EARLIER), 0, count, frames)


def _range(stage: Usd.Stage, path: Path, samples: NDArray[np.float64]) -> tuple[float, float]:
    """Return the first and the last time code: those samples in the stage's range.

    All samples where the range has none, or is missing; one where nothing moves.
    """
    spans = (float(samples[0]), float(samples[-1])) if len(samples) else (0.0, 0.0)
    if not stage.HasAuthoredTimeCodeRange():
        return spans
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not -math.inf < start <= end < math.inf:
        raise InputError(f"{path}: its time codes go from {start:g} to {end:g}; expected finite ones, in order")
    if len(samples) < 2:
        only = max(start, min(end, spans[0])) if len(samples) else start
        return only, only
    begin, last = max(start, spans[0]), min(end, spans[1])
    return (begin, last) if begin <= last else spans


def _frame_rate(samples: NDArray[np.float64], rate: float, usual: float) -> float:
    """Return a frame rate at which all samples are frames, the usual or more; the usual where there is none.

    Args:
        samples: time codes, ascending.
        rate: time codes a second.
        usual: frames a second.
    """
    if len(samples) < 2:
        return usual
    shortest = float(np.diff(samples).min())
    steps = (samples - samples[0]) / shortest
    own = round(rate / shortest, 9)
    if np.abs(steps - np.round(steps)).max() > NEAR or own > FASTEST:
        return usual
    return own * max(1, round(usual / own)) if own < SLOWEST else own


def _seen_through(stage: Usd.Stage, rate: float, offset: float) -> Usd.Stage:
    """Return a stage with another rate of time codes and an offset, with the same prims at the same seconds."""
    root, layer = stage.GetRootLayer(), Sdf.Layer.CreateAnonymous(".usda")
    layers = [stage.GetSessionLayer(), root]
    layer.timeCodesPerSecond = layer.framesPerSecond = rate
    for number, each in enumerate(layers):
        layer.subLayerPaths.append(each.identifier)
        layer.subLayerOffsets[number] = Sdf.LayerOffset(offset, 1.0)
    layer.customLayerData = root.customLayerData
    seen = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(seen, UsdGeom.GetStageUpAxis(stage))
    UsdGeom.SetStageMetersPerUnit(seen, UsdGeom.GetStageMetersPerUnit(stage))
    return seen


MOMENTS = 8
"""Number of moments within the shutter time"""


def moments(frame: int, shutter: float, last_frame: int) -> list[float]:
    """Return evenly spaced times within the shutter time, which begins at the frame, or ends at the last one.

    Args:
        shutter: how long that is, in frames.
    """
    if shutter == 0.0:
        return [frame]
    begin = min(float(frame), last_frame - shutter)
    return [begin + shutter * (number + 0.5) / MOMENTS for number in range(MOMENTS)]


def one_over_the_other(pictures: Iterable[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return the mean of pictures, as light adds up; clear pixels add no light."""
    several = list(pictures)
    total = np.zeros(1)
    for picture in several:
        light = LINEAR[picture[..., :3]]
        cover = picture[..., 3:] / 255.0 if picture.shape[2] == 4 else np.ones((1, 1, 1))
        total = total + np.concatenate([light * cover, np.broadcast_to(cover, (*light.shape[:2], 1))], axis=2)
    light = total[..., :3] / np.maximum(total[..., 3:], 1e-9)
    shown = np.searchsorted(_STEPS, light).astype(np.uint8)
    if several[0].shape[2] == 3:
        return shown
    return np.concatenate([shown, np.rint(255.0 * total[..., 3:] / len(several)).astype(np.uint8)], axis=2)


def _linear(encoded: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the inverse of sRGB's transfer function."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


LINEAR = _linear(np.arange(256) / 255.0)
"""Linear light of each byte of sRGB"""
_STEPS = _linear((np.arange(255) + 0.5) / 255.0)


class Cut(NamedTuple):
    """A mesh in vertices of one normal each."""

    corner_vertices: NDArray[np.int32]
    """Vertex of each corner of the mesh's faces, shape (corner_count,)"""
    vertex_points: NDArray[np.integer]
    """Point of each vertex, shape (vertex_count,)"""
    creases: NDArray[np.int32]
    """Sharp edges, a pair of vertices each, lower first, those of both sides, shape (crease_count, 2)"""


def leave_whole(mesh: PolygonMesh) -> Cut:
    """Return a vertex for each point."""
    return Cut(mesh.face_vertex_indices, np.arange(mesh.vertex_count), np.empty((0, 2), np.int32))


def cut_at_creases(mesh: PolygonMesh, angle: float) -> Cut:
    """Return a vertex for each point and each smooth part of the surface about it.

    Args:
        angle: between two faces' normals, beyond which their edge is sharp [degrees].
    """
    tails, following = mesh.face_vertex_indices, next_corners(mesh)
    one, other, sharp = find_folds(mesh, angle)
    # Corners at one point are one vertex if faces lead from one to the other across smooth edges.
    pairs = [(a, b) for a in (one, following[one]) for b in (other, following[other])]
    first_corners, second_corners = (np.concatenate(corners) for corners in zip(*pairs, strict=True))
    joined = np.tile(~sharp, len(pairs)) & (tails[first_corners] == tails[second_corners])
    groups = component_labels(len(tails), first_corners[joined], second_corners[joined])
    _, representative, vertices = np.unique(groups, return_index=True, return_inverse=True)
    vertices = vertices.ravel().astype(np.int32)
    creases = np.concatenate([one[sharp], other[sharp]])
    ends = np.sort(np.stack([vertices[creases], vertices[following[creases]]], axis=1), axis=1)
    return Cut(vertices, tails[representative], ends)


TILE = 4
"""Side of a tile whose pixels share one well-spread set of samples [pixels]"""


def spread_points(count: int) -> NDArray[np.float64]:
    """Return Well-spread points in the unit square, shape (count, 2): a lattice sheared by the golden ratio."""
    numbers = np.arange(count)
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    return np.stack([(numbers + 0.5) / count, np.modf(0.5 + numbers * golden)[0]], axis=1)


def disc_points(samples: int) -> NDArray[np.float32]:
    """Return the points in the unit disc for each sample of each pixel of a tile, shape (samples, TILE * TILE, 2).

    Concentric map of Shirley and Chiu (1997), which keeps neighbors neighbors.
    """
    a, b = (2.0 * spread_points(samples * TILE * TILE) - 1.0).T
    wide = np.abs(a) > np.abs(b)
    radius = np.where(wide, a, b)
    ratio = np.divide(np.where(wide, b, a), radius, out=np.zeros_like(a), where=radius != 0.0)
    angle = np.where(wide, np.pi / 4.0 * ratio, np.pi / 2.0 - np.pi / 4.0 * ratio)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return points.reshape(samples, TILE * TILE, 2).astype(np.float32)


MOST_TRIANGLES = 60_000
"""Number of triangles beyond which a surface is not refined, since they are small enough in a picture"""
QUARTERS = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]
"""Quarters of a triangle, by its corners and the middles of its sides"""


class SmoothSurface:
    """The fixed part of a mesh: its triangles, and the edges on which new vertices are put.

    A new vertex lies on the curve through an edge's ends that meets their normals at right angles, as in PN triangles
    (Vlachos et al. 2001, "Curved PN Triangles"); the old vertices stay where they are. Along creases the surface is
    cut: each side has vertices and normals of its own, and new vertices lie on the straight edge, so that no gap opens.

    Args:
        mesh: its topology is kept; its points may differ from frame to frame.
        crease: the angle at the mesh's points beyond which an edge is sharp [degrees]; if missing, it is smooth
            everywhere.
    """

    def __init__(self, mesh: PolygonMesh, crease: float | None = None):
        corner_vertices, self._source, sharp = leave_whole(mesh) if crease is None else cut_at_creases(mesh, crease)
        self._mesh = replace(mesh, points=mesh.points[self._source], face_vertex_indices=corner_vertices)
        self._at_crease = np.zeros(len(self._source), bool)
        self._at_crease[sharp] = True
        self.triangles, self._faces = triangulate(self._mesh)
        corner_numbers = np.arange(len(corner_vertices), dtype=np.int32)
        self._corners = triangulate(replace(self._mesh, face_vertex_indices=corner_numbers))[0]
        self._edges: list[NDArray[np.int32]] = []
        self._straight: list[NDArray[np.bool_]] = []
        self.vertex_count = len(self._source)
        while 0 < 4 * len(self.triangles) <= MOST_TRIANGLES and len(self._edges) < 2:
            edges, self.triangles = _split(self.triangles, self.vertex_count)
            straight = _among(edges, sharp)
            middles = self.vertex_count + np.flatnonzero(straight)
            sharp = np.concatenate([np.stack([edges[straight, end], middles], axis=1) for end in (0, 1)])
            self.vertex_count += len(edges)
            self._edges.append(edges)
            self._straight.append(straight)

    def triangles_of(self, faces: NDArray) -> NDArray:
        """Return values of the mesh's faces, such as visibility, shape (face_count,), at the surface's triangles."""
        return np.repeat(faces[self._faces], 4 ** len(self._edges))

    def spread(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return values at the corners of the mesh's faces, shape (corner_count, k), at those of the triangles.

        Corners at new vertices have the mean of the two that they are between, within their face.
        """
        spread = values[self._corners]
        for _ in self._edges:
            middles = 0.5 * (spread + spread[:, [1, 2, 0]])
            spread = np.concatenate([spread, middles], axis=1)[:, QUARTERS].reshape(-1, 3, values.shape[1])
        return spread.reshape(-1, values.shape[1])

    def _evened(self, mesh: PolygonMesh) -> NDArray[np.float64]:
        """Return normals of vertices, each turned toward its neighbors' as the limit of subdivision turns them.

        A highlight shows where normals change abruptly. Normals at creases stay. Faces count by their areas, or the
        narrow ones at a box's edges would make its sides bulge.
        """
        normals, counts, corners = vertex_normals(mesh), mesh.face_vertex_counts, mesh.face_vertex_indices
        weights = np.linalg.norm(face_vector_areas(mesh), axis=1) / counts
        sides = np.add.reduceat(normals[corners], np.cumsum(counts) - counts) * weights[:, None]
        sides = np.repeat(sides, counts, axis=0)
        sums = np.stack([np.bincount(corners, side, len(normals)) for side in sides.T], axis=1)
        length = np.linalg.norm(sums, axis=1, keepdims=True)
        return np.divide(sums, length, out=normals.copy(), where=(length > 1e-12) & ~self._at_crease[:, None])

    def vertex_areas(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the area of the mesh's faces around all vertices; that of new ones is interpolated."""
        mesh = replace(self._mesh, points=points[self._source])
        counts = mesh.face_vertex_counts
        shares = np.repeat(np.linalg.norm(face_vector_areas(mesh), axis=1) / counts, counts)
        areas = np.bincount(mesh.face_vertex_indices, shares, mesh.vertex_count).astype(np.float64)
        for edges in self._edges:
            areas = np.concatenate([areas, areas[edges].mean(axis=1)])
        return areas

    def place(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return all vertices for the mesh's points, and their unit normals, each of shape (vertex_count, 3)."""
        points = points[self._source]
        normals = self._evened(replace(self._mesh, points=points))
        for edges, straight in zip(self._edges, self._straight, strict=True):
            begin, end = points[edges[:, 0]], points[edges[:, 1]]
            normal_begin, normal_end = normals[edges[:, 0]], normals[edges[:, 1]]
            span = end - begin
            bulge = _dot(span, normal_end) * normal_end - _dot(span, normal_begin) * normal_begin
            bulge[straight] = 0.0
            points = np.concatenate([points, 0.5 * (begin + end) + 0.125 * bulge])
            between = normal_begin + normal_end
            length = np.linalg.norm(between, axis=1, keepdims=True)
            normals = np.concatenate(
                [normals, np.where(length > 0.0, between / np.maximum(length, 1e-30), normal_begin)]
            )
        return points, normals


def _among(edges: NDArray[np.int32], some: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return a mask of the edges among some, shape (len(edges),); pairs of vertices, lower first."""
    factor = np.int64(1) << 32
    return np.isin(edges[:, 0] * factor + edges[:, 1], some[:, 0] * factor + some[:, 1])


def _split(triangles: NDArray[np.int32], vertex_count: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return each triangle in four: the edges that get a vertex, in order, and the new triangles."""
    sides = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges, side_edge = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    middle = (vertex_count + side_edge.reshape(-1, 3)).astype(np.int32)
    corners = np.concatenate([triangles, middle], axis=1)
    return edges, corners[:, QUARTERS].reshape(-1, 3)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.einsum("ij,ij->i", a, b)[:, None]

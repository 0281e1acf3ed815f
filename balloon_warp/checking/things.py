"""The things of a stage that should not cross: balloons, obstacles, free bodies, spheres and the ground."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdPhysics

from balloon_warp.errors import InputError
from balloon_warp.mesh.geometry import first_coincident
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.outputs.usd.obstacle import HALF_SPACE
from balloon_warp.outputs.usd.presence import is_shown

Kind = Literal["balloon", "obstacle", "body", "sphere", "ground"]
BOX_FACES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)], np.int32)
"""Corners of each face of a box, counter-clockwise from outside"""


@dataclass(frozen=True)
class Placed:
    """Placement of a prim at a time."""

    matrix: NDArray[np.float64]
    """Matrix to the world, for row vectors [m]"""

    def of(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return a prim's points in the world [m], shape (n, 3)."""
        return points.astype(np.float64) @ self.matrix[:3, :3] + self.matrix[3, :3]


def placed(prim: Usd.Prim, time: Usd.TimeCode, unit: float) -> Placed:
    """Find where a prim is; `unit` is the stage's [m]."""
    matrix = np.array(UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(time))
    matrix[:, :3] *= unit
    return Placed(matrix)


class Thing:
    """Thing of a stage.

    Args:
        prim: of the thing in the stage.
        group: those of one group do not meet.
    """

    def __init__(self, prim: Usd.Prim, kind: Kind, group: int):
        self.prim, self.kind, self.group = prim, kind, group
        self.name = prim.GetName()

    @property
    def said(self) -> str:
        """Name of the thing for people."""
        return "the ground" if self.kind == "ground" else f"{self.kind} {self.name}"

    def is_there(self, time: Usd.TimeCode) -> bool:
        """Return whether the thing is visible at a time."""
        return UsdGeom.Imageable(self.prim).ComputeVisibility(time) != UsdGeom.Tokens.invisible


class Surface(Thing):
    """A mesh, or a box, as triangles."""

    def __init__(self, prim: Usd.Prim, kind: Kind, group: int, times: list[Usd.TimeCode]):
        super().__init__(prim, kind, group)
        self._mesh = UsdGeom.Mesh(prim)
        self._box = _box_of(prim) if kind != "balloon" else None
        self._start = Usd.TimeCode.EarliestTime()  # contact takes quads for two triangles, as they are then
        self._same = self._mesh.GetFaceVertexIndicesAttr().GetNumTimeSamples() == 0
        self.triangles = self._triangles_at(times[0])
        """Corners of each triangle, shape (triangle_count, 3), at the first time"""
        own = [self._own_points(time) for time in (times[0], times[len(times) // 2], times[-1])]
        self.vertices = first_coincident(np.concatenate(own, axis=1))
        """First point that is always at the same place, for each point: those of a seam count as one"""

    @property
    def soft(self) -> bool:
        """Return whether the surface is deformable."""
        return self.kind == "balloon"

    @property
    def is_closed(self) -> bool:
        """Return whether each edge has one triangle on either side, so that something can be inside."""
        ends = self.vertices[self.triangles]
        edges = np.concatenate([ends[:, [0, 1]], ends[:, [1, 2]], ends[:, [2, 0]]])
        across = edges[:, ::-1]
        forward, back = (np.unique(pairs, axis=0, return_counts=True) for pairs in (edges, across))
        return bool(len(forward[0])) and np.array_equal(forward[0], back[0]) and bool((forward[1] == 1).all())

    def at(self, time: Usd.TimeCode, unit: float) -> NDArray[np.float64]:
        """Return the surface's points in the world [m], shape (point_count, 3).

        Raises:
            InputError: they are others than at the first time, or not finite.
        """
        points = placed(self.prim, time, unit).of(self._own_points(time))
        if len(points) != len(self.vertices) or not np.isfinite(points).all():
            raise InputError(
                f"{self.prim.GetPath()}: has {len(points)} points at frame {time.GetValue():g}, or points that are not "
                f"finite; expected {len(self.vertices)} finite points at every frame"
            )
        if not self._same:
            self.triangles = self._triangles_at(time)
        return points

    def rest_points(self) -> NDArray[np.float64]:
        """Return the surface's points in its own frame."""
        return self._own_points(Usd.TimeCode.EarliestTime())

    def _own_points(self, time: Usd.TimeCode) -> NDArray[np.float64]:
        if self._box is not None:
            return self._box
        return np.asarray(self._mesh.GetPointsAttr().Get(time) or [], np.float64).reshape(-1, 3)

    def _triangles_at(self, time: Usd.TimeCode) -> NDArray[np.int32]:
        if self._box is not None:
            return np.concatenate([BOX_FACES[:, [0, 1, 2]], BOX_FACES[:, [0, 2, 3]]])
        counts, indices = (
            np.asarray(attribute.Get(time) or [], np.int32)
            for attribute in (self._mesh.GetFaceVertexCountsAttr(), self._mesh.GetFaceVertexIndicesAttr())
        )
        points = self._own_points(self._start)
        if (counts < 3).any() or counts.sum() != len(indices) or ((indices < 0) | (indices >= len(points))).any():
            raise InputError(f"{self.prim.GetPath()}: its faces do not match its {len(points)} points")
        return triangles_of(PolygonMesh(points, counts, indices)).astype(np.int32)


class Round(Thing):
    """A sphere or a capsule."""

    def at(self, time: Usd.TimeCode, unit: float) -> tuple[NDArray[np.float64], float]:
        """Return both ends of its axis, shape (2, 3), and its radius [m]."""
        place, shape = placed(self.prim, time, unit), UsdGeom.Sphere(self.prim) or UsdGeom.Capsule(self.prim)
        ends = np.zeros((2, 3))
        if capsule := UsdGeom.Capsule(self.prim):
            half = 0.5 * capsule.GetHeightAttr().Get(time)
            ends[:, "XYZ".index(capsule.GetAxisAttr().Get(time))] = -half, half
        scale = float(np.cbrt(abs(np.linalg.det(place.matrix[:3, :3]))))
        return place.of(ends), shape.GetRadiusAttr().Get(time) * scale


class HalfSpace(Thing):
    """The ground, or a plane: nothing should be below."""

    def at(self, time: Usd.TimeCode, unit: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return a point of it, and its normal."""
        a, b, c = placed(self.prim, time, unit).of(np.asarray(UsdGeom.Mesh(self.prim).GetPointsAttr().Get(time)))[:3]
        normal = np.cross(b - a, c - a)
        return a, normal / np.linalg.norm(normal)


def things_of(stage: Usd.Stage, times: list[Usd.TimeCode]) -> list[Thing]:
    """Find the visible things of a stage, water excluded."""
    found: list[Thing] = []
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
        if UsdGeom.Imageable(prim) and is_shown(prim):
            kind = _kind_of(prim)
            group = len(found) + 1 if kind in ("balloon", "body", "sphere") else 0
            if UsdGeom.Sphere(prim) or UsdGeom.Capsule(prim):
                found.append(Round(prim, kind, group))
            elif UsdGeom.Mesh(prim) and (kind == "ground" or prim.HasCustomDataKey(HALF_SPACE)):
                found.append(HalfSpace(prim, kind, group))
            elif UsdGeom.Mesh(prim) and not prim.HasCustomDataKey(SCENERY):
                found.append(Surface(prim, kind, group, times))
    return found


def _kind_of(prim: Usd.Prim) -> Kind:
    if prim.GetCustomDataByKey(SCENERY) == "Ground":
        return "ground"
    body = UsdPhysics.RigidBodyAPI(prim) if prim.HasAPI("PhysicsRigidBodyAPI") else None
    if UsdGeom.Sphere(prim):
        return "sphere"
    if body and not body.GetKinematicEnabledAttr().Get():
        return "body"
    moves = UsdGeom.Mesh(prim) and UsdGeom.Mesh(prim).GetPointsAttr().GetNumTimeSamples() > 0
    return "balloon" if moves else "obstacle"


def _box_of(prim: Usd.Prim) -> NDArray[np.float64] | None:
    """Return the sharp corners of a box that is drawn with round edges; None of other things."""
    collider = UsdPhysics.MeshCollisionAPI(prim)
    if not prim.HasAPI("PhysicsMeshCollisionAPI"):
        return None
    if collider.GetApproximationAttr().Get() != UsdPhysics.Tokens.boundingCube:
        return None
    lower, upper = np.asarray(UsdGeom.Mesh(prim).GetExtentAttr().Get(), np.float64)
    sides = np.stack([lower, upper])
    return np.array([(sides[x, 0], sides[y, 1], sides[z, 2]) for x in (0, 1) for y in (0, 1) for z in (0, 1)])

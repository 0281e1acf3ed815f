"""Visible parts of a stage, as moving polygon meshes of fixed topology, for all exports."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.usd_surfaces import texture_coordinates
from balloon_warp.outputs.moment import Z_TO_Y_UP
from balloon_warp.outputs.render.appearance import read_colors
from balloon_warp.outputs.render.covering import Covering, plain_covering, read_covering
from balloon_warp.outputs.render.stage_reader import DRAWN, RenderStage
from balloon_warp.outputs.tubes import tube_points, tube_topology
from balloon_warp.outputs.usd.presence import is_shown

LEVEL = ("ground", "floor", "water", "pool")
"""Names of level planes: no export has them, as they are far larger than the parts that move above them"""


@dataclass(frozen=True)
class Part:
    """Thing that a stage shows."""

    name: str
    prim: Usd.Prim
    mesh: PolygonMesh
    """Mesh at the first frame, in the prim's own coordinates"""
    soft: bool
    """Whether its points move in the prim's own coordinates"""
    local_points: Callable[[float], NDArray[np.float64]]
    """Function for the points in a frame, in the prim's own coordinates, shape (vertex_count, 3)"""
    covering: Covering
    """Look of the faces; images are placed by `mesh.texture_coordinates`"""

    @property
    def color(self) -> tuple[float, float, float]:
        """Linear RGB, the mean of several colors."""
        red, green, blue = self.covering.colors.mean(axis=0).tolist()
        return red, green, blue

    def matrix(self, frame: float) -> NDArray[np.float64]:
        """Return the matrix from the prim's own coordinates to the stage's, for row vectors, shape (4, 4)."""
        return np.array(UsdGeom.XformCache(Usd.TimeCode(frame)).GetLocalToWorldTransform(self.prim))

    def points(self, frame: float) -> NDArray[np.float64]:
        """Return the part's points in the stage, in the stage's unit, shape (vertex_count, 3)."""
        points = self.local_points(frame)
        if len(points) != self.mesh.vertex_count or not np.isfinite(points).all():
            raise InputError(
                f"{self.prim.GetPath()}: has {len(points)} points at frame {frame:g}, or points that are not "
                f"finite; expected {self.mesh.vertex_count} finite points"
            )
        matrix = self.matrix(frame)
        return points @ matrix[:3, :3] + matrix[3, :3]

    def velocities(self, frame: float) -> NDArray[np.float64] | None:
        """Return the velocities of its points in the stage, a second, shape (vertex_count, 3), if the prim has them."""
        prim = UsdGeom.PointBased(self.prim)
        own = prim.GetVelocitiesAttr().Get(frame) if prim else None
        if own is None or len(own) != self.mesh.vertex_count:
            return None
        return np.asarray(own, np.float64) @ self.matrix(frame)[:3, :3]

    def seen(self, frame: float) -> bool:
        """Return whether the part is visible."""
        visibility = UsdGeom.Imageable(self.prim).ComputeVisibility(Usd.TimeCode(frame))
        return visibility != UsdGeom.Tokens.invisible


class Animation:
    """The parts of a stage and its time.

    Args:
        path: any file that USD opens.
        on_note: called with sentences on missing files and left-out shapes of the stage.

    Raises:
        InputError: the file cannot be read as a stage, or there is nothing to export in it.
    """

    def __init__(self, path: Path, on_note: Callable[[str], None] = lambda sentence: None):
        opened = RenderStage(path, rounds=True, on_note=on_note)
        self.path, self.stage = path, opened.stage
        self.frames = range(opened.first_frame, opened.last_frame + 1)
        self.frames_per_second = float(opened.frames_per_second)
        self.parts = self._find_parts()
        if not self.parts:
            raise InputError(f"{path}: has no mesh, solid shape or linear curves to export")

    @cached_property
    def balloons(self) -> list[Part]:
        """The parts whose meshes have points that move, without strings and tubes."""
        return [part for part in self.parts if part.soft and bool(UsdGeom.Mesh(part.prim))]

    @property
    def meters_per_unit(self) -> float:
        return float(UsdGeom.GetStageMetersPerUnit(self.stage))

    @property
    def up_axis(self) -> str:
        return str(UsdGeom.GetStageUpAxis(self.stage))

    def y_up_meters(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points of the stage in meters with Y up, as files have them that cannot say otherwise."""
        return points @ (Z_TO_Y_UP if self.up_axis == "Z" else np.eye(3)) * self.meters_per_unit

    def seconds(self, frame: int) -> float:
        """Return the time of a frame, from the first on [s]."""
        return (frame - self.frames[0]) / self.frames_per_second

    def _find_parts(self) -> list[Part]:
        parts, names = [], set[str]()
        for prim in Usd.PrimRange(self.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
            if not any(kind(prim) for kind in DRAWN) or not is_shown(prim):
                continue
            part = _part_of(prim, self.frames[0], prim.GetName())
            if part is None or _is_level(part):
                continue
            words = [part.name, f"{prim.GetParent().GetName()}_{part.name}", str(prim.GetPath())[1:].replace("/", "_")]
            name = next((word for word in words if word not in names), words[-1])
            names.add(name)
            parts.append(replace(part, name=name))
        return parts


def _is_level(part: Part) -> bool:
    return part.name.lower() in LEVEL and part.mesh.face_count == 1


def _part_of(prim: Usd.Prim, first: int, name: str) -> Part | None:
    """Return the part of a prim that is drawn; None where it has no faces."""
    soft, uv, covering = False, None, None
    place: Callable[[float], NDArray[np.float64]]
    if UsdGeom.Mesh(prim):
        mesh = UsdGeom.Mesh(prim)
        soft = mesh.GetPointsAttr().GetNumTimeSamples() > 0
        counts, indices = (
            np.asarray(attribute.Get(first) or [], np.int32)
            for attribute in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
        )
        place = _points_of(mesh)
        point_count = len(place(first))
        if np.any(counts < 0) or counts.sum() != len(indices) or np.any((indices < 0) | (indices >= point_count)):
            raise InputError(f"{prim.GetPath()}: its faces do not match its {point_count} points")
        whole = np.repeat(counts, counts) >= 3
        covering, uv = (
            read_covering(mesh, counts, indices, point_count, counts >= 3),
            texture_coordinates(mesh, "st", indices),
        )
        counts, indices = counts[counts >= 3], indices[whole]
        uv = covering.places if covering.places is not None else None if uv is None else uv[whole]
    else:
        curves = UsdGeom.BasisCurves(prim)
        if curves.GetTypeAttr().Get() != UsdGeom.Tokens.linear:
            return None
        soft = curves.GetPointsAttr().GetNumTimeSamples() > 0
        lengths = np.asarray(curves.GetCurveVertexCountsAttr().Get(first) or [], np.int32)
        counts, indices = tube_topology(lengths)
        center, radius = _points_of(curves), 0.5 * float(np.mean(curves.GetWidthsAttr().Get(first) or [0.01]))

        def around(frame: float) -> NDArray[np.float64]:
            return tube_points(center(frame), lengths, radius)

        place = around

    if not len(counts):
        return None
    mesh = PolygonMesh(place(first), counts, indices, name=name, texture_coordinates=uv)
    if covering is None:
        color = read_colors(UsdGeom.Gprim(prim), np.ones(1, np.int32))
        covering = plain_covering(prim, color, len(counts), len(indices))
    return Part(name, prim, mesh, soft, place, covering)


def _points_of(prim: UsdGeom.PointBased) -> Callable[[float], NDArray[np.float64]]:
    attribute = prim.GetPointsAttr()
    return lambda frame: np.asarray(attribute.Get(frame) or [], np.float64).reshape(-1, 3)

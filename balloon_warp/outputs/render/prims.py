"""The prims that are drawn: their fixed part, read once, and their places at a moment."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from balloon_warp.errors import InputError
from balloon_warp.mesh.folds import CREASE, SOFT_CREASE
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.outputs.moment import Moment
from balloon_warp.outputs.render.appearance import read_colors, read_finish
from balloon_warp.outputs.render.covering import Covering, read_covering
from balloon_warp.outputs.render.printed import read_texels
from balloon_warp.outputs.render.surface import SmoothSurface
from balloon_warp.outputs.usd.deformable import REST_POINTS


class Capsules(NamedTuple):
    """Round lines and, where begin and end are one, spheres. In the world, Y up."""

    begins: NDArray[np.float64]
    """Begin of each line, shape (n, 3)"""
    ends: NDArray[np.float64]
    """End of each line, shape (n, 3)"""
    radii: NDArray[np.float64]
    """Radii of lines, shape (n,)"""


class SurfaceCover:
    """Look of a surface's triangles."""

    def __init__(self, surface: SmoothSurface, covering: Covering):
        self.colors = surface.spread(covering.colors)
        """Colors at the triangles' corners, three each"""
        rows = np.array([cover.finish.as_row() for cover in covering.covers])
        of_triangles = surface.triangles_of(covering.of_faces)
        self.finishes = rows[of_triangles]
        """Finish of each triangle, shape (n, 4)"""
        textures = [cover.texture for cover in covering.covers]
        self.images = [read_texels(texture) for texture in textures if texture]
        """Images in linear RGB, shape (height, width, 3) each"""
        numbers = np.cumsum([texture is not None for texture in textures]) - 1
        own = [number if texture else -1 for number, texture in zip(numbers.tolist(), textures, strict=True)]
        self.image_of_triangle = np.array(own)[of_triangles]
        """-1 where there is none"""
        self.places = surface.spread(covering.places) if covering.places is not None else None
        """Texture coordinates at the triangles' corners, three each"""


SHRUNK = (0.02, 4.0)
"""Range of the area before over the area now that shows"""


class MeshPrim:
    """Prim of a UsdGeom.Mesh of fixed topology.

    Faces whose corners come to be all at one vertex are not drawn.
    """

    def __init__(self, prim: Usd.Prim, moment: Moment, start: Moment):
        self._mesh = UsdGeom.Mesh(prim)
        points = _points(self._mesh, moment)
        counts, indices = (
            np.asarray(attribute.Get(moment.time) or [], np.int32)
            for attribute in (self._mesh.GetFaceVertexCountsAttr(), self._mesh.GetFaceVertexIndicesAttr())
        )
        if np.any(counts < 0) or counts.sum() != len(indices) or np.any((indices < 0) | (indices >= len(points))):
            raise InputError(f"{prim.GetPath()}: its faces do not match its {len(points)} points")
        seen = (counts >= 3) & ~_gathered(counts, indices)
        whole = np.repeat(seen, counts)
        self._counts, self._seen = counts, seen
        self.point_count = len(points)
        self.used = np.unique(indices[whole])
        self.soft = self._mesh.GetPointsAttr().GetNumTimeSamples() > 0
        """Whether its points move"""
        covering = read_covering(self._mesh, counts, indices, len(points), seen)
        # Edges sharp at rest stay sharp, as the seam of foil, which is two flat sheets then.
        at_first = self._at_rest(start) if self.soft else points
        foil = any(cover.finish.metallic > 0.0 for cover in covering.covers)
        crease = SOFT_CREASE if self.soft and not foil else None if is_round(self._mesh) and not foil else CREASE
        self.surface = SmoothSurface(PolygonMesh(at_first, counts[seen], indices[whole]), crease)
        self.cover = SurfaceCover(self.surface, covering)
        self._first_areas = self.surface.vertex_areas(self.points(start)) if self.soft else None

    def _at_rest(self, start: Moment) -> NDArray[np.float64]:
        """Return the points of the rest shape that a deformable has, or else those at the start."""
        rest = np.array(self._mesh.GetPrim().GetAttribute(f"physics:{REST_POINTS}").Get() or [], np.float64)
        return rest if rest.shape == (self.point_count, 3) and np.isfinite(rest).all() else self.points(start)

    def shrunk(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the initial area around each of the surface's vertices over the current one."""
        if self._first_areas is None:
            return np.ones(self.surface.vertex_count)
        areas = self.surface.vertex_areas(points)
        known = (areas > 0.0) & (self._first_areas > 0.0)
        return np.clip(np.divide(self._first_areas, areas, out=np.ones_like(areas), where=known), *SHRUNK)

    def gone(self, moment: Moment) -> NDArray[np.bool_] | None:
        """Return a mask of the surface's triangles that are absent; None where all are always present."""
        attribute = self._mesh.GetFaceVertexIndicesAttr()
        if attribute.GetNumTimeSamples() == 0:
            return None
        indices = np.asarray(attribute.Get(moment.time), np.int32)
        if len(indices) != self._counts.sum():
            raise InputError(f"{self._mesh.GetPath()}: its faces change at frame {moment.time.GetValue():g}")
        return self.surface.triangles_of(_gathered(self._counts, indices)[self._seen])

    def points(self, moment: Moment) -> NDArray[np.float64]:
        """Return the mesh's own points, shape (point_count, 3)."""
        points = _points(self._mesh, moment)
        _require_count(self._mesh, points, self.point_count, moment)
        return points


class SpherePrim:
    """A UsdGeom.Sphere."""

    segment_count = 1

    def __init__(self, prim: Usd.Prim, moment: Moment):
        self._sphere = UsdGeom.Sphere(prim)
        self.colors = read_colors(self._sphere, np.ones(1, np.int32))
        self.finish = read_finish(prim)

    def capsules(self, moment: Moment) -> Capsules:
        prim = self._sphere.GetPrim()
        center = moment.place(prim, np.zeros((1, 3)))
        radius = self._sphere.GetRadiusAttr().Get(moment.time) * moment.scale(prim)
        if not (np.isfinite(center).all() and 0.0 <= radius < np.inf):
            raise InputError(
                f"{prim.GetPath()}: its center or radius at frame {moment.time.GetValue():g} is not finite, or negative"
            )
        return Capsules(center, center, np.array([radius]))


class CapsulePrim:
    """A UsdGeom.Capsule."""

    segment_count = 1

    def __init__(self, prim: Usd.Prim, moment: Moment):
        self._capsule = UsdGeom.Capsule(prim)
        self.colors = read_colors(self._capsule, np.ones(1, np.int32))
        self.finish = read_finish(prim)

    def capsules(self, moment: Moment) -> Capsules:
        prim, axis = self._capsule.GetPrim(), "XYZ".index(self._capsule.GetAxisAttr().Get(moment.time))
        half = 0.5 * self._capsule.GetHeightAttr().Get(moment.time) * np.eye(3)[axis]
        ends = _require_finite(prim, moment.place(prim, np.stack([-half, half])), moment)
        radius = self._capsule.GetRadiusAttr().Get(moment.time) * moment.scale(prim)
        if not 0.0 <= radius < np.inf:
            raise InputError(
                f"{prim.GetPath()}: its radius at frame {moment.time.GetValue():g} is not finite, or negative"
            )
        return Capsules(ends[:1], ends[1:], np.array([radius]))


class CurvesPrim:
    """A UsdGeom.BasisCurves of type linear: a capsule a segment."""

    def __init__(self, prim: Usd.Prim, moment: Moment):
        self._curves = UsdGeom.BasisCurves(prim)
        self._counts = np.asarray(self._curves.GetCurveVertexCountsAttr().Get(moment.time) or [], np.int32)
        if np.any(self._counts < 1):
            raise InputError(f"{prim.GetPath()}: a curve has {self._counts.min()} points; expected at least 1")
        _require_count(self._curves, _points(self._curves, moment), int(self._counts.sum()), moment)
        last_of_curve = np.zeros(self._counts.sum(), bool)
        last_of_curve[np.cumsum(self._counts) - 1] = True
        self._begin = np.flatnonzero(~last_of_curve)
        self.segment_count = len(self._begin)
        segments = np.maximum(self._counts - 1, 0)
        self.colors = np.repeat(read_colors(self._curves, self._counts), segments, axis=0)
        self.finish = read_finish(prim)

    def capsules(self, moment: Moment) -> Capsules:
        points = _points(self._curves, moment)
        _require_count(self._curves, points, int(self._counts.sum()), moment)
        radii = 0.5 * self._widths(moment) * moment.scale(self._curves.GetPrim())
        return Capsules(
            points[self._begin], points[self._begin + 1], 0.5 * (radii[self._begin] + radii[self._begin + 1])
        )

    def _widths(self, moment: Moment) -> NDArray[np.float64]:
        """Return the width at each point, in the prim's unit; without widths the thinnest line that can be seen."""
        widths = np.asarray(self._curves.GetWidthsAttr().Get(moment.time) or [0.0], np.float64)
        if not np.all((widths >= 0.0) & (widths < np.inf)):
            raise InputError(f"{self._curves.GetPath()}: a width is negative or not finite")
        if len(widths) == self._counts.sum():
            return widths
        if len(widths) == len(self._counts):
            return np.repeat(widths, self._counts)
        return np.full(self._counts.sum(), widths.mean())


def is_round(mesh: UsdGeom.Mesh) -> bool:
    """Return whether a mesh says that it stands for a smooth surface.

    USD has it so for all that say nothing: few mean it.
    """
    scheme = mesh.GetSubdivisionSchemeAttr() if mesh else None
    return bool(scheme) and scheme.HasAuthoredValue() and scheme.Get() == UsdGeom.Tokens.catmullClark


def _points(prim: UsdGeom.PointBased, moment: Moment) -> NDArray[np.float64]:
    own = np.asarray(prim.GetPointsAttr().Get(moment.time) or [], np.float64).reshape(-1, 3)
    return _require_finite(prim.GetPrim(), moment.place(prim.GetPrim(), own), moment)


def _require_finite(prim: Usd.Prim, placed: NDArray[np.float64], moment: Moment) -> NDArray[np.float64]:
    if not np.isfinite(placed).all():
        raise InputError(f"{prim.GetPath()}: a point at frame {moment.time.GetValue():g} is not finite")
    return placed


def _require_count(prim: UsdGeom.PointBased, points: NDArray[np.float64], expected: int, moment: Moment) -> None:
    if len(points) != expected:
        raise InputError(
            f"{prim.GetPath()}: has {len(points)} points at frame {moment.time.GetValue():g}; "
            f"expected {expected} at every frame"
        )


def _gathered(counts: NDArray[np.int32], indices: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return a mask of the faces that have all of their corners at one vertex."""
    firsts = np.repeat(np.cumsum(counts) - counts, counts)
    elsewhere = np.bincount(np.repeat(np.arange(len(counts)), counts), indices != indices[firsts], len(counts))
    return (counts > 0) & (elsewhere == 0)

"""A stage as something to make pictures of: prims, colors, materials and images."""

import io
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pxr import Gf, Usd, UsdGeom, UsdShade, UsdUtils

from balloon_warp.errors import InputError, did_you_mean_file
from balloon_warp.mesh.crossings import Pictures
from balloon_warp.mesh.orientation import CREASE, SOFT_CREASE
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.usd_open import listed, open_meshes, others_than
from balloon_warp.mesh.usd_stage import (
    at_corners,
    bound_surface,
    constant_of,
    content_of,
    display_colors,
    image_of,
    missing_image,
    owners_of_faces,
    places_of,
)
from balloon_warp.studio.render.sampling import LINEAR, SmoothSurface, timing_of
from balloon_warp.system.files import STAGE_KEY
from balloon_warp.usd import STAGE_SUFFIXES
from balloon_warp.usd.balloon import REST_POINTS
from balloon_warp.usd.material import is_shown
from balloon_warp.usd.studio import OURS, Camera, Moment

PLAIN_COLOR = (0.55, 0.53, 0.50)
"""Linear RGB of prims without a color"""


@dataclass(frozen=True)
class Finish:
    """Finish of a surface, in UsdPreviewSurface's terms and with its fallback values."""

    roughness: float = 0.5
    opacity: float = 1.0
    clearcoat: float = 0.0
    metallic: float = 0.0

    def as_row(self) -> tuple[float, float, float, float]:
        return self.roughness, self.opacity, self.clearcoat, self.metallic


def read_finish(prim: Usd.Prim) -> Finish:
    """Return the finish of a prim's bound UsdPreviewSurface, or the fallback where it has none."""
    surface = bound_surface(prim)
    if surface is None:
        return Finish()
    values = {name: constant_of(surface, name) for name in ("roughness", "opacity", "clearcoat", "metallic")}
    return Finish(**{name: float(value) for name, value in values.items() if value is not None})


def read_colors(gprim: UsdGeom.Gprim, element_counts: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the linear RGB of each element, shape (len(element_counts), 3).

    Args:
        gprim: a sphere or curves.
        element_counts: points of each curve, over which colors of points are averaged; one for a sphere.
    """
    count = len(element_counts)
    colors, _ = _authored_colors(gprim, bound_surface(gprim.GetPrim()))
    if len(colors) == count:
        return colors
    if len(colors) == element_counts.sum() and count:
        sums = np.add.reduceat(colors, np.cumsum(element_counts) - element_counts)
        return (sums / element_counts[:, None]).astype(np.float32)
    return np.tile(_one_color(colors), (count, 1))


def read_corner_colors(
    mesh: UsdGeom.Mesh,
    surface: UsdShade.Shader | None,
    counts: NDArray[np.int32],
    indices: NDArray[np.int32],
    point_count: int,
) -> NDArray[np.float32]:
    """Return the linear RGB at each corner of a mesh's faces where it has a surface, shape (len(indices), 3)."""
    colors, interpolation = _authored_colors(mesh, surface)
    found = at_corners(colors, interpolation, counts, indices, point_count)
    return np.tile(_one_color(colors), (len(indices), 1)) if found is None else found


def _authored_colors(gprim: UsdGeom.Gprim, surface: UsdShade.Shader | None) -> tuple[NDArray[np.float32], str]:
    """Return the surface's color or else the display colors, shape (n, 3), and how they are laid out."""
    diffuse = constant_of(surface, "diffuseColor") if surface is not None else None
    if diffuse is not None:
        return np.asarray([diffuse], np.float32), UsdGeom.Tokens.constant
    return display_colors(gprim)


def _one_color(colors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the mean of colors, or the plain color where there are none."""
    return (colors.mean(axis=0) if len(colors) else np.array(PLAIN_COLOR)).astype(np.float32)


LARGEST = 2048
"""Largest side of an image [texels]: a larger one is scaled down"""
KINDS = {"PNG": "image/png", "JPEG": "image/jpeg"}
"""Kinds of images that glTF takes"""
UNREADABLE = (OSError, ValueError, Image.DecompressionBombError)


@dataclass(frozen=True)
class Texture:
    """Image of a material, before it is read."""

    path: str
    """Path as USD resolves it"""
    raw: bool
    """Whether its numbers are linear light"""
    tint: tuple[float, float, float]
    """Factor on its linear RGB"""
    places: NDArray[np.float32]
    """Texture coordinates of each corner of a mesh's faces, from 0 to 1 to the right and up, shape (corner_count, 2)"""
    owner: str
    """Path of the mesh's prim"""

    def at(self, places: NDArray[np.float32]) -> "Texture":
        """Return the image with other places."""
        return replace(self, places=places)

    def load(self) -> bytes:
        """Return the file's content.

        Raises:
            InputError: there is no image in it.
        """
        data = content_of(self.path)
        if data is None:
            raise self.unreadable()
        return data

    def unreadable(self) -> InputError:
        """Return the error for a file without a readable image."""
        return InputError(f"{self.owner}: its texture {self.path} cannot be read; expected an image")


def find_texture(mesh: UsdGeom.Mesh, surface: UsdShade.Shader | None, indices: NDArray[np.int32]) -> Texture | None:
    """Return the texture of a material for a mesh, or None.

    There is none without an image, or without texture coordinates of the mesh.

    Args:
        surface: A UsdPreviewSurface.
        indices: Points of the mesh at the corners of its faces, shape (corner_count,).
    """
    image = image_of(surface)
    places = places_of(mesh, image, indices) if image and image.path else None
    if image is None or places is None:
        return None
    return Texture(image.path, image.raw, image.scale, places, str(mesh.GetPath()))


def mean_color(surface: UsdShade.Shader | None) -> NDArray[np.float64] | None:
    """Return the mean linear RGB of a material's image, shape (3,); None without one that can be read."""
    image = image_of(surface)
    data = content_of(image.path) if image and image.path else None
    picture = Pictures(image.path).of_bytes(image.named, data) if image and data else None
    return np.multiply(picture.mean, image.scale) if image and picture else None


def read_texels(texture: Texture) -> NDArray[np.float32]:
    """Return the linear RGB, rows from the top, shape (height, width, 3).

    Raises:
        InputError: the image cannot be read.
    """
    try:
        with _small(texture) as image:
            pixels = np.asarray(image.convert("RGB"))
    except UNREADABLE:
        raise texture.unreadable() from None
    light = pixels / np.float32(255.0) if texture.raw else LINEAR[pixels]
    return (light * np.array(texture.tint)).astype(np.float32)


def packed_image(texture: Texture) -> tuple[bytes, str]:
    """Return an image as a file's bytes for embedding, and its kind.

    It is unchanged if it is PNG or JPEG and not too large, else PNG.

    Raises:
        InputError: it cannot be read.
    """
    data = texture.load()
    try:
        with Image.open(io.BytesIO(data)) as image:
            if image.format in KINDS and max(image.size) <= LARGEST:
                return data, KINDS[image.format]
        with _small(texture) as image, io.BytesIO() as packed:
            image.convert("RGB").save(packed, "PNG")
            return packed.getvalue(), KINDS["PNG"]
    except UNREADABLE:
        raise texture.unreadable() from None


def _small(texture: Texture) -> Image.Image:
    """Return an image no larger than `LARGEST`."""
    image = Image.open(io.BytesIO(texture.load()))
    image.thumbnail((LARGEST, LARGEST))
    return image


@dataclass(frozen=True)
class Cover:
    """A material of a drawn prim: its finish and its image."""

    name: str
    finish: Finish
    texture: Texture | None = None
    """Image in place of colors"""


@dataclass(frozen=True)
class Covering:
    """Materials of a drawn prim, and the one of each face."""

    covers: tuple[Cover, ...]
    of_faces: NDArray[np.int32]
    """Number of the material of each face, shape (face_count,)"""
    colors: NDArray[np.float32]
    """Linear RGB at each corner, shape (corner_count, 3)"""

    @property
    def places(self) -> NDArray[np.float32] | None:
        """Image coordinates of each corner, shape (corner_count, 2); None where there is no image."""
        return next((cover.texture.places for cover in self.covers if cover.texture), None)


def read_covering(
    mesh: UsdGeom.Mesh,
    counts: NDArray[np.int32],
    indices: NDArray[np.int32],
    point_count: int,
    whole: NDArray[np.bool_],
) -> Covering:
    """Read the materials of a mesh.

    Args:
        whole: of which faces, shape (len(counts),).
    """
    prims, of_faces = owners_of_faces(mesh.GetPrim(), len(counts))
    of_corners = np.repeat(of_faces, counts)
    colors = np.zeros((len(indices), 3), np.float32)
    covers, places = [], np.zeros((len(indices), 2), np.float32)
    for number, prim in enumerate(prims):
        here, surface = of_corners == number, bound_surface(prim)
        if here.any():
            colors[here] = read_corner_colors(mesh, surface, counts, indices, point_count)[here]
        texture = find_texture(mesh, surface, indices) if here.any() else None
        if texture is not None:
            places[here] = texture.places[here]
        elif here.any() and (mean := mean_color(surface)) is not None:  # the mesh does not say how the image lies
            colors[here] = mean
        name = surface.GetPrim().GetParent().GetName() if surface and number else ""
        covers.append((name, read_finish(prim), texture))
    corners = np.repeat(whole, counts)
    shared = places[corners]
    made = (Cover(name, finish, texture and texture.at(shared)) for name, finish, texture in covers)
    return _of_used(tuple(made), of_faces[whole], colors[corners])


def plain_covering(prim: Usd.Prim, color: NDArray[np.float32], face_count: int, corner_count: int) -> Covering:
    """Return the covering of a prim of one color."""
    return Covering((Cover("", read_finish(prim)),), np.zeros(face_count, np.int32), np.tile(color, (corner_count, 1)))


def _of_used(covers: tuple[Cover, ...], of_faces: NDArray[np.int32], colors: NDArray[np.float32]) -> Covering:
    """Drop materials that no face has; the first stays where there is no face."""
    used, numbers = np.unique(of_faces, return_inverse=True)
    kept = used.tolist() or [0]
    return Covering(tuple(covers[number] for number in kept), numbers.ravel().astype(np.int32), colors)


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


LINEAR_CURVE, INVISIBLE = UsdGeom.Tokens.linear, UsdGeom.Tokens.invisible
DRAWN = (UsdGeom.Mesh, UsdGeom.Sphere, UsdGeom.Capsule, UsdGeom.BasisCurves)
"""Kinds of prims that are drawn, where other shapes have become meshes"""


class Plane:
    """A level plane without an end, made of a level mesh."""

    def __init__(self, mesh: MeshPrim):
        self._mesh = mesh
        self.color = mesh.cover.colors[0]
        """Linear RGB, shape (3,)"""

    def height(self, moment: Moment) -> float:
        return float(self._mesh.points(moment)[0, 1])


class RenderStage:
    """The meshes and other shapes, linear curves, ground, water and camera of a stage.

    Invisible prims and those of purpose `guide` or `proxy` are left out. A level mesh called "Ground" is the ground,
    one called "Water" is water.

    Args:
        path: any file that USD opens.
        rounds: whether spheres and capsules are meshes, too.
        on_note: called with sentences on missing files and left-out shapes of the stage.

    Raises:
        InputError: the file is missing, cannot be read as a stage, or its time codes run nowhere or at no rate.
    """

    def __init__(self, path: Path, *, rounds: bool = False, on_note: Callable[[str], None] = lambda sentence: None):
        self.path = path
        if not path.is_file():
            hint = did_you_mean_file(path, STAGE_SUFFIXES)
            raise InputError(f"{path}: no such file; expected a USD stage{hint}")
        self._quiet = UsdUtils.CoalescingDiagnosticDelegate()  # while it lives, USD prints nothing
        self._stage, warnings = open_meshes(path, rounds=rounds)
        for sentence in (*warnings, *left_out(self._stage)):
            on_note(sentence)
        timing = timing_of(self._stage, path)
        self._stage, self.first_frame, self.last_frame, self.frames_per_second = timing
        every = map(UsdGeom.Imageable, Usd.PrimRange(self._stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
        seen = [prim.GetVisibilityAttr() for prim in every if prim]
        self._comes_and_goes = [attribute for attribute in seen if attribute.ValueMightBeTimeVarying()]

    @property
    def picture_frame(self) -> int:
        """The frame for a single picture: the one that the stage names, or the last where there is none so late."""
        named = self._said("pictureFrame")
        return min(named, self.last_frame) if isinstance(named, int) else self.last_frame

    @property
    def picture_view(self) -> dict[str, float | tuple[float, float, float]]:
        """Settings of camera and light that the stage has for pictures, by the names of a scene's fields."""
        said = self._said("pictureView")
        view: dict[str, float | tuple[float, float, float]] = {}
        for name, value in said.items() if isinstance(said, dict) else ():
            if name in ("look_at", "paper") and isinstance(value, Gf.Vec3d):
                x, y, z = np.array(value).tolist()
                view[name] = (x, y, z)
            elif name in ("azimuth", "elevation", "zoom", "light") and isinstance(value, float | int):
                view[name] = float(value)
        return view

    @property
    def picture_light(self) -> dict[str, Any]:
        """Color of the paper and azimuth of the main light, where the stage says them."""
        return {name: value for name, value in self.picture_view.items() if name in ("paper", "light")}

    def _said(self, name: str):
        """Return a value that a stage of ours has about itself."""
        ours = self._stage.GetRootLayer().customLayerData.get(STAGE_KEY)
        return ours.get(name) if isinstance(ours, dict) else None

    @property
    def stage(self) -> Usd.Stage:
        """Stage that USD has opened."""
        return self._stage

    def read_prims(self, frame: float, *, may_be_none: bool = False) -> None:
        """Find the visible prims, as they are at a frame.

        Raises:
            InputError: there is nothing to draw, and there may not be nothing.
        """
        moment = Moment(self._stage, frame)
        self.meshes: list[MeshPrim] = []
        self.rounds: list[SpherePrim | CapsulePrim | CurvesPrim] = []
        self.ground: Plane | None = None
        self.water: Plane | None = None
        self._camera: UsdGeom.Camera | None = None
        for prim in Usd.PrimRange(self._stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
            self._take(prim, moment)
        if not (self.meshes or self.rounds or may_be_none):
            raise InputError(f"{self.path}: has no visible mesh, solid shape or linear curves to draw at frame {frame}")

    def seen(self, frame: float) -> tuple[bool, ...]:
        """Return whether each prim that comes or goes is there: where that changes, prims are to be read again."""
        time = Moment(self._stage, frame).time
        return tuple(attribute.Get(time) != INVISIBLE for attribute in self._comes_and_goes)

    def points(self, frame: float) -> list[NDArray[np.float64]]:
        """Return the points of each mesh, shape (point_count, 3) each."""
        moment = Moment(self._stage, frame)
        return [mesh.points(moment) for mesh in self.meshes]

    def gone(self, frame: float) -> NDArray[np.bool_] | None:
        """Return a mask of the triangles of all meshes that are absent; None where all are always present."""
        moment = Moment(self._stage, frame)
        each = [mesh.gone(moment) for mesh in self.meshes]
        if all(gone is None for gone in each):
            return None
        pairs = zip(self.meshes, each, strict=True)
        return np.concatenate([np.zeros(len(m.surface.triangles), bool) if g is None else g for m, g in pairs])

    def heights(self, frame: float) -> tuple[float, float]:
        """Return the heights of the ground and the water; minus infinity without one."""
        moment = Moment(self._stage, frame)
        ground, water = (plane.height(moment) if plane else -math.inf for plane in (self.ground, self.water))
        return ground, water

    def capsules(self, frame: float) -> Capsules:
        """Return the spheres, the capsules and all curves' segments."""
        moment = Moment(self._stage, frame)
        each = [
            Capsules(np.empty((0, 3)), np.empty((0, 3)), np.empty(0)),
            *(prim.capsules(moment) for prim in self.rounds),
        ]
        return Capsules(*(np.concatenate(arrays) for arrays in zip(*each, strict=True)))

    def camera(self, frame: float, aspect: float) -> Camera | None:
        """Return the stage's first perspective camera, its view widened to a picture of this aspect; None without one.

        Raises:
            InputError: the camera has no angle of view or no axes.
        """
        if self._camera is None:
            return None
        moment = Moment(self._stage, frame)
        camera = self._camera.GetCamera(moment.time)
        aperture = max(camera.verticalAperture, camera.horizontalAperture / aspect)
        source = f"{self.path}: the camera {self._camera.GetPath()} at frame {frame}"
        if not (0.0 < aperture < math.inf and 0.0 < camera.focalLength < math.inf):
            raise InputError(
                f"{source} has an aperture of {aperture:g} and a focal length of {camera.focalLength:g}; "
                "expected positive ones"
            )
        if not moment.is_frame(camera.transform):
            raise InputError(
                f"{source} has a transform that is singular or not finite; expected a finite position and three axes"
            )
        half_height = aperture / (2.0 * camera.focalLength)
        return Camera(moment.origin(camera.transform), moment.axes(camera.transform), half_height * aspect, half_height)

    def _take(self, prim: Usd.Prim, moment: Moment) -> None:
        if camera := UsdGeom.Camera(prim):
            ours = prim.HasCustomDataKey(OURS)  # stands where all frames can be seen: a picture finds a nearer place
            if self._camera is None and not ours and camera.GetCamera(moment.time).projection == Gf.Camera.Perspective:
                self._camera = camera
        elif _is_drawn(prim, moment.time):
            if UsdGeom.Mesh(prim):
                mesh = MeshPrim(prim, moment, Moment(self._stage, self.first_frame))
                if len(mesh.surface.triangles) == 0:
                    return
                points = mesh.points(moment)
                width, height, _ = np.ptp(points, axis=0)
                name = prim.GetName().lower()
                if name in ("ground", "water") and height <= 1e-6 * width:
                    setattr(self, name, Plane(mesh))
                else:
                    self.meshes.append(mesh)
            elif UsdGeom.Sphere(prim):
                self.rounds.append(SpherePrim(prim, moment))
            elif UsdGeom.Capsule(prim):
                self.rounds.append(CapsulePrim(prim, moment))
            elif UsdGeom.BasisCurves(prim).GetTypeAttr().Get() == LINEAR_CURVE:
                curves = CurvesPrim(prim, moment)
                if curves.segment_count:
                    self.rounds.append(curves)


def left_out(stage: Usd.Stage) -> list[str]:
    """Return sentences on shapes that a stage shows but that cannot be taken, and on images that are missing."""
    every = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    shown = [prim for prim in every if is_shown(prim) and UsdGeom.Imageable(prim).ComputeVisibility() != INVISIBLE]
    curves = [each for each in map(UsdGeom.BasisCurves, shown) if each and each.GetTypeAttr().Get() != LINEAR_CURVE]
    others = [*others_than(shown, DRAWN), *(f"{each.GetPath()} (BasisCurves that are not linear)" for each in curves)]
    lost = [f"{prim.GetPath()} (@{image}@)" for prim in stage.Traverse() if (image := missing_image(prim))]
    return [
        *([f"Left out of the stage: {listed(others)}."] if others else []),
        *([f"Missing images: {listed(lost)}."] if lost else []),
    ]


def _is_drawn(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    if not any(kind(prim) for kind in DRAWN):
        return False
    imageable = UsdGeom.Imageable(prim)
    return is_shown(prim) and imageable.ComputeVisibility(time) != INVISIBLE

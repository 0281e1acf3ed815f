"""Loading of meshes: a file, by its suffix, or a mesh-like value of Python; unit, axes, and welding of seams.

Welded faces that end at the same place share their vertices there. Vertices keep their numbers; those that faces have
left move along with the ones that stand in for them. Looks are brought onto another mesh of a surface: each place looks
as the nearest one of it.

Each format lists its suffixes and readers in its own file.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import floor, log10
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray
from typing_extensions import TypeAliasType

from balloon_warp.errors import InputError, did_you_mean_file
from balloon_warp.kernels.measure.crossings import nearest_places
from balloon_warp.mesh import gltf, obj
from balloon_warp.mesh.crossings import Taken, check_mesh, of_vertices, parts_taken
from balloon_warp.mesh.gltf import read_visual
from balloon_warp.mesh.orientation import Border
from balloon_warp.mesh.polygon_mesh import Look, Looks, PolygonMesh, looks_of
from balloon_warp.mesh.repair import describe_defects, distinct_faces, repaired
from balloon_warp.mesh.topology import (
    component_labels,
    corner_faces,
    face_centers,
    face_starts,
    first_alike,
    first_coincident,
    mesh_edges,
    triangulate,
    vertex_components,
    with_corners,
)
from balloon_warp.system.api import checked
from balloon_warp.system.files import check_regular, file_behind, legible

ROUNDING = 1e-6
"""Distance below which places coincide, over a mesh's size, or over its distance from its origin where that is more, by
the rounding of files and transforms in 32 bits"""
WIDEST = 0.01
"""Largest gap over a mesh's size that is reported as a seam"""
NARROW = 0.25
"""Largest gap over the length of an edge that is reported as a seam"""
ALONG = 0.2
"""Least fraction of a border with such edges"""
FEWEST = 4
"""Least number of such edges"""


def welded(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with its faces joined where vertices lie at exactly the same place: all go to the first there."""
    return _joined(mesh, first_coincident(mesh.points), "that lay {how}", "")


def welded_along_seams(mesh: PolygonMesh, gap: float = 0.0) -> PolygonMesh:
    """Return the mesh with its faces welded along seams.

    A seam has open edges that lie on one another, from end to end, up to rounding or a gap. An open edge that has no
    length but by rounding becomes one vertex.

    Vertices that lie on others elsewhere, as where two bodies touch, stay apart.

    Args:
        gap: part of the mesh's size. Where it is wider than rounding, two edges are joined of which each is the
            other's nearest.
    """
    distinct = distinct_faces(mesh)[0]
    stand_ins = _exactly_on(Border.of(distinct).ends, mesh.points)
    border = Border.of(_with(distinct, stand_ins))
    if len(border.ends) and size_of(mesh):  # corners all at one place are reported as such
        rounding = rounding_of(mesh)
        beside = border.pairs(max(rounding, gap * size_of(mesh)), rounding).ends.reshape(-1, 2)
        short = border.ends[border.lengths <= rounding]
        stand_ins = component_labels(mesh.vertex_count, *np.concatenate([beside, short]).T)[stand_ins]
    return _joined(mesh, stand_ins, "along seams, {how},", "; weld = false leaves the seams open")


def size_of(mesh: PolygonMesh) -> float:
    """Return the longest side of the box around its faces, in its unit."""
    return float(np.ptp(mesh.points[mesh.face_vertex_indices], axis=0).max(initial=0.0))


def rounding_of(mesh: PolygonMesh) -> float:
    """Return the distance within which places are the same, in the mesh's unit."""
    return ROUNDING * max(size_of(mesh), float(np.abs(mesh.points[mesh.face_vertex_indices]).max(initial=0.0)))


@dataclass(frozen=True)
class Seam:
    """Open edges that lie along others, as of a seam that is not welded."""

    edges: int
    """Number of edges that would be welded"""
    gap: float
    """Largest gap, in the mesh's unit"""
    weld: str
    """Fraction of the mesh's size that welds it"""
    closes: bool
    """Whether the weld leaves nothing open"""

    def __str__(self) -> str:
        return (
            f"{self.edges:,} open edges lie within {self.gap:.2g} of others, like a seam; --weld {self.weld} joins "
            "them."
        )


def open_seam(mesh: PolygonMesh) -> Seam | None:
    """Return the apparent seam in a mesh's borders, and the gap that would weld it; None without one."""
    border, size = Border.of(distinct_faces(mesh)[0]), size_of(mesh)
    if len(border.ends) < FEWEST or not size:
        return None
    pairs = border.pairs(WIDEST * size, across=NARROW)
    borders = component_labels(mesh.vertex_count, *border.ends.T)[border.ends[:, 0]]
    beside = np.zeros(len(borders), dtype=bool)
    beside[pairs.edges] = True
    parts = np.bincount(borders, beside) / np.maximum(np.bincount(borders), 1)
    gaps = pairs.gaps[(parts[borders[pairs.edges]] >= ALONG).all(axis=1)]
    if not len(gaps):
        return None
    weld = _short_above(float(gaps.max()) / size)
    left = len(Border.of(distinct_faces(welded_along_seams(mesh, float(weld)))[0]).ends)
    welds = len(border.ends) - left
    return Seam(welds, float(gaps.max()), weld, not left) if welds >= FEWEST else None


def _short_above(value: float) -> str:
    """Return the least of 1, 2 and 5 times a power of ten that is above a value, such as 2e-4."""
    power = floor(log10(max(value, ROUNDING)))
    steps = [f"{digit}e{exponent}" for exponent in (power, power + 1) for digit in (1, 2, 5)]
    return next(step for step in steps if float(step) > value)


def _exactly_on(ends: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the vertex that each one is merged into where coincident edges are joined, shape (vertex_count,)."""
    places = first_coincident(points)[ends]
    turned = places[:, 0] > places[:, 1]
    ends, places = np.where(turned[:, None], ends[:, ::-1], ends), np.sort(places, axis=1)
    order = np.lexsort((places[:, 1], places[:, 0]))
    ends, places = ends[order], places[order]
    # Edges at the same places follow one another; one of no length is no seam.
    same = (places[1:] == places[:-1]).all(axis=1) & (places[1:, 0] != places[1:, 1])
    return component_labels(len(points), ends[:-1][same].ravel(), ends[1:][same].ravel())


def _with(mesh: PolygonMesh, stand_ins: NDArray[np.int64]) -> PolygonMesh:
    """Return the mesh with other vertices in the place of its own, each face with its corners once."""
    moved = replace(mesh, face_vertex_indices=stand_ins[mesh.face_vertex_indices].astype(np.int32))
    return distinct_faces(moved)[0]


def _joined(mesh: PolygonMesh, stand_ins: NDArray[np.int64], which: str, more: str) -> PolygonMesh:
    indices = stand_ins[mesh.face_vertex_indices].astype(np.int32)
    left = np.unique(mesh.face_vertex_indices[indices != mesh.face_vertex_indices])
    if not len(left):
        return mesh
    one = len(left) == 1
    gap = np.linalg.norm(mesh.points[left] - mesh.points[stand_ins[left]], axis=1).max()
    how = ("exactly on " if not gap else "" if one else "up to ") + (f"{gap:.2g} from " if gap else "")
    how += "another" if one else "others"
    found = f"{len(left):,} {'vertex' if one else 'vertices'} {which.format(how=how)}"
    became = (
        "has been welded to it: it keeps its number and moves with it"
        if one
        else "have been welded to them: they keep their numbers and move with them"
    )
    sentence = f"{found} {became}{more}."
    before = stand_ins if mesh.stand_ins is None else stand_ins[mesh.stand_ins]
    return replace(mesh, face_vertex_indices=indices, stand_ins=before, warnings=(*mesh.warnings, sentence))


BESIDE = 4
"""Number of nearest places considered for each vertex"""


def counted_once(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with duplicate parts collapsed onto the parts that they lie on.

    A part that lies on others with every face gets the corners of those, whichever way they wind: then they are the
    same faces twice. A part shares no vertex with another. Vertices keep their numbers, and those of such a part move
    along with the parts that it lies on.
    """
    component = vertex_components(mesh, mesh_edges(mesh))
    starts = face_starts(mesh)
    own = component[mesh.face_vertex_indices[starts]]
    if not len(own) or (own == own[0]).all():
        return mesh
    places = _places(mesh)
    first = first_alike(replace(mesh, face_vertex_indices=places[mesh.face_vertex_indices].astype(np.int32)))
    owner = np.full(mesh.face_count, mesh.vertex_count)
    np.minimum.at(owner, first, own)
    owner = owner[first]  # of the faces that lie on one another, the first part
    copies = np.ones(mesh.vertex_count, dtype=bool)
    copies[own[own == owner]] = False
    copied = copies[own]
    if not copied.any():
        return mesh
    twin = np.full(mesh.face_count, -1)
    owned = np.flatnonzero(own == owner)[::-1]
    twin[first[owned]] = owned
    faces = np.where(copied, twin[first], np.arange(mesh.face_count))
    corners = np.arange(len(mesh.face_vertex_indices)) + (starts[faces] - starts)[corner_faces(mesh)]
    return replace(with_corners(mesh, corners), stand_ins=_stand_ins(mesh, places, copied[corner_faces(mesh)]))


def _stand_ins(mesh: PolygonMesh, places: NDArray[np.int64], gone: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return, for each vertex of which nothing but copies is left, the first other vertex at its place, else itself.

    Args:
        gone: corners, shape (corner_count,).
    """
    kept = np.sort(mesh.face_vertex_indices[~gone])[::-1]
    there = np.arange(mesh.vertex_count)
    there[places[kept]] = kept
    left = np.setdiff1d(mesh.face_vertex_indices[gone], kept)
    stand_ins = np.arange(mesh.vertex_count)
    stand_ins[left] = there[places[left]]
    return stand_ins if mesh.stand_ins is None else stand_ins[mesh.stand_ins]


def _places(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the first vertex at the same place as each, but for rounding, shape (vertex_count,)."""
    from scipy.spatial import KDTree  # takes long to load: only for several parts

    places = first_coincident(mesh.points)
    used = np.unique(places[mesh.face_vertex_indices])
    reach = np.nextafter(rounding_of(mesh), np.inf)
    found = KDTree(mesh.points[used]).query(mesh.points[used], k=min(BESIDE, len(used)), distance_upper_bound=reach)
    others = np.asarray(found[1]).reshape(len(used), -1)
    first, slot = np.nonzero(others < len(used))
    return component_labels(mesh.vertex_count, used[first], used[others[first, slot]])[places]


class PaintedSurface:
    """The triangles of a surface, by the corners of its faces, which have the looks."""

    def __init__(self, surface: PolygonMesh):
        apart = PolygonMesh(
            points=surface.points[surface.face_vertex_indices],
            face_vertex_counts=surface.face_vertex_counts,
            face_vertex_indices=np.arange(len(surface.face_vertex_indices), dtype=np.int32),
        )
        self._surface = surface
        self._middle = apart.points.mean(axis=0)
        self._size = float(np.ptp(apart.points, axis=0).max())
        self._points = self._scaled(apart.points)
        corners, _ = triangulate(apart)
        a, b, c = np.moveaxis(self._points[corners], 1, 0)
        flat = (np.cross(b - a, c - a) == 0.0).all(axis=1)
        self.corners = corners[~flat].astype(np.int64)
        """Corners of each triangle, shape (triangle_count, 3)"""

    def nearest(
        self, points: NDArray[np.float64], among: NDArray[np.int64] | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the nearest triangle to each point, shape (n,), and the weights of its corners there, shape (n, 3).

        Args:
            points: in the surface's unit, shape (n, 3).
            among: the triangles that count; all, when missing.
        """
        corners = self.corners if among is None else self.corners[among]
        used, numbers = np.unique(corners, return_inverse=True)
        surface = wp.Mesh(
            points=wp.array(self._points[used], dtype=wp.vec3), indices=wp.array(numbers.ravel(), dtype=wp.int32)
        )
        triangles, weights = wp.zeros(len(points), dtype=wp.int32), wp.zeros(len(points), dtype=wp.vec3)
        at = wp.array(self._scaled(points), dtype=wp.vec3)
        wp.launch(nearest_places, len(points), inputs=[surface.id, at, 1e3], outputs=[triangles, weights])
        found = triangles.numpy().astype(np.int64)
        return found if among is None else among[found], weights.numpy().astype(np.float64)

    def charts(self, places: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the chart of a texture that each triangle is in.

        Faces of a chart are connected where they share vertices, places in the image and the material.

        Args:
            places: texture coordinates at the corners of the surface, shape (corner_count, 2).
        """
        vertices = first_coincident(self._surface.points)[self._surface.face_vertex_indices]
        looks = self._surface.looks
        material = np.full(len(vertices), -1) if looks is None else looks.of_corners
        keys = (material, places[:, 1], places[:, 0], vertices)
        order = np.lexsort(keys)
        alike = np.all([key[order[1:]] == key[order[:-1]] for key in keys], axis=0)
        same = order[np.maximum.accumulate(np.where(np.append(True, ~alike), np.arange(len(order)), 0))]
        firsts = face_starts(self._surface)[corner_faces(self._surface)]
        labels = component_labels(
            len(order), np.concatenate([order, np.arange(len(order))]), np.concatenate([same, firsts])
        )
        return labels[self.corners[:, 0]]

    def _scaled(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points centered and scaled to size 1, since Warp measures in float32."""
        return (points - self._middle) / self._size


MOST_CHARTS = 1000
"""Largest number of charts of a texture that faces of the other mesh extend beyond: with more, charts are smaller than
these faces"""


def with_looks_of(mesh: PolygonMesh, surface: PolygonMesh) -> PolygonMesh:
    """Return a mesh with the materials, colors and texture coordinates of a surface that it is near to.

    A face has the material that is nearest to its middle, and lies within one chart of a texture. Runs on Warp's
    default device.

    Args:
        mesh: in the unit of the surface.
        surface: with looks and texture coordinates, or without.
    """
    if surface.looks is None and surface.texture_coordinates is None:
        return mesh
    painted = PaintedSurface(surface)
    middles, _ = painted.nearest(face_centers(mesh))
    middles = np.repeat(middles, mesh.face_vertex_counts)
    triangles, weights = painted.nearest(mesh.points)
    triangles, weights = triangles[mesh.face_vertex_indices], weights[mesh.face_vertex_indices]
    looks, places, warnings = surface.looks, surface.texture_coordinates, mesh.warnings
    if looks is not None:
        looks = _looks(looks, painted.corners[middles, 0], painted.corners[triangles], weights)
    if places is not None:
        places = _nearest_places(painted, places, mesh, middles, triangles, weights)
    if places is None and looks is not None and looks.pictures:
        looks = _without_pictures(looks)
        warnings = (*warnings, "The texture's pieces are smaller than the quads, which have its mean color instead.")
    return replace(mesh, looks=looks, texture_coordinates=places, warnings=warnings)


def _looks(
    looks: Looks, middles: NDArray[np.int64], corners: NDArray[np.int64], weights: NDArray[np.float64]
) -> Looks | None:
    """Return the looks at the corners of the other mesh.

    Args:
        middles: the corner of the surface that has the material, for each, shape (n,).
        corners: the three around the nearest place, for each, shape (n, 3).
        weights: of these, shape (n, 3).
    """
    whole = looks_of(looks.materials, looks.of_corners[middles])
    if looks.colors is None:
        return whole
    colors = np.einsum("nc,nci->ni", weights, looks.colors[corners])
    colors = np.where(np.isfinite(colors), colors, looks.colors[middles]).astype(np.float32)
    none = np.full(len(middles), -1, np.int32)
    return Looks(whole.materials, whole.of_corners, colors) if whole else Looks((), none, colors)


def _nearest_places(
    painted: PaintedSurface,
    places: NDArray[np.float32],
    mesh: PolygonMesh,
    middles: NDArray[np.int64],
    triangles: NDArray[np.int64],
    weights: NDArray[np.float64],
) -> NDArray[np.float32] | None:
    """Return the texture coordinates at the corners of the other mesh; None where charts are too many for that.

    Args:
        places: those of the surface.
        middles: the triangle that is nearest to the middle of each corner's face.
        triangles: the one that is nearest to each corner.
        weights: of its corners.
    """
    charts = painted.charts(places)
    over = charts[triangles] != charts[middles]
    reached = np.unique(charts[middles[over]])
    if len(reached) > MOST_CHARTS:
        return None
    triangles, weights = triangles.copy(), weights.copy()
    for chart in reached:
        out = np.flatnonzero(over & (charts[middles] == chart))
        among = np.flatnonzero(charts == chart)
        triangles[out], weights[out] = painted.nearest(mesh.points[mesh.face_vertex_indices[out]], among)
    return np.einsum("nc,nci->ni", weights, places[painted.corners[triangles]]).astype(np.float32)


def _without_pictures(looks: Looks) -> Looks:
    """Return the looks with the mean of each image in its place."""

    def plain(look: Look) -> Look:
        if look.picture is None:
            return look
        red, green, blue = (shade * mean for shade, mean in zip(look.color, look.picture.mean, strict=True))
        return Look(look.name, (red, green, blue))

    return replace(looks, materials=tuple(map(plain, looks.materials)))


def read_usd(path: Path | str, prim: str | Sequence[str] | None = None) -> PolygonMesh:
    """Read the meshes of a stage as one, as their control polygons.

    They are those at or below `prim`, or all that are visible and of purpose "default" or "render".

    Each is a group by its prim's name. The mesh's warnings name omissions.

    Values are taken at the default time, or at their earliest sample where they have no default. The points are
    transformed to the stage's world, in its own unit and up axis. Left-handed faces are turned right-handed.
    Holes and the subdivision scheme are not looked at.

    Raises:
        InputError: the file is no stage, there is no such mesh, none is shown, or its arrays do not fit together.
    """
    from balloon_warp.mesh.usd_stage import read_stage  # loads USD: only for a stage

    return read_stage(path, prim)


USD_LOADERS = dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), read_usd)


def place_mesh(
    mesh: PolygonMesh,
    up_axis: str,
    scale: float = 1.0,
    rotation: Sequence[float] = (0.0, 0.0, 0.0),
    position: Sequence[float] = (0.0, 0.0, 0.0),
) -> PolygonMesh:
    """Return the mesh in meters, turned to the up axis ("Y" or "Z"), then scaled, rotated and moved.

    Args:
        rotation: about x, then y, then z [degrees].
        position: where the mesh's origin goes [m].
    """
    points = mesh.points * (mesh.meters_per_unit * scale)
    if mesh.up_axis != up_axis:
        points = points @ axes_matrix(mesh.up_axis, up_axis).T
    for axis, degrees in enumerate(rotation):
        points = points @ _rotation(axis, degrees).T
    return replace(mesh, points=points + np.array(position), up_axis=up_axis, meters_per_unit=1.0)


def axes_matrix(mesh_up: str, up_axis: str) -> NDArray[np.float64]:
    """Return the matrix that turns one up axis, "Y" or "Z", to another."""
    if mesh_up == up_axis:
        return np.eye(3)
    return _rotation(0, 90.0 if up_axis == "Z" else -90.0)


def rotation_matrix(rotation: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix of a rotation about x, then y, then z [degrees], which takes a column to where it is then."""
    about_x, about_y, about_z = (_rotation(axis, float(degrees)) for axis, degrees in enumerate(rotation))
    return about_z @ about_y @ about_x


def in_y_up_meters(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh in meters, y up, which is how an OBJ file is taken. To the last bit: axes change places."""
    points = mesh.points * mesh.meters_per_unit
    if mesh.up_axis == "Z":
        points = points[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    return replace(mesh, points=points, up_axis="Y", meters_per_unit=1.0)


def _rotation(axis: int, degrees: float) -> NDArray[np.float64]:
    """Return the matrix of a right-handed rotation about a coordinate axis."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix[first, first] = matrix[second, second] = cosine
    matrix[first, second], matrix[second, first] = -sine, sine
    return matrix


Weld = bool | Literal["auto"] | float
Holes = Literal["cap", "keep"]
Parts = Literal["held", "free"]
LEAST_GAP, LARGEST_GAP = 1e-6, 0.1
"""Range of a weldable gap over the mesh's size"""


@dataclass(frozen=True)
class Treatment:
    """Treatment of a mesh's seams, holes and parts, as the scene's balloon gives it in fields of these names."""

    weld: Weld = "auto"
    """Weld open edges that coincide up to rounding, or up to a gap over the mesh's size; or all vertices that coincide
    exactly; or none"""
    holes: Holes = "cap"
    """Close holes in the surface, or keep them"""
    parts: Parts = "held"
    """Hold components together, or leave them free"""
    taken: Taken = "all"
    """Parts to take: all, those without a border, or the largest by area"""


def prepared(mesh: PolygonMesh, source: object, treatment: Treatment) -> PolygonMesh:
    """Return the mesh as it is simulated, with warnings of its defects and their treatment.

    Vertices keep their numbers; the springs that hold its parts are made later.

    A mesh of edges alone, faces of two corners, is a net of springs: it stays as it is.

    Raises:
        InputError: no face is left, or no part of those that are to be taken; it names `source`.
    """
    if mesh.face_count and mesh.face_vertex_counts.max() == 2:
        return mesh
    mesh = counted_once(mesh)
    if treatment.weld is True:
        mesh = welded(mesh)
    elif treatment.weld:
        mesh = welded_along_seams(mesh, 0.0 if treatment.weld == "auto" else treatment.weld)
    whole = repaired(mesh, source, treatment.holes)
    kept, left_out = parts_taken(whole, treatment.taken, source)
    whole, mesh = of_vertices(whole, kept), of_vertices(mesh, kept)
    seam = open_seam(mesh) if treatment.weld is not False else None
    told = [str(each) for each in (left_out, seam) if each]
    said = describe_defects(mesh, whole, treatment.parts, np.flatnonzero(~kept))
    return replace(whole, warnings=(*whole.warnings, *told, *said))


class Faceted(Protocol):
    """A mesh of another library's, such as a trimesh.Trimesh."""

    @property
    def vertices(self) -> Any:
        """Points, shape (n, 3)."""

    @property
    def faces(self) -> Any:
        """Lists of corners that index points from 0."""


MeshLike = TypeAliasType("MeshLike", PolygonMesh | Faceted | tuple[ArrayLike, Any])
"""Mesh of this package or another; or points and faces, as in `Faceted`"""


def is_mesh(given: object) -> bool:
    """Return whether a Python value is a mesh; its numbers may be wrong."""
    is_pair = isinstance(given, tuple | list) and len(given) == 2 and not isinstance(given[0], str)
    return is_pair or isinstance(given, PolygonMesh) or hasattr(given, "faces") or hasattr(given, "to_mesh")


def mesh_from(given: Any) -> PolygonMesh:
    """Make a mesh of a `MeshLike`, or of a scene of trimesh's, whose parts become one.

    Its numbers are not checked; `check_mesh` does that.

    Raises:
        InputError: it is none; the message begins with the part that is wrong.
    """
    if not is_mesh(given):
        kinds = "a file, a PolygonMesh, a trimesh.Trimesh, or a pair of points and faces"
        raise InputError(f"mesh: must be {kinds} (got {type(given).__name__})")
    if isinstance(given, PolygonMesh):
        return given
    if isinstance(given, tuple | list):
        points, faces = given
        return _of_arrays(points, faces, "mesh")
    if hasattr(given, "to_mesh"):
        given = given.to_mesh()
    mesh = _of_arrays(given.vertices, given.faces, _name_of(given))
    return replace(mesh, **read_visual(mesh, getattr(given, "visual", None))._asdict())


def _of_arrays(points: Any, faces: Any, name: str) -> PolygonMesh:
    counts, indices = _corners(faces)
    return PolygonMesh(_points(points), counts, indices, name)


def _points(given: Any) -> NDArray[np.float64]:
    try:
        points = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("points: must be numbers, shape (n, 3)") from None
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points: must have shape (n, 3) (got {points.shape})")
    return points


def _corners(given: Any) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the number of corners of each face, and all corners, one face after the other."""
    try:
        faces = [np.asarray(face) for face in given]
    except TypeError:
        raise InputError(f"faces: must be lists of point numbers (got {type(given).__name__})") from None
    for number, face in enumerate(faces):
        if face.ndim != 1 or not np.issubdtype(face.dtype, np.integer):
            found = str(face.tolist())[:60]
            raise InputError(f"faces: face {number} must be point numbers, counted from 0 (got {found})")
    counts = np.array([len(face) for face in faces], dtype=np.int32)
    indices = np.concatenate([np.zeros(0, dtype=np.int64), *faces])
    if len(indices) and not np.array_equal(indices, indices.astype(np.int32)):
        raise InputError(f"faces: point numbers must fit in 32 bits (got {indices.max()})")
    return counts, indices.astype(np.int32)


def _name_of(given: Any) -> str:
    """Return the name of the mesh's file, where there is one."""
    known = getattr(given, "metadata", None) or {}
    return str(known.get("name") or Path(str(known.get("file_name") or "mesh")).stem)


BY_NAME = obj.LOADERS | gltf.LOADERS
"""Readers of files that name their objects"""
LOADERS = obj.LOADERS | USD_LOADERS | gltf.TRIANGLE_LOADERS | gltf.LOADERS


@checked
def load_mesh(source: Path | str | MeshLike, prim: str | Sequence[str] | None = None) -> PolygonMesh:
    """Read a mesh as it is: polygons from OBJ and USD, triangles from STL, PLY, OFF, glTF and GLB.

    Args:
        source: a file; or a PolygonMesh, a trimesh.Trimesh, or points of shape (n, 3) [m] and faces, each a list of
            points' numbers from 0.
        prim: of a USD stage, the path of a mesh, or of a prim with meshes below it; of an OBJ file, the name of an
            object or a group; of a glTF file, the name of a node or a mesh; or several. All that it shows when missing.

    Raises:
        InputError: there is no such file, its suffix is none of these, its content is wrong, or it has no such prim.
    """
    if not isinstance(source, str | Path):
        if prim is not None:
            raise InputError(f"prim {prim}: selects an object of a file; expected a file")
        mesh = mesh_from(source)
        check_mesh(mesh, mesh.name)
        return mesh
    path = Path(source)
    if path.is_dir():
        raise InputError(f"{path}: is a folder, not a mesh file")
    suffix = path.suffix.lower()
    if suffix not in LOADERS:
        raise InputError(f"{path}: expected a mesh file ({' '.join(LOADERS)}), got suffix {suffix or 'none'}")
    if not path.exists():
        raise InputError(f"{path}: no such file{did_you_mean_file(path, LOADERS)}")
    behind = file_behind(path)
    mesh = _read(behind, prim)
    is_renamed = behind != path and mesh.name == legible(behind.stem)
    return replace(mesh, name=legible(path.stem)) if is_renamed else mesh


def _read(path: Path, prim: str | Sequence[str] | None) -> PolygonMesh:
    """Read a file that is there.

    Raises:
        InputError: it is none that can be read whole.
    """
    suffix = path.suffix.lower()
    if suffix in USD_LOADERS:
        return read_usd(path, prim)
    check_regular(path)
    if suffix in BY_NAME:
        return BY_NAME[suffix](path, prim)
    if prim is not None:
        raise InputError(
            f"{path}: prim {prim} selects an object of a file; expected one of those that name them "
            f"({' '.join([*USD_LOADERS, *BY_NAME])})"
        )
    return LOADERS[suffix](path)

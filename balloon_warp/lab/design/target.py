"""The wanted shape of a design, and how it is cut: panels, seams, gores, gaps of a mould."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.spatial import KDTree

from balloon_warp.errors import InputError
from balloon_warp.lab.design.measure import Ruler
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import crossings_sentence
from balloon_warp.mesh.load import MeshLike, Treatment, axes_matrix, load_mesh, prepared
from balloon_warp.mesh.topology import (
    border_edges,
    component_labels,
    corner_faces,
    is_closed,
    mesh_edges,
    next_corners,
    signed_volume,
    vertex_components,
    vertex_normals,
)
from balloon_warp.model.plan import LARGEST, SMALLEST
from balloon_warp.model.shape import fixed_particles

Values = NDArray[np.float64]
FACING = -0.2
"""Largest product of the normals of vertices that face each other"""
REACH, ASIDE = 3.2, 1.0
"""Largest distance of a pair, and across the gap, over the edge"""
OUTSIDE, INSIDE = 0.7, 0.3
"""Least gap between two parts, and least thickness of one, over the edge"""
FLATTEST, TOO_FLAT = 0.25, 0.1
"""Least altitude of a triangle that steps aim at, and that they may leave, over the one in the plain mould"""
PUSHED, FIRMLY = 9.0, 900.0
"""Weights of missing gaps over that of errors, squared: between sides, and of altitudes, which are a tenth as large"""


@dataclass(frozen=True)
class Gaps:
    """Gaps as functions of the vertices."""

    widths: Values
    """Widths [m], shape (k,)"""
    least: Values
    """Wanted least widths [m], shape (k,)"""
    widening: Any
    """Derivatives of the widths by the vertices' coordinates, shape (k, 3 n)"""
    weights: Values
    """Weights of missing widths, squared, over those of errors, shape (k,)"""

    @classmethod
    def of(cls, mould: PolygonMesh, plain: PolygonMesh, triangles: NDArray[np.int64], edge: float) -> "Gaps":
        """Find the gaps of a mould that does not cross itself.

        Args:
            plain: Mould that is the scaled-down target shape.
            triangles: Corners of the film's triangles, shape (t, 3).
            edge: Mean length of its edges [m].
        """
        facing, across = _facing(mould, edge), _altitudes(mould, plain, triangles)
        return cls(
            np.concatenate([facing[0], across[0]]),
            np.concatenate([facing[1], FLATTEST * across[1]]),
            sparse.vstack([facing[2], across[2]]).tocsr(),
            np.repeat([PUSHED, FIRMLY], [len(facing[0]), len(across[0])]),
        )


@dataclass(frozen=True)
class Flattening:
    """Triangles of a mould that changes flatten too much."""

    mould: PolygonMesh
    plain: PolygonMesh
    triangles: NDArray[np.int64]
    """Corners of the film's triangles, shape (t, 3)"""

    def vertices(self, points: Values) -> NDArray[np.int64]:
        """Return the vertices of the triangles that are flatter than they may be, and than in the mould."""
        before, wanted, _ = _altitudes(self.mould, self.plain, self.triangles)
        after = _altitudes(replace(self.mould, points=points), self.plain, self.triangles)[0]
        flat = (after < TOO_FLAT * wanted) & (after < before)
        return np.unique(self.triangles[flat])


def _facing(mesh: PolygonMesh, edge: float) -> tuple[Values, Values, Any]:
    """Return the gaps between vertices that face each other, from outside or through the inside."""
    points, normals = mesh.points, vertex_normals(mesh)
    pairs = KDTree(points).query_pairs(REACH * edge, output_type="ndarray").astype(np.int64)
    pairs = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) < FACING]
    ways = normals[pairs[:, 0]] - normals[pairs[:, 1]]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    apart = points[pairs[:, 1]] - points[pairs[:, 0]]
    widths = (apart * ways).sum(axis=1)
    near = np.linalg.norm(apart - widths[:, None] * ways, axis=1) < ASIDE * edge
    pairs, ways, widths = pairs[near], ways[near], widths[near]
    ways *= np.where(widths > 0.0, 1.0, -1.0)[:, None]
    least = edge * np.where(widths > 0.0, OUTSIDE, INSIDE)
    return np.abs(widths), least, _rows(pairs, np.stack([-ways, ways], axis=1), len(points))


def _altitudes(mould: PolygonMesh, plain: PolygonMesh, triangles: NDArray[np.int64]) -> tuple[Values, Values, Any]:
    """Return the triangles' least altitudes, and those in the plain mould."""
    corners = _tips_first(triangles, mould.points)
    widths, ways, along = _altitudes_of(mould.points[corners])
    of_corners = np.stack([np.ones(len(along)), along - 1.0, -along], axis=1)
    wanted = _altitudes_of(plain.points[_tips_first(triangles, plain.points)])[0]
    return widths, wanted, _rows(corners, of_corners[:, :, None] * ways[:, None], len(mould.points))


def _tips_first(triangles: NDArray[np.int64], points: Values) -> NDArray[np.int64]:
    """Return the corners of triangles, those that face the longest edge first, shape (t, 3)."""
    places = points[triangles]
    opposite = np.linalg.norm(np.roll(places, -1, axis=1) - np.roll(places, -2, axis=1), axis=2)
    order = (opposite.argmax(axis=1)[:, None] + np.arange(3)) % 3
    return np.take_along_axis(triangles, order, axis=1)


def _altitudes_of(places: Values) -> tuple[Values, Values, Values]:
    """Return the altitudes on the first corners, shape (t,), their ways, and where along the edge they stand."""
    side, base = places[:, 0] - places[:, 1], places[:, 2] - places[:, 1]
    along = (side * base).sum(axis=1) / np.maximum((base * base).sum(axis=1), 1.0e-300)
    ways = side - along[:, None] * base
    widths = np.linalg.norm(ways, axis=1)
    return widths, ways / np.maximum(widths, 1.0e-300)[:, None], along


def _rows(vertices: NDArray[np.int64], vectors: Values, count: int) -> Any:
    """Return a matrix whose rows have a vector for each of their vertices, shape (k, 3 count)."""
    columns = 3 * vertices[:, :, None] + np.arange(3)
    rows = np.broadcast_to(np.arange(len(vertices))[:, None, None], columns.shape)
    shape = (len(vertices), 3 * count)
    return sparse.csr_matrix((vectors.ravel(), (rows.ravel(), columns.ravel())), shape=shape)


Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Panels:
    """The triangles of a mesh, sewn of panels."""

    mesh: PolygonMesh
    """Sewn mesh of triangles"""
    corners: Numbers
    """Corners of the triangles, as vertices of the panels, shape (t, 3)"""
    sewn_to: Numbers
    """Vertex of the mesh that each vertex of the panels becomes, shape (m,)"""
    of_faces: Numbers
    """Panel of each triangle, shape (t,)"""
    seams: Numbers
    """Two sides of each seam's edge, from the lower vertex of the mesh to the higher, shape (s, 2, 2)"""
    forward: NDArray[np.bool_]
    """Whether the panel's border runs that way, its inside on the left, shape (s, 2)"""

    @property
    def count(self) -> int:
        """Number of panels."""
        return int(self.of_faces.max()) + 1

    @cached_property
    def of_vertices(self) -> Numbers:
        """The panel of each vertex of the panels, shape (m,)."""
        panels = np.zeros(len(self.sewn_to), dtype=np.int64)
        panels[self.corners] = self.of_faces[:, None]
        return panels

    @cached_property
    def borders(self) -> list[Numbers]:
        """The vertices around each panel, in order, its inside on the left."""
        following: dict[int, int] = {}
        for ends, forward in zip(self.seams.reshape(-1, 2).tolist(), self.forward.ravel().tolist(), strict=True):
            begin, end = ends if forward else ends[::-1]
            following[begin] = end
        found = []
        for panel in range(self.count):
            first = here = next(vertex for vertex in following if self.of_vertices[vertex] == panel)
            order = [first]
            while (here := following[here]) != first:
                order.append(here)
            found.append(np.array(order))
        return found

    def flat_mesh(self, flat: Values) -> PolygonMesh:
        """Return the panels as a mesh in the plane, by their flat places, shape (m, 2)."""
        points = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)
        counts = np.full(len(self.corners), 3, dtype=np.int32)
        return PolygonMesh(points, counts, self.corners.ravel().astype(np.int32), f"{self.mesh.name}_panels")


def cut_into_panels(mesh: PolygonMesh, seams: Numbers) -> Panels:
    """Cut a closed mesh of triangles along edges.

    Args:
        seams: the edges by their ends, shape (k, 2).

    Raises:
        InputError: the seams are no edges, or leave a panel that is no disk.
    """
    edges = mesh_edges(mesh)
    on_seam = _on_seams(mesh, edges.ends, seams)
    first, second = edges.corners.reshape(-1, 2).T
    following, faces = next_corners(mesh), corner_faces(mesh)
    forward = edges.forward.reshape(-1, 2)
    low = np.stack([np.where(forward[:, k], c, following[c]) for k, c in enumerate((first, second))], axis=1)
    high = np.stack([np.where(forward[:, k], following[c], c) for k, c in enumerate((first, second))], axis=1)
    joined = ~on_seam
    fans = component_labels(
        len(mesh.face_vertex_indices),
        np.concatenate([low[joined, 0], high[joined, 0]]),
        np.concatenate([low[joined, 1], high[joined, 1]]),
    )
    _, firsts, vertices = np.unique(fans, return_index=True, return_inverse=True)
    labels = component_labels(mesh.face_count, faces[first[joined]], faces[second[joined]])
    panels = Panels(
        mesh=mesh,
        corners=vertices.reshape(-1, 3).astype(np.int64),
        sewn_to=mesh.face_vertex_indices[firsts].astype(np.int64),
        of_faces=np.unique(labels, return_inverse=True)[1],
        seams=np.stack([vertices[low[on_seam]], vertices[high[on_seam]]], axis=2),
        forward=forward[on_seam],
    )
    _require_disks(panels)
    return panels


def _on_seams(mesh: PolygonMesh, ends: Numbers, seams: Numbers) -> NDArray[np.bool_]:
    """Return a mask of the edges on a seam."""
    keys = ends.min(axis=1) * mesh.vertex_count + ends.max(axis=1)
    wanted = seams.min(axis=1) * mesh.vertex_count + seams.max(axis=1)
    if not np.isin(wanted, keys).all():
        a, b = seams[~np.isin(wanted, keys)][0] + 1
        raise InputError(
            f"panels: no edge of {mesh.name} joins vertices {a} and {b}, counted from 1, of a seam; expected edges"
        )
    return np.isin(keys, wanted)


def _require_disks(panels: Panels) -> None:
    """Make sure that each panel can be laid flat."""
    for panel in range(panels.count):
        triangles = panels.corners[panels.of_faces == panel]
        pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        euler = len(np.unique(triangles)) - len(np.unique(pairs, axis=0)) + len(triangles)
        if euler == 1:
            continue
        middle = panels.mesh.points[panels.sewn_to[triangles]].mean(axis=(0, 1))
        where = "(" + ", ".join(f"{x:.3g}" for x in middle) + ") m"
        what = "is closed: the seams do not cut it" if euler == 2 else f"has {2 - euler} borders or a handle"
        raise InputError(
            f"panels: the piece of {len(triangles)} triangles about {where} of {panels.mesh.name} {what}; expected "
            "pieces with one border, which can be flattened"
        )


MATERIALS, GROUPS = "materials", "groups"
NEAR = 1.0e-6
"""Distance within which a vertex that was read is one that was kept, over the size"""


def seams_of(said: str, read: PolygonMesh, kept: PolygonMesh) -> Numbers:
    """Return the edges along which a mesh is to be cut, by their ends, shape (k, 2).

    Args:
        said: "materials", "groups", or a file: `l` lines of an .obj file, as Blender writes loose edges, or rows of
            vertices along a seam, counted from 1.
        read: the mesh as its file has it.
        kept: the mesh that is cut, whose vertices are some of those that were read.

    Raises:
        InputError: the file cannot be read or names other vertices, or the mesh has no such borders.
    """
    if said in (MATERIALS, GROUPS):
        labels = _material_labels(kept) if said == MATERIALS else _group_labels(kept)
        return _between(kept, labels, said)
    pairs = _pairs_in(Path(said))
    if (wrong := (pairs < 1) | (pairs > read.vertex_count)).any():
        raise InputError(
            f"{said}: has vertex {pairs[wrong][0]}; expected numbers from 1 to the {read.vertex_count} of {read.name}"
        )
    apart, here = KDTree(kept.points).query(read.points[pairs - 1])
    if (lost := apart > NEAR * np.ptp(read.points, axis=0).max()).any():
        raise InputError(f"{said}: vertex {pairs[lost][0]} is in no face of {read.name}; expected vertices of faces")
    return np.asarray(here, dtype=np.int64)


def _pairs_in(path: Path) -> Numbers:
    """Return the vertices at both ends of each edge along a seam, counted from 1."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        raise InputError(
            f"panels: {path} cannot be read; expected a number of gores, a file of seams, materials or groups"
        ) from None
    pairs: list[tuple[int, int]] = []
    for number, line in enumerate(lines, start=1):
        words = line.split("#")[0].replace(",", " ").split()
        if path.suffix.lower() == ".obj":
            words = words[1:] if words[:1] == ["l"] else []
        if not words:
            continue
        try:
            along = [int(word) for word in words]
        except ValueError:
            raise InputError(f"{path}: line {number} is {line.strip()!r}; expected vertex numbers") from None
        if len(along) < 2:
            raise InputError(f"{path}: line {number} has one vertex; expected two or more along a seam")
        pairs += pairwise(along)
    if not pairs:
        raise InputError(
            f"{path}: has no seam; expected lines of vertices" + " that begin with l" * (path.suffix == ".obj")
        )
    return np.array(pairs, dtype=np.int64)


def _between(mesh: PolygonMesh, labels: Numbers, said: str) -> Numbers:
    """Return the edges between faces of different labels."""
    edges = mesh_edges(mesh)
    faces = np.repeat(np.arange(mesh.face_count), mesh.face_vertex_counts)[edges.corners].reshape(-1, 2)
    seams = edges.ends[labels[faces[:, 0]] != labels[faces[:, 1]]]
    if not len(seams):
        raise InputError(f"panels: {mesh.name} has no {said} with a border between them; expected two or more")
    return seams


def _material_labels(mesh: PolygonMesh) -> Numbers:
    """Return the material of each face."""
    if mesh.looks is None:
        return np.zeros(mesh.face_count, dtype=np.int64)
    starts = np.cumsum(mesh.face_vertex_counts) - mesh.face_vertex_counts
    return mesh.looks.of_corners[starts].astype(np.int64)


def _group_labels(mesh: PolygonMesh) -> Numbers:
    """Return the groups of each face: those that have all of its vertices, the smallest if there are several."""
    labels = np.full(mesh.face_count, -1, dtype=np.int64)
    starts = np.cumsum(mesh.face_vertex_counts) - mesh.face_vertex_counts
    groups = sorted(mesh.groups.values(), key=len)
    for number, vertices in reversed(list(enumerate(groups))):
        inside = np.isin(mesh.face_vertex_indices, vertices)
        labels[np.logical_and.reduceat(inside, starts)] = number
    return labels


LEAST_GORES, MOST_GORES = 3, 64
ASIDE_OF_GORES = 1.0e-9
"""Distance from a plane over the size up to which something lies in it"""
Meridian = Callable[[float], Values]
"""Function for the line from pole to pole at an angle, shape (k, 3)"""


def gores_of(mesh: PolygonMesh, count: int, edge: float) -> tuple[PolygonMesh, NDArray[np.int64]]:
    """Divide the surface anew, so that seams of gores run along its edges.

    Args:
        mesh: closed and centered.
        edge: about how long the edges become [m].

    Returns:
        The triangles, and the edges along the seams, shape (k, 2).

    Raises:
        InputError: the shape does not go around its axis once.
    """
    if not LEAST_GORES <= count <= MOST_GORES:
        raise InputError(f"panels: must be from {LEAST_GORES} to {MOST_GORES} gores (got {count})")
    line = _meridians(mesh)
    length = max(_lengths(line(2.0 * np.pi * k / count))[-1] for k in range(count))
    rows = max(4, round(length / edge))
    grid = _Grid(line, count, rows, edge)
    points, triangles, seams = grid.build()
    found = PolygonMesh(
        points, np.full(len(triangles), 3, dtype=np.int32), triangles.ravel().astype(np.int32), mesh.name
    )
    if signed_volume(found) < 0.0:
        found = replace(found, face_vertex_indices=triangles[:, ::-1].ravel().astype(np.int32))
    return found, seams


class _Grid:
    """Rows of vertices on all gores, from pole to pole."""

    def __init__(self, line: Meridian, count: int, rows: int, edge: float):
        self._line, self._count, self._rows, self._edge = line, count, rows, edge
        self._places: dict[tuple[float, int], int] = {}
        self._points: list[Values] = []

    def build(self) -> tuple[Values, NDArray[np.int64], NDArray[np.int64]]:
        """Return the points, triangles, and edges along the seams."""
        triangles: list[tuple[int, int, int]] = []
        seams = set()
        for gore in range(self._count):
            lines = [self._row(gore, row) for row in range(self._rows + 1)]
            for low, high in pairwise(lines):
                triangles += _zipped(low, high)
                seams |= {(low[0], high[0])}
        return np.array(self._points), np.array(triangles), np.array(sorted(seams))

    def _row(self, gore: int, row: int) -> list[int]:
        """Return the vertices of a gore's row, from seam to seam."""
        if row in (0, self._rows):
            return [self._vertex(0.0, row)]
        ends = self._at(gore / self._count, row), self._at((gore + 1) / self._count, row)
        parts = max(1, round(float(np.linalg.norm(ends[1] - ends[0])) / self._edge))
        return [self._vertex((gore + k / parts) / self._count, row) for k in range(parts + 1)]

    def _vertex(self, turn: float, row: int) -> int:
        key = round(turn % 1.0, 9) % 1.0, row
        if key not in self._places:
            self._places[key] = len(self._points)
            self._points.append(self._at(turn, row))
        return self._places[key]

    def _at(self, turn: float, row: int) -> Values:
        line = self._line(2.0 * np.pi * (round(turn % 1.0, 9) % 1.0))
        along = _lengths(line)
        where = along[-1] * row / self._rows
        return np.array([np.interp(where, along, line[:, axis]) for axis in range(3)])


def _zipped(low: list[int], high: list[int]) -> list[tuple[int, int, int]]:
    """Return the triangles between two rows."""
    found, i, j = [], 0, 0
    while i < len(low) - 1 or j < len(high) - 1:
        next_low, next_high = (i + 1) / max(len(low) - 1, 1e-9), (j + 1) / max(len(high) - 1, 1e-9)
        if next_low <= next_high:
            found.append((low[i], low[i + 1], high[j]))
            i += 1
        else:
            found.append((low[i], high[j + 1], high[j]))
            j += 1
    return found


def _lengths(line: Values) -> Values:
    """Return the length of a line up to each of its points."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))


def _meridians(mesh: PolygonMesh) -> Meridian:
    """Return the lines of a mesh from its lower pole to the upper one, by angle."""
    triangles, up = Ruler(mesh).triangles, "XYZ".index(mesh.up_axis)
    size = float(np.ptp(mesh.points, axis=0).max())
    across = [axis for axis in range(3) if axis != up]

    @cache
    def line(angle: float) -> Values:
        away, beside = np.zeros(3), np.zeros(3)
        away[across] = np.cos(angle), np.sin(angle)
        beside[across] = -np.sin(angle), np.cos(angle)
        places = mesh.points - 0.0
        heights = places @ beside
        loops = _loops(
            places, triangles, np.where(np.abs(heights) < ASIDE_OF_GORES * size, ASIDE_OF_GORES * size, heights)
        )
        parts = [part for loop in loops for part in _outward(loop, loop @ away, up)]
        if len(parts) != 1:
            raise InputError(
                f"panels: the half-plane at {np.degrees(angle):.0f} degrees meets {mesh.name} in {len(parts)} lines "
                "from pole to pole; gores need one, as of a shape around its vertical axis; a file of seams cuts other "
                "shapes"
            )
        return parts[0] if parts[0][0, up] < parts[0][-1, up] else parts[0][::-1]

    return line


def _loops(points: Values, triangles: NDArray[np.int64], heights: Values) -> list[Values]:
    """Return the closed lines in which a plane meets a closed surface.

    Args:
        heights: of the points over the plane, none of them 0.
    """
    over = heights[triangles] > 0.0
    cut = triangles[over.any(axis=1) & ~over.all(axis=1)]
    beside: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for corners in cut.tolist():
        pairs = ((corners[k], corners[(k + 1) % 3]) for k in range(3))
        first, second = (tuple(sorted(pair)) for pair in pairs if (heights[pair[0]] > 0.0) != (heights[pair[1]] > 0.0))
        beside.setdefault(first, []).append(second)  # pyright: ignore[reportArgumentType]
        beside.setdefault(second, []).append(first)  # pyright: ignore[reportArgumentType]
    loops, left = [], dict(beside)
    while left:
        here, order = next(iter(left)), []
        while here in left:
            order.append(here)
            ways = left.pop(here)
            here = next((way for way in ways if way in left), here)
        ends = np.array(order)
        part = heights[ends[:, 0]] / (heights[ends[:, 0]] - heights[ends[:, 1]])
        loops.append(points[ends[:, 0]] + part[:, None] * (points[ends[:, 1]] - points[ends[:, 0]]))
    return loops


def _outward(loop: Values, reach: Values, up: int) -> list[Values]:
    """Return the parts of a closed line on the one side of the axis, with the points on the axis at their ends.

    Args:
        reach: how far each point is from the axis, to that side.
    """
    out = reach > 0.0
    if out.all() or not out.any():
        return [loop] if out.all() else []
    begins = np.flatnonzero(out & ~np.roll(out, 1))
    parts = []
    for begin in begins.tolist():
        order = np.roll(np.arange(len(loop)), -begin)
        run = order[: int(np.argmin(out[order]))]
        ends = [(order[-1], run[0]), (order[len(run)], run[-1])]
        poles = [loop[a] + (loop[b] - loop[a]) * (reach[a] / (reach[a] - reach[b])) for a, b in ends]
        parts.append(np.concatenate([[poles[0]], loop[run], [poles[1]]]))
    return parts


LEAST_SIZE, MOST_SIZE = 0.01, 100.0
"""Range of sizes [m]"""
MOST_VERTICES = 20_000
"""Largest number of vertices that are designed within minutes"""
HELD, NECK = "held", "neck"
"""Groups of the vertices that are held, and of those that are unless others are named"""
THINNEST = 1.0e-6
"""Volume over the cube of the size below which a shape is flat"""


def target_of(given: str | Path | MeshLike, size: float | None) -> PolygonMesh:
    """Read the wanted shape, or take it as it is in Python.

    Args:
        size: its largest extent [m]; its own when missing.

    Raises:
        InputError: it cannot be read, is open, has several parts, crosses itself or is too large.
    """
    require_size(size)
    return centered(shape_of(given)[1], size)


def held_target_of(
    given: str | Path | MeshLike, size: float | None, fixed: Sequence[int | str] | None
) -> tuple[PolygonMesh, NDArray[np.bool_]]:
    """Read the wanted shape, turned so that Y is up, and which of its vertices are held.

    Args:
        size: its largest extent [m]; its own when missing.
        fixed: held vertices of the file, counted from 0, and held groups of the mesh; its neck when missing.

    Raises:
        InputError: as of `target_of`, or there is no such vertex or group.
    """
    require_size(size)
    read = load_mesh(Path(given) if isinstance(given, str) else given)
    if fixed is None:
        if NECK not in read.groups:
            raise InputError(f"{read.name}: has no group {NECK} to hang from; expected fixed, with vertices or groups")
        fixed = [NECK]
    named = np.unique(np.array(fixed_particles(fixed, read), dtype=np.int32))
    shape = shape_of(replace(read, groups={HELD: named}))[1]
    held = np.zeros(shape.vertex_count, dtype=bool)
    held[shape.groups[HELD]] = True
    if not held.any() or held.all():
        raise InputError(f"fixed: holds {int(held.sum())} of {held.size} vertices; expected some, and not all")
    turned = replace(shape, points=shape.points @ axes_matrix(shape.up_axis, "Y").T, up_axis="Y")
    return centered(turned, size), held


def shape_of(given: str | Path | MeshLike) -> tuple[PolygonMesh, PolygonMesh]:
    """Read a shape: as its file has it, and closed, of one part and with faces outward.

    Raises:
        InputError: it cannot be read, is open, has several parts, crosses itself or is too large.
    """
    read = load_mesh(Path(given) if isinstance(given, str) else given)
    source = given if isinstance(given, str | Path) else read.name
    mesh = _used(prepared(read, source, Treatment()))
    edges = mesh_edges(mesh)
    if not is_closed(edges):
        low, high = edges.ends[border_edges(edges)[0]] + 1
        raise InputError(
            f"{source}: is open, between vertex {low} and {high}, counted from 1; expected a closed shape, as "
            "`balloon-warp remesh` makes of any surface"
        )
    if parts := len(np.unique(vertex_components(mesh, edges))) - 1:
        raise InputError(f"{source}: has {parts + 1} parts; expected one closed shape, as `balloon-warp remesh` makes")
    if mesh.vertex_count > MOST_VERTICES:
        raise InputError(
            f"{source}: has {mesh.vertex_count:,} vertices; expected at most {MOST_VERTICES:,}, see "
            "`balloon-warp remesh`"
        )
    if not abs(volume := signed_volume(mesh)) > THINNEST * float(np.ptp(mesh.points, axis=0).max()) ** 3:
        raise InputError(f"{source}: is flat and encloses no volume; expected a solid shape")
    if volume < 0.0:
        mesh = _turned(mesh)
    if crossed := crossings_sentence(mesh):
        raise InputError(f"{source}: {crossed}; expected a surface that does not, such as `balloon-warp remesh` makes")
    return read, mesh


def centered(mesh: PolygonMesh, size: float | None) -> PolygonMesh:
    """Return the bare shape in meters about the origin, of a size, or of its own.

    Raises:
        InputError: its own size is not that of a balloon.
    """
    points = mesh.points * mesh.meters_per_unit
    points = points - 0.5 * (points.max(axis=0) + points.min(axis=0))
    if size is None:
        size = float(np.ptp(points, axis=0).max())
        low, high = (LEAST_SIZE, MOST_SIZE) if mesh.unit_known else (SMALLEST, LARGEST)
        if not low <= size <= high:
            unit = "" if mesh.unit_known else ", in meters"
            raise InputError(
                f"{mesh.name}: is {size:.3g} m large{unit}; expected {low:g} to {high:g} m, or a size (--size)"
            )
    return replace(
        mesh, points=points * (size / np.ptp(points, axis=0).max()), meters_per_unit=1.0, warnings=(), looks=None,
        texture_coordinates=None, stand_ins=None, groups={},
    )  # fmt: skip


def require_size(size: float | None) -> None:
    """Make sure that a size can be simulated, if one is given.

    Raises:
        InputError: it cannot.
    """
    if size is not None and not (isfinite(size) and LEAST_SIZE <= size <= MOST_SIZE):
        raise InputError(f"size: must be from {LEAST_SIZE:g} to {MOST_SIZE:g} m (got {size})")


def _used(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh without unused vertices."""
    used, numbers = np.unique(mesh.face_vertex_indices, return_inverse=True)
    new = np.full(mesh.vertex_count, -1, dtype=np.int32)
    new[used] = np.arange(len(used), dtype=np.int32)
    there = np.arange(mesh.vertex_count) if mesh.stand_ins is None else mesh.stand_ins
    groups = {name: np.unique(new[there[vertices]]) for name, vertices in mesh.groups.items()}
    return replace(
        mesh, points=mesh.points[used], face_vertex_indices=numbers.ravel().astype(np.int32), stand_ins=None,
        groups={name: vertices[vertices >= 0] for name, vertices in groups.items()},
    )  # fmt: skip


def _turned(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with faces outward."""
    starts = np.cumsum(mesh.face_vertex_counts) - mesh.face_vertex_counts
    order = np.concatenate([
        np.arange(start + count - 1, start - 1, -1)
        for start, count in zip(starts.tolist(), mesh.face_vertex_counts.tolist(), strict=True)
    ])  # fmt: skip
    looks = mesh.looks.at(order) if mesh.looks else None
    return replace(mesh, face_vertex_indices=mesh.face_vertex_indices[order], looks=looks)

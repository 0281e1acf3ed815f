"""Welding of faces that end at the same place, and of parts that lie on others.

Welding: faces that end at the same place share their vertices there.

Vertices keep their numbers; those that faces have left move along with the ones that stand in for them.
"""

from dataclasses import dataclass, replace
from math import floor, log10

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import first_coincident
from balloon_warp.mesh.orientation import Border
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.repair import distinct_faces
from balloon_warp.mesh.topology import (
    component_labels,
    corner_faces,
    face_starts,
    first_alike,
    mesh_edges,
    vertex_components,
    with_corners,
)

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

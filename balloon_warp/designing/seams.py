"""Seams that the user marks: lines of vertices in a file, or borders between materials or groups of the mesh."""

from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges

Numbers = NDArray[np.int64]
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

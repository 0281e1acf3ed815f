"""Holes in a surface, such as pinholes and eye sockets, and lids for them.

Intended openings stay open: the rim of a bowl, a sleeve.
"""

from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import face_areas, face_centers, face_vector_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    MeshEdges,
    border_edges,
    component_labels,
    corner_faces,
    face_starts,
    mesh_edges,
    next_corners,
    vertex_components,
    with_corners,
)

PINHOLE = 2e-4
"""A hole whose lid has less than this part of the mesh's area is closed, regardless of the surface around it."""
LARGEST_HOLE = 0.05
"""A larger one may be closed up to this part, if the surface around it faces as its lid does: not the end of a tube."""
A_FACE = 4
"""Number of edges up to which a hole is a missing face, regardless of the surface around it"""
FACING = 0.5
"""Least mean cosine between the surface around a hole and its lid"""
UPON = 0.9
"""Least mean cosine between the directions from a rim into its faces and into its lid at which the lid lies on the
faces"""
BESIDE_OPENINGS = 1.0 / 6.0
"""Largest hole over the largest opening that stays. An eye is smaller than a neck, which is smaller than the hem of a
shirt"""
LARGEST_OF_ITS_PART = 0.75
"""Largest lid over the area of its component: a lid over a sheet would lie on the sheet"""
ROTATIONS, RUNGS = 64, 200_000
"""Largest numbers of tried layouts of a lid's faces, and of cross edges in all of them"""


@dataclass(frozen=True)
class Lid:
    """Faces across a hole, from one side of its rim to the other, as the rungs of a ladder part it."""

    loop: NDArray[np.int64]
    """Vertices around the hole, as the lid runs, shape (n,); the ladder begins between the last and the first"""

    @property
    def faces(self) -> list[NDArray[np.int64]]:
        """Quads, and a triangle at the end where n is odd."""
        left, right = self.loop, self.loop[::-1]
        half = len(left) // 2
        quads = [np.array([left[i], left[i + 1], right[i + 1], right[i]]) for i in range(half - 1)]
        return quads if len(left) % 2 == 0 else [*quads, left[half - 1 : half + 2]]

    @property
    def rungs(self) -> list[tuple[int, int]]:
        """Cross edges that are not on the rim."""
        inner = slice(1, (len(self.loop) - 1) // 2)
        return list(zip(self.loop[inner].tolist(), self.loop[::-1][inner].tolist(), strict=True))

    def vector_areas(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the vector areas of its faces, shape (face_count, 3)."""
        corners = [points[np.take(face, (0, 1, 2, -1))] for face in self.faces]
        diagonals = np.array([(corner[2] - corner[0], corner[3] - corner[1]) for corner in corners])
        return 0.5 * np.cross(diagonals[:, 0], diagonals[:, 1])

    def area(self, points: NDArray[np.float64]) -> float:
        """Return the area of its faces together."""
        return float(np.linalg.norm(self.vector_areas(points), axis=1).sum())


def border_loops(mesh: PolygonMesh, edges: MeshEdges) -> list[NDArray[np.int64]]:
    """Return the loops along open borders, each through a vertex once.

    They run as their faces do, where these are wound alike, or else either way; and include paths that one edge of
    other faces closes.
    """
    begins = edges.corners[edges.starts[border_edges(edges)]]
    corners = mesh.face_vertex_indices.astype(np.int64)
    pairs = np.stack([corners[begins], corners[next_corners(mesh)[begins]]], axis=1)
    loops, _ = _walks(pairs, mesh.points)
    in_loops = {pair for loop in loops for pair in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True)}
    left = np.array([pair for pair in pairs.tolist() if tuple(pair) not in in_loops], dtype=np.int64).reshape(-1, 2)
    more, ways = _walks(np.concatenate([left, left[:, ::-1]]), mesh.points, both_ways=True)
    closing = {(min(way[0], way[-1]), max(way[0], way[-1])) for way in ways} if ways else set()
    closing &= {(low, high) for low, high in edges.ends.tolist()} if closing else set()
    closed = [np.array(way) for way in ways if (min(way[0], way[-1]), max(way[0], way[-1])) in closing]
    return [*loops, *more, *closed]


def _walks(
    pairs: NDArray[np.int64], points: NDArray[np.float64], both_ways: bool = False
) -> tuple[list[NDArray[np.int64]], list[list[int]]]:
    """Return the loops from begin to end of pairs, shape (n, 2), and the paths that end somewhere.

    At a branch, a path takes the one that turns back the most, as at the end of a slit.
    """
    onward: dict[int, list[int]] = defaultdict(list)
    for begin, end in pairs.tolist():
        onward[begin].append(end)

    def leave(path: list[int]) -> int:
        here, ends = path[-1], onward[path[-1]]
        if len(ends) > 1 and len(path) > 1:
            came = points[here] - points[path[-2]]
            ends.sort(key=lambda end: -float(came @ (points[end] - points[here])) / _length(points[end] - points[here]))
        end = ends.pop()
        if both_ways:
            onward[end].remove(here)
        return end

    loops, ways = [], []
    # Ways that end somewhere begin at one of their ends.
    for start in sorted(onward, key=lambda vertex: (both_ways and len(onward[vertex]) % 2 == 0, vertex)):
        path, place = [start], {start: 0}
        while onward[path[-1]]:
            vertex = leave(path)
            if vertex not in place:
                place[vertex] = len(path)
                path.append(vertex)
                continue
            loop = path[place[vertex] :]
            loops.append(np.array(loop, dtype=np.int64))
            path = path[: place[vertex] + 1]
            for passed in loop[1:]:
                del place[passed]
        if len(path) > 2:
            ways.append(path)
    return loops, ways


def _length(vector: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(vector)) or 1.0


def with_lids(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with faces across the holes in its surface, after its own, and a warning that tells of them.

    Args:
        mesh: wound alike.
    """
    bare = _without_fins(mesh)
    edges = mesh_edges(bare)
    loops = [loop[::-1] for loop in border_loops(bare, edges) if len(loop) > 2]
    if not loops:
        return mesh
    surface = _Surface(bare, edges)
    if surface.area == 0.0:
        return mesh
    taken = {(low, high) for low, high in mesh_edges(mesh).ends.tolist()}
    lids = []
    for loop in sorted(loops, key=min):
        lids.append(lid_across(loop, mesh.points, taken))
        taken |= {(min(pair), max(pair)) for pair in lids[-1].rungs}
    lids = surface.lids_of_holes(lids, mesh.points)
    return _closed(mesh, lids) if lids else mesh


def _without_fins(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh without small pieces of surface that stand on edges of others and end at a border.

    Their rims are no openings, and beside them holes would not be found.
    """
    edges = mesh_edges(mesh)
    on_two = np.repeat(edges.face_counts == 2, edges.face_counts)
    faces, first = corner_faces(mesh)[edges.corners], np.repeat(edges.starts, edges.face_counts)
    pieces = component_labels(mesh.face_count, faces[on_two], faces[first][on_two])
    areas = np.bincount(pieces, face_areas(mesh), mesh.face_count)
    fins = areas < LARGEST_HOLE * areas.sum()
    for least, most in ((1, 1), (3, mesh.face_count)):
        there = (edges.face_counts >= least) & (edges.face_counts <= most)
        fins &= np.bincount(pieces[faces[np.repeat(there, edges.face_counts)]], minlength=mesh.face_count) > 0
    fins = fins[pieces]
    if not fins.any():
        return mesh
    kept = with_corners(mesh, ~fins[corner_faces(mesh)])
    return replace(kept, face_vertex_counts=mesh.face_vertex_counts[~fins])


class _Surface:
    """Surface around the holes of a mesh."""

    def __init__(self, mesh: PolygonMesh, edges: MeshEdges):
        self._component = vertex_components(mesh, edges)
        self._of_faces = self._component[mesh.face_vertex_indices[face_starts(mesh)]]
        self._vectors, self._centers = face_vector_areas(mesh), face_centers(mesh)
        self._areas = np.linalg.norm(self._vectors, axis=1)
        self.area = float(self._areas.sum())
        """Area, without which there is no surface to have holes"""
        self._of_components = np.bincount(self._of_faces, self._areas, mesh.vertex_count)
        border = border_edges(edges)
        faces = corner_faces(mesh)[edges.corners[edges.starts[border]]]
        self._at_borders = {
            (low, high): face for (low, high), face in zip(edges.ends[border].tolist(), faces.tolist(), strict=True)
        }

    def lids_of_holes(self, lids: list[Lid], points: NDArray[np.float64]) -> list[Lid]:
        """Return the lids that close a hole in the surface, and not those that are meant to be open."""
        areas = np.array([lid.area(points) for lid in lids]) / self.area
        is_hole = np.array([self._may_be_hole(lid, points) for lid in lids])
        limit = BESIDE_OPENINGS * areas[~is_hole].max(initial=np.inf if is_hole.all() else 0.0)
        return [
            lid for lid, hole, area in zip(lids, is_hole, areas, strict=True) if hole and area <= max(limit, PINHOLE)
        ]

    def _may_be_hole(self, lid: Lid, points: NDArray[np.float64]) -> bool:
        area, whole, component = lid.area(points), self.area, int(self._component[lid.loop[0]])
        if area > min(LARGEST_HOLE * whole, LARGEST_OF_ITS_PART * self._of_components[component]):
            return False
        way = lid.vector_areas(points).sum(axis=0)
        if area <= PINHOLE * whole or len(lid.loop) <= A_FACE:
            return not self._lies_on_faces(lid, points)
        return self._faces_alike(way, points[lid.loop], component)

    def _lies_on_faces(self, lid: Lid, points: NDArray[np.float64]) -> bool:
        """Return whether the faces along the rim lie where the lid does, as in a sheet around the lid's place."""
        ends = np.stack([lid.loop, np.roll(lid.loop, -1)], axis=1)
        found = [
            (pair, self._at_borders[min(pair), max(pair)])
            for pair in map(tuple, ends.tolist())
            if (min(pair), max(pair)) in self._at_borders
        ]
        middles = np.array([points[list(pair)].mean(axis=0) for pair, _ in found])
        ways = self._centers[[face for _, face in found]] - middles, points[lid.loop].mean(axis=0) - middles
        sizes = np.linalg.norm(ways[0], axis=1) * np.linalg.norm(ways[1], axis=1)
        cosines = np.divide((ways[0] * ways[1]).sum(axis=1), sizes, out=np.zeros(len(sizes)), where=sizes > 0.0)
        return bool(cosines.mean() > UPON)

    def _faces_alike(self, way: NDArray[np.float64], rim: NDArray[np.float64], component: int) -> bool:
        """Return whether the component's surface within a radius of the rim faces that way, or the opposite one."""
        middle = rim.mean(axis=0)
        reach = 2.0 * np.linalg.norm(rim - middle, axis=1).max()
        around = (self._of_faces == component) & (np.linalg.norm(self._centers - middle, axis=1) < reach)
        facing = np.abs(self._vectors[around] @ way).sum()
        return bool(facing > FACING * np.linalg.norm(way) * self._areas[around].sum())


def lid_across(loop: NDArray[np.int64], points: NDArray[np.float64], taken: set[tuple[int, int]]) -> Lid:
    """Return quads between the two sides of a loop, with a triangle at the end of an odd one.

    They are turned so that cross edges are short, and not edges of the mesh already, where possible.
    """
    count, steps = len(loop), np.arange(1, (len(loop) - 1) // 2)
    tried = min(count, ROTATIONS, max(RUNGS // count, 1))
    starts = np.unique(np.linspace(0, count - 1, tried).astype(int))
    left, right = (starts[:, None] + steps) % count, (starts[:, None] - 1 - steps) % count
    lengths = np.linalg.norm(points[loop[left]] - points[loop[right]], axis=2)
    pairs = np.sort(np.stack([loop[left], loop[right]], axis=2), axis=2).tolist()
    known = np.array([sum((low, high) in taken for low, high in rungs) for rungs in pairs])
    best = np.lexsort((lengths.sum(axis=1), known))[0]
    return Lid(np.roll(loop, -starts[best]))


def _closed(mesh: PolygonMesh, lids: list[Lid]) -> PolygonMesh:
    """Return the mesh with its lids.

    Texture coordinates and looks of their corners are those of a corner at the vertex.
    """
    corners = np.concatenate([corner for lid in lids for corner in lid.faces])
    counts = np.array([len(face) for lid in lids for face in lid.faces], dtype=np.int32)
    every = np.arange(len(mesh.face_vertex_indices))
    first = np.zeros(mesh.vertex_count, dtype=np.int64)
    first[mesh.face_vertex_indices[::-1]] = every[::-1]
    like = np.concatenate([every, first[corners]])
    textures = mesh.texture_coordinates
    one = len(lids) == 1
    largest = max(lids, key=lambda lid: len(lid.loop))
    which = "it has" if one else "the largest has"
    sentence = (
        f"{len(lids):,} {'hole' if one else 'holes'} in the surface {'is' if one else 'are'} closed by faces numbered "
        f"after the file's; {which} {len(largest.loop)} edges, one at vertex {largest.loop.min() + 1}, counting from "
        f'1. holes = "keep" leaves {"it" if one else "them"} open.'
    )
    return replace(
        mesh,
        face_vertex_counts=np.concatenate([mesh.face_vertex_counts, counts]),
        face_vertex_indices=np.concatenate([mesh.face_vertex_indices, corners.astype(np.int32)]),
        texture_coordinates=None if textures is None else textures[like],
        looks=mesh.looks and mesh.looks.at(like),
        warnings=(*mesh.warnings, sentence),
    )

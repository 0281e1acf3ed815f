"""Defects of a mesh, their treatment, and lids for holes.

Holes in a surface, such as pinholes and eye sockets, and lids for them.

Intended openings stay open: the rim of a bowl, a sleeve.

Parts of a surface whose sides are wrong: the outer one inside it, or the inner one outside.

The winding number of a closed surface that faces outward is 1 on its inside and 0 on its outside. Just above a triangle
it is 1 or more where another part of the surface encloses the triangle; just below, it is 0 or less where the surface
is turned inside out.

Defects of a mesh and their treatment, for people: two sentences for each kind of defect.

Faces and vertices are counted from 1.
"""

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.crossings import LARGEST_FAN
from balloon_warp.mesh.orientation import facing_outward, inward_faces, wound_alike
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    MeshEdges,
    border_edges,
    component_labels,
    corner_faces,
    duplicate_faces,
    face_areas,
    face_centers,
    face_starts,
    face_vector_areas,
    first_coincident,
    inconsistent_edges,
    mesh_edges,
    next_corners,
    non_manifold_edges,
    non_manifold_vertices,
    repeated_corners,
    triangulate,
    unused_vertices,
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


NEAR = 0.02
"""Distance above and below a triangle at which samples are tested, over the root of its area"""


class WrongSides(NamedTuple):
    """Triangles of a mesh, as in `triangulate`, whose sides are wrong."""

    areas: NDArray[np.float64]
    """Areas of the triangles, in the mesh's unit squared, shape (triangle_count,)"""
    enclosed: NDArray[np.bool_]
    """Mask of triangles whose outer side lies within the surface, shape (triangle_count,)"""
    reversed: NDArray[np.bool_]
    """Mask of triangles whose inner side lies outside the surface, shape (triangle_count,)"""


def wrong_sides(mesh: PolygonMesh) -> WrongSides:
    """Return the triangles of a closed mesh that lie within it, and those that are turned inside out."""
    from balloon_warp.mesh.surface_nets import MeshDistance  # takes long to load

    points = mesh.points - mesh.points.mean(axis=0)
    triangles, _ = triangulate(mesh)
    a, b, c = points[triangles].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    sizes = np.sqrt(np.linalg.norm(normals, axis=1, keepdims=True))
    has_area = sizes[:, 0] > 0.0
    step = NEAR * np.divide(normals, sizes, out=np.zeros_like(normals), where=sizes > 0.0)
    distance, centers = MeshDistance(points, triangles, thickness=0.0), (a + b + c) / 3.0
    enclosed, reversed_ = distance(centers + step) < 0.0, distance(centers - step) > 0.0
    return WrongSides(0.5 * sizes[:, 0] ** 2, has_area & enclosed, has_area & reversed_)


def repaired(mesh: PolygonMesh, source: object, holes: Literal["cap", "keep"] = "cap") -> PolygonMesh:
    """Return the mesh without repeated corners and faces, wound outward, and with lids on its holes.

    Vertices stay.

    Raises:
        InputError: no face is left; it names `source`.
    """
    mesh, kept = distinct_faces(mesh)
    if not len(kept):
        raise InputError(f"{source}: has no face with three different corners")
    return facing_outward(mesh if holes == "keep" else with_lids(wound_alike(mesh)))


def distinct_faces(mesh: PolygonMesh) -> tuple[PolygonMesh, NDArray[np.int64]]:
    """Return the mesh without repeated vertices in faces and without repeated faces, and the kept faces in order.

    A vertex stays where a face comes to it first. Faces that then have under three vertices, or the corners of an
    earlier face, go.
    """
    mesh = _distinct_corners(mesh)
    keep = mesh.face_vertex_counts >= 3
    keep[duplicate_faces(mesh)] = False
    kept = with_corners(mesh, keep[corner_faces(mesh)])
    return replace(kept, face_vertex_counts=mesh.face_vertex_counts[keep]), np.flatnonzero(keep)


def _distinct_corners(mesh: PolygonMesh) -> PolygonMesh:
    first = np.ones(len(mesh.face_vertex_indices), dtype=bool)
    first[repeated_corners(mesh)] = False
    counts = np.bincount(corner_faces(mesh)[first], minlength=mesh.face_count).astype(np.int32)
    return replace(with_corners(mesh, first), face_vertex_counts=counts)


# A face is of no area below this part of its longest edge squared: far thinner than float32 can hold open.
NO_AREA = 1e-9


def describe_defects(
    mesh: PolygonMesh, whole: PolygonMesh, parts: Literal["held", "free"], left_out: NDArray[np.integer]
) -> list[str]:
    """Describe each kind of defect in the mesh: the number, the first, and the treatment.

    Args:
        whole: Mesh once repaired, whose open edges stay so.
        parts: Whether components are held together.
        left_out: Vertices of parts that are left out.
    """
    distinct, kept = distinct_faces(mesh)
    edges, edges_left = mesh_edges(distinct), mesh_edges(whole)
    sentences = [
        _about_faces(
            np.unique(corner_faces(mesh)[repeated_corners(mesh)]),
            "repeats a corner",
            "repeat a corner",
            "Repeated corners count once.",
        ),
        _about_faces(
            _faces_without_area(mesh),
            "has no area",
            "have no area",
            "Such a face has springs, and is inflated once it opens, unless it is a fin.",
        ),
        _about_faces(
            _duplicates(mesh, kept),
            "has the corners of an earlier face",
            "have the corners of earlier faces",
            "Repeated faces count once.",
        ),
        _about_coincident_vertices(mesh),
        _about_vertices(
            np.setdiff1d(unused_vertices(mesh), np.concatenate([mesh.left_vertices, left_out])),
            "belongs to no face",
            "belong to no face",
            "Such a vertex keeps its number, has no mass and stays where it is.",
        ),
        _about_vertices(
            non_manifold_vertices(distinct, edges),
            "joins parts of the surface that share no edge there",
            "join parts of the surface that share no edge there",
            "The parts stay joined there.",
        ),
        _about_vertices(
            np.flatnonzero(np.bincount(edges.ends.ravel()) > LARGEST_FAN),
            f"has more than {LARGEST_FAN} neighbors",
            f"have more than {LARGEST_FAN} neighbors",
            "Beyond, each neighbor gets one flexion spring instead of one to every other neighbor.",
        ),
        _about_edges(
            border_edges(edges_left),
            edges_left,
            "is on an open border",
            "are on open borders",
            "An open part is inflated if its border is pinned, and carried along otherwise; it cannot hold gas.",
        ),
        _about_edges(
            non_manifold_edges(edges),
            edges,
            "has more than two faces",
            "have more than two faces",
            "A pressure acts on faces between inside and outside, not on walls or fins; such a mesh cannot hold gas.",
        ),
        _about_opposite_winding(distinct, edges),
        _about_inward_components(distinct, edges, kept),
        _about_components(distinct, edges, kept, parts),
    ]
    return [sentence for sentence in sentences if sentence]


def _duplicates(mesh: PolygonMesh, kept: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the faces of three different corners or more that are not kept."""
    corners = np.bincount(corner_faces(mesh), minlength=mesh.face_count)
    corners -= np.bincount(corner_faces(mesh)[repeated_corners(mesh)], minlength=mesh.face_count)
    return np.setdiff1d(np.flatnonzero(corners >= 3), kept)


def _faces_without_area(mesh: PolygonMesh) -> NDArray[np.int64]:
    corners = mesh.points[mesh.face_vertex_indices]
    lengths = np.linalg.norm(corners[next_corners(mesh)] - corners, axis=1)
    longest = np.maximum.reduceat(lengths, face_starts(mesh))
    return np.flatnonzero(face_areas(mesh) <= NO_AREA * longest**2)


def _about_coincident_vertices(mesh: PolygonMesh) -> str | None:
    used = np.unique(mesh.face_vertex_indices)
    first = used[first_coincident(mesh.points[used])]
    later = np.flatnonzero(first != used)
    if len(later):
        vertex, place = used[later[0]] + 1, first[later[0]] + 1
        where = f"is vertex {vertex}, at the place of vertex {place}"
        policy = "They are separate particles; --weld merges them."
        return _sentence(len(later), "vertex", "lies exactly on another", "lie exactly on others", where, policy)


def _about_opposite_winding(mesh: PolygonMesh, edges: MeshEdges) -> str | None:
    found = _turned_edges(edges)
    if not len(found):
        return None
    left = _turned_edges(mesh_edges(wound_alike(mesh)))
    policy = (
        "The surface is not orientable, like a Moebius strip: it has no inside, and is carried along."
        if len(left)
        else "Faces are flipped until all wind alike."
    )
    return _about_edges(found, edges, "joins faces of opposite winding", "join faces of opposite winding", policy)


def _turned_edges(edges: MeshEdges) -> NDArray[np.int64]:
    """Return the edges of two faces that run the same way along it."""
    found = inconsistent_edges(edges)
    return found[edges.face_counts[found] == 2]


def _about_inward_components(mesh: PolygonMesh, edges: MeshEdges, kept: NDArray[np.int64]) -> str | None:
    inward = np.flatnonzero(inward_faces(mesh, edges))
    if len(inward):
        count = len(np.unique(_face_components(mesh, edges)[inward]))
        policy = "Such a component is flipped outward."
        return _sentence(
            count, "closed component", "winds inward", "wind inward", f"has face {kept[inward[0]] + 1}", policy
        )


def _about_components(
    mesh: PolygonMesh, edges: MeshEdges, kept: NDArray[np.int64], parts: Literal["held", "free"]
) -> str | None:
    component = _face_components(mesh, edges)
    count = len(np.unique(component))
    if count > 1:
        apart = kept[int((component != component[0]).argmax())] + 1
        became = (
            'are tied together by springs; parts = "free" lets them separate'
            if parts == "held"
            else "are inflated as one balloon, and free to separate"
        )
        return f"{count:,} separate parts (the second starts at face {apart}) {became}."


def _face_components(mesh: PolygonMesh, edges: MeshEdges) -> NDArray[np.int64]:
    return vertex_components(mesh, edges)[mesh.face_vertex_indices[face_starts(mesh)]]


def _about_faces(found: NDArray[np.int64], one: str, many: str, policy: str) -> str | None:
    if len(found):
        return _sentence(len(found), "face", one, many, f"is face {found[0] + 1}", policy)


def _about_vertices(found: NDArray[np.integer], one: str, many: str, policy: str) -> str | None:
    if len(found):
        return _sentence(len(found), "vertex", one, many, f"is vertex {found[0] + 1}", policy)


def _about_edges(found: NDArray[np.int64], edges: MeshEdges, one: str, many: str, policy: str) -> str | None:
    if len(found):
        low, high = edges.ends[found[0]] + 1
        return _sentence(len(found), "edge", one, many, f"goes from vertex {low} to {high}", policy)


def _sentence(count: int, noun: str, one: str, many: str, predicate: str, policy: str) -> str:
    if count == 1:
        return f"1 {noun} {one}; it {predicate}, counting from 1. {policy}"
    plural = "vertices" if noun == "vertex" else f"{noun}s"
    return f"{count:,} {plural} {many}; the first {predicate}, counting from 1. {policy}"

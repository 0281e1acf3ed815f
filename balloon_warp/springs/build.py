"""Springs, hinges and triangles of membranes from a mesh's faces, by the paper's rules.

Springs from a mesh's faces, by the rules of the paper's section on spring generation; hinges and colors.

With the pairs of particles as sets, the rules read:

    structural  edges of faces
    shear       pairs in one face, without the structural ones
    flexion     pairs among the structural neighbors of one particle, without the structural and shear ones
"""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.crossings import LARGEST_FACE, LARGEST_FAN
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import corner_faces, face_starts, mesh_edges, next_corners
from balloon_warp.system.api import checked

MOST_FANS = 6
"""Largest number of fans that cover a face of more corners"""
LEAST_AREA = 1.0e-6
"""Least area of a triangle over its squared longest edge; smaller ones are left out"""


@dataclass(frozen=True)
class Membrane:
    """Triangles that together cover each face once, with its whole thickness."""

    corners: NDArray[np.int64]
    """Corners, shape (T, 3)"""
    areas: NDArray[np.float64]
    """Rest areas, times the triangle's share in covering the face [m^2], shape (T,)"""
    edges: NDArray[np.float64]
    """Rest edges from the first corner to the others [m], shape (T, 2, 3)"""
    faces: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Face that each covers a part of, shape (T,)"""
    cut: float = 0.0
    """Part by which rest edges are shorter than those of the mesh; areas, and so mass, are not smaller"""

    @property
    def count(self) -> int:
        """Number of triangles."""
        return len(self.corners)

    def turned(self, turns: int) -> "Membrane":
        """Return the triangles with another corner first."""
        ends = np.concatenate([np.zeros((self.count, 1, 3)), self.edges], axis=1)
        ends = np.roll(ends, -turns, axis=1)
        return Membrane(np.roll(self.corners, -turns, axis=1), self.areas, ends[:, 1:] - ends[:, :1])

    @property
    def rests(self) -> NDArray[np.float64]:
        """Components 11, 12 and 22 of the inverse rest metric [1/m^2], and the area [m^2], shape (T, 4)."""
        first, second = self.edges[:, 0], self.edges[:, 1]
        squares, product = ((first**2).sum(axis=1), (second**2).sum(axis=1)), (first * second).sum(axis=1)
        determinant = (np.cross(first, second) ** 2).sum(axis=1)
        return np.stack(
            [squares[1] / determinant, -product / determinant, squares[0] / determinant, self.areas], axis=1
        )

    def cut_by(self, part: float) -> "Membrane":
        """Return the triangles with rest edges that are shorter by a part than those of the mesh."""
        return replace(self, edges=self.edges * ((1.0 - part) / (1.0 - self.cut)), cut=part)

    def part(self, rows: NDArray[np.integer]) -> "Membrane":
        """Return some of the triangles."""
        faces = self.faces[rows] if len(self.faces) else self.faces
        return Membrane(self.corners[rows], self.areas[rows], self.edges[rows], faces)

    @property
    def quad_rows(self) -> NDArray[np.int64]:
        """Rows of the triangles of those quads that have all four, shape (Q, 4).

        They are (a, b, c), (a, b, d), (a, c, d) and (b, c, d).
        """
        first, second, third, fourth = (self.corners[k : self.count - 3 + k] for k in range(4))
        a, b, c, d = first[:, 0], first[:, 1], first[:, 2], second[:, 2]
        matches = np.ones(len(first), dtype=bool)
        for triangle, corners in ((second, (a, b, d)), (third, (a, c, d)), (fourth, (b, c, d))):
            matches &= (triangle == np.stack(corners, axis=1)).all(axis=1)
        begins: list[int] = []
        for row in np.flatnonzero(matches).tolist():  # those of polygons may overlap
            if not begins or row >= begins[-1] + 4:
                begins.append(row)
        return np.array(begins, dtype=np.int64).reshape(-1, 1) + np.arange(4)

    @property
    def laplacian(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Pairs of particles, shape (3 T, 2), and their cotangent weights, shape (3 T,).

        Weights are half cotangents times the share of the triangle: the squared gradient of a function linear in each
        triangle, over its area, is the sum of the squared differences times these.
        """
        g11, g12, g22, area = self.rests.T
        between = np.stack([g11 + g12, g22 + g12, -g12], axis=1) * area[:, None]
        pairs = self.corners[:, [[0, 1], [0, 2], [1, 2]]]
        return pairs.reshape(-1, 2), between.ravel()

    def stretches(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the larger principal stretch of each triangle where its corners are at these points, shape (T,)."""
        places = np.asarray(points, dtype=np.float64)[self.corners]
        edges = places[:, 1:] - places[:, :1]
        g11, g12, g22, _ = self.rests.T
        m11, m12, m22 = (np.einsum("ij,ij->i", edges[:, k], edges[:, m]) for k, m in ((0, 0), (0, 1), (1, 1)))
        first, second = g11 * m11 + g12 * m12, g12 * m12 + g22 * m22
        across = (g11 * m12 + g12 * m22) * (g12 * m11 + g22 * m12)
        spread = np.sqrt(np.maximum((first - second) ** 2 + 4.0 * across, 0.0))
        return np.sqrt(0.5 * (first + second + spread))

    def lumped_areas(self, count: int) -> NDArray[np.float64]:
        """Return the area that falls to each of so many particles [m^2]."""
        lumped_areas = np.zeros(count)
        np.add.at(lumped_areas, self.corners, self.areas[:, None] / 3.0)
        return lumped_areas


def no_membrane() -> Membrane:
    """Return an empty membrane."""
    return Membrane(np.zeros((0, 3), dtype=np.int64), np.zeros(0), np.zeros((0, 2, 3)))


def build_membrane(mesh: PolygonMesh) -> Membrane:
    """Return the membrane of a mesh: each face is the mean of its fans of triangles, one from each corner.

    A quad has so its four corner triangles, each by half; a face of many corners has fans from a few.

    A face of two corners has none, and neither has one no wider than a line.
    """
    starts, corners, parts = face_starts(mesh), [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0)]
    faces = [np.zeros(0, dtype=np.int64)]
    for size in np.unique(mesh.face_vertex_counts[mesh.face_vertex_counts > 2]).tolist():
        places, weights = _fans(size)
        firsts = starts[mesh.face_vertex_counts == size]
        of_faces = mesh.face_vertex_indices[firsts[:, None, None] + places].astype(np.int64)
        corners.append(of_faces.reshape(-1, 3))
        parts.append(np.tile(weights, len(firsts)))
        faces.append(np.repeat(np.flatnonzero(mesh.face_vertex_counts == size), len(weights)))
    triangles = np.concatenate(corners)
    points = mesh.points[triangles]
    edges = points[:, 1:] - points[:, :1]
    double_areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    longest = np.maximum((edges**2).sum(axis=2).max(axis=1), ((edges[:, 1] - edges[:, 0]) ** 2).sum(axis=1))
    wide = 0.5 * double_areas > LEAST_AREA * longest
    areas = 0.5 * double_areas * np.concatenate(parts)
    return Membrane(triangles[wide], areas[wide], edges[wide], np.concatenate(faces)[wide])


def _fans(size: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the triangles of a face's fans, each once, shape (T, 3), and the fraction of the fans that have it.

    Triangles are given by the places of their corners in the face.
    """
    tips = np.unique(np.linspace(0, size, min(size, MOST_FANS), endpoint=False).astype(np.int64))
    found = [sorted((tip, (tip + k) % size, (tip + k + 1) % size)) for tip in tips.tolist() for k in range(1, size - 1)]
    places, counts = np.unique(np.array(found), axis=0, return_counts=True)
    return places, counts / len(tips)


def color_springs(pairs: NDArray[np.integer], places: NDArray[np.floating]) -> NDArray[np.int64]:
    """Return each spring's color, shape (spring_count,): the lowest that no spring before it has at its ends.

    Springs are taken in the order of the places of their ends, so that the colors depend neither on the order that they
    are given in nor on how particles are numbered, unless particles coincide. At most 2 n - 1 colors come up where a
    particle has at most n springs.

    Args:
        pairs: the particles at the ends, shape (spring_count, 2), each pair once.
        places: of all particles, shape (particle_count, 3).
    """
    ranks = np.empty(len(places), dtype=np.int64)
    ranks[np.lexsort(places.T)] = np.arange(len(places))
    low, high = np.sort(ranks[pairs], axis=1).T
    colors = np.zeros(len(pairs), dtype=np.int64)
    taken = [0] * len(places)  # of each particle, a bit for each color
    for spring in np.lexsort([high, low]).tolist():
        p, q = int(low[spring]), int(high[spring])
        both = taken[p] | taken[q]
        free = ~both & (both + 1)
        colors[spring] = free.bit_length() - 1
        taken[p] |= free
        taken[q] |= free
    return colors


@dataclass(frozen=True)
class Hinges:
    """Hinges: the edges of exactly two faces.

    A face's wing is its corners beside the edge; their mean represents the face.
    """

    ends: NDArray[np.int64]
    """Particles of each edge, the lower first, shape (hinge_count, 2)"""
    wing_offsets: NDArray[np.int64]
    """Begin of hinge n's wings at entries 2 n and 2 n + 1, shape (2 hinge_count + 1,)"""
    wing_particles: NDArray[np.int64]
    """Corners of all wings"""

    @property
    def count(self) -> int:
        return len(self.ends)

    @property
    def wing_sizes(self) -> NDArray[np.int64]:
        """Number of corners of each wing, shape (hinge_count, 2)."""
        return np.diff(self.wing_offsets).reshape(-1, 2)

    def arms(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return the edge, and from its first end the first and the second wing, each of shape (hinge_count, 3)."""
        sums = np.add.reduceat(points[self.wing_particles], self.wing_offsets[:-1], axis=0).reshape(-1, 2, 3)
        wings = sums / self.wing_sizes[..., None] - points[self.ends[:, :1]]
        return points[self.ends[:, 1]] - points[self.ends[:, 0]], wings[:, 0], wings[:, 1]

    def angles(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angle from the first face's normal to the second's about each edge [rad], shape (hinge_count,)."""
        edge, first, second = self.arms(points)
        normals = np.cross(edge, first), np.cross(second, edge)
        lengths = np.linalg.norm(edge, axis=1)
        return np.arctan2((np.cross(*normals) * edge).sum(axis=1) / lengths, (normals[0] * normals[1]).sum(axis=1))

    def gradients(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradients of the angles by the edges' ends and the wings [rad/m], shape (hinge_count, 4)."""
        edge, *wings = self.arms(points)
        lengths = np.maximum(np.linalg.norm(edge, axis=1), 1e-12)
        of_wings, of_ends = [], np.zeros((self.count, 2, 3))
        for wing in wings:
            normal = np.cross(edge, wing)
            gradient = normal * (lengths / np.maximum((normal**2).sum(axis=1), 1e-20))[:, None]
            along = ((wing * edge).sum(axis=1) / lengths**2)[:, None]
            sign = 1.0 if not of_wings else -1.0  # the wings are on either side
            of_ends -= sign * np.stack([(1.0 - along) * gradient, along * gradient], axis=1)
            of_wings.append(np.linalg.norm(gradient, axis=1))
        return np.stack([*np.linalg.norm(of_ends, axis=2).T, *of_wings], axis=1)


def build_hinges(mesh: PolygonMesh) -> Hinges:
    """Return the hinges of a mesh, in the order of their ends; none at borders and where more than two faces meet."""
    edges, starts, faces = mesh_edges(mesh), face_starts(mesh), corner_faces(mesh)
    ends, wings = [], []
    for edge in np.flatnonzero(edges.face_counts == 2).tolist():
        pair = edges.ends[edge]
        both = [
            mesh.face_vertex_indices[starts[face] : starts[face] + mesh.face_vertex_counts[face]]
            for face in faces[edges.corners[edges.starts[edge] : edges.starts[edge] + 2]].tolist()
        ]
        beside = [corners[(corners != pair[0]) & (corners != pair[1])] for corners in both]
        if len(beside[0]) and len(beside[1]):
            ends.append(pair)
            wings.extend(beside)
    sizes = [len(wing) for wing in wings]
    return Hinges(
        ends=np.array(ends, dtype=np.int64).reshape(-1, 2),
        wing_offsets=np.cumsum([0, *sizes]),
        wing_particles=np.concatenate([np.zeros(0, dtype=np.int64), *wings]).astype(np.int64),
    )


class SpringKind(IntEnum):
    """Deformation that a spring resists (paper, figure 3)."""

    STRUCTURAL = 0
    """Stretch: along an edge of a face"""
    SHEAR = 1
    """Shear: across a face"""
    FLEXION = 2
    """Bending: past one particle between its ends"""


@dataclass(frozen=True)
class Springs:
    """Springs of a mesh, sorted by kind and then by their ends."""

    pairs: NDArray[np.int32]
    """Particles at the ends, the lower first, shape (spring_count, 2)"""
    kind: NDArray[np.int32]
    """Kind, a `SpringKind`, shape (spring_count,)"""
    rest_lengths: NDArray[np.float64]
    """Rest lengths in the unit of the mesh's points, shape (spring_count,)"""

    def of_kinds(self, kinds: Collection[SpringKind]) -> "Springs":
        """Return the springs of some kinds."""
        kept = np.isin(self.kind, [int(kind) for kind in kinds])
        return Springs(self.pairs[kept], self.kind[kept], self.rest_lengths[kept])

    def resting_at(self, points: NDArray[np.float64]) -> "Springs":
        """Return the springs at rest where particles are at these points, shape (particle_count, 3)."""
        lengths = np.linalg.norm(points[self.pairs[:, 1]] - points[self.pairs[:, 0]], axis=1)
        return Springs(self.pairs, self.kind, lengths)

    def with_structural(self, pairs: NDArray[np.integer], points: NDArray[np.float64]) -> "Springs":
        """Return the springs with structural ones between more particles, at rest at their distance.

        Pairs that have springs already keep those.

        Args:
            pairs: Pairs, the lower particle first, each once, shape (n, 2).
            points: Points of the particles, shape (particle_count, 3).
        """
        pairs = pairs[~self.has(pairs)]
        if not len(pairs):
            return self
        all_pairs = np.concatenate([self.pairs, pairs.astype(np.int32)])
        kind = np.concatenate([self.kind, np.full(len(pairs), SpringKind.STRUCTURAL, dtype=np.int32)])
        lengths = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
        order = np.lexsort((all_pairs[:, 1], all_pairs[:, 0], kind))
        return Springs(all_pairs[order], kind[order], np.concatenate([self.rest_lengths, lengths])[order])

    def has(self, pairs: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return whether a spring joins each of these pairs of particles, the lower first; shape (n,)."""
        return np.isin(_pair_keys(pairs), _pair_keys(self.pairs))

    @property
    def count(self) -> int:
        return len(self.pairs)

    @property
    def structural_count(self) -> int:
        return int(np.count_nonzero(self.kind == SpringKind.STRUCTURAL))

    @property
    def shear_count(self) -> int:
        return int(np.count_nonzero(self.kind == SpringKind.SHEAR))

    @property
    def flexion_count(self) -> int:
        return int(np.count_nonzero(self.kind == SpringKind.FLEXION))


def _pair_keys(pairs: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return a number for each pair."""
    return (pairs[:, 0].astype(np.int64) << 32) + pairs[:, 1]


# Pairs that a mesh may have at all: a gigabyte or two while they are sorted.
LARGEST_PAIR_COUNT = 1 << 24
# Pairs worked on at once, which bounds the memory.
CHUNK_PAIRS = 1 << 22


@checked
def build_springs(mesh: PolygonMesh) -> Springs:
    """Build the springs of a mesh with any valence, face size, borders and non-manifold edges.

    They are structural, shear and flexion springs.

    Each pair of particles has at most one spring. Its kind is the first of the three, in that order, whose rule it
    fits. Where a particle has more than `LARGEST_FAN` neighbors, a flexion spring joins each neighbor with the one
    half-way around only.

    Raises:
        InputError: a face has more than `LARGEST_FACE` corners, or all together have more than `LARGEST_PAIR_COUNT`
            pairs.
    """
    count = mesh.vertex_count
    _check_sizes(mesh)
    corners = mesh.face_vertex_indices.astype(np.int64)

    structural = np.unique(_keys(corners, corners[next_corners(mesh)], count))
    shear = _without(_pairs_in_groups(corners, mesh.face_vertex_counts, count), structural)

    low, high = np.divmod(structural, count)
    neighbors = np.concatenate([high, low])[np.argsort(np.concatenate([low, high]), kind="stable")]
    valences = np.bincount(np.concatenate([low, high]), minlength=count)
    _check_pair_count(valences[valences <= LARGEST_FAN], mesh, "pairs of neighbors of its particles")
    past_one = _pairs_past_particles(neighbors, valences, count)
    flexion = _without(_without(past_one, structural), shear)

    by_kind = {SpringKind.STRUCTURAL: structural, SpringKind.SHEAR: shear, SpringKind.FLEXION: flexion}
    pairs = np.stack(np.divmod(np.concatenate(list(by_kind.values())), max(count, 1)), axis=1)
    return Springs(
        pairs=pairs.astype(np.int32),
        kind=np.repeat(np.array(list(by_kind), dtype=np.int32), [len(keys) for keys in by_kind.values()]),
        rest_lengths=np.linalg.norm(mesh.points[pairs[:, 1]] - mesh.points[pairs[:, 0]], axis=1),
    )


def _keys(first: NDArray[np.int64], second: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Give a number to each pair of different particles, the same in both orders: low * count + high."""
    keys = np.minimum(first, second) * count + np.maximum(first, second)
    return keys[first != second]


def _pairs_in_groups(members: NDArray[np.int64], sizes: NDArray, count: int) -> NDArray[np.int64]:
    """Return the sorted keys of the pairs of particles that stand together in a group.

    Args:
        members: particles of all groups in order, shape (sizes.sum(),).
        sizes: members of each group, shape (group_count,).
        count: particle count.
    """
    starts = np.cumsum(sizes) - sizes
    found = [np.zeros(0, dtype=np.int64)]
    for size in np.unique(sizes[sizes > 1]):
        first, second = np.triu_indices(size, k=1)
        groups = starts[sizes == size]
        rows = max(CHUNK_PAIRS // len(first), 1)
        for begin in range(0, len(groups), rows):
            table = members[groups[begin : begin + rows, None] + np.arange(size)]
            found.append(np.unique(_keys(table[:, first].ravel(), table[:, second].ravel(), count)))
    return np.unique(np.concatenate(found))


def _pairs_past_particles(neighbors: NDArray[np.int64], valences: NDArray, count: int) -> NDArray[np.int64]:
    """Find the sorted keys of the pairs that flexion springs may join.

    They are all neighbors of a particle, or, where they are too many, each with the one half-way around.
    """
    is_hub = valences > LARGEST_FAN
    at_hub = np.repeat(is_hub, valences)
    across = [np.zeros(0, dtype=np.int64)]
    for rim in np.split(neighbors[at_hub], np.cumsum(valences[is_hub]))[:-1]:
        across.append(_keys(rim, np.roll(rim, -(len(rim) // 2)), count))
    return np.unique(np.concatenate([_pairs_in_groups(neighbors[~at_hub], valences[~is_hub], count), *across]))


def _without(keys: NDArray[np.int64], taken: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.setdiff1d(keys, taken, assume_unique=True)


def _check_sizes(mesh: PolygonMesh) -> None:
    sizes = mesh.face_vertex_counts.astype(np.int64)
    if len(sizes) and sizes.max() > LARGEST_FACE:
        raise InputError(
            f"face {int(sizes.argmax()) + 1} (counted from 1) has {sizes.max():,} corners; "
            f"springs can be made for at most {LARGEST_FACE:,}"
        )
    _check_pair_count(sizes, mesh, "pairs of corners in its faces")


def _check_pair_count(sizes: NDArray, mesh: PolygonMesh, pairs: str) -> None:
    found = int((sizes * (sizes - 1) // 2).sum())
    if found > LARGEST_PAIR_COUNT:
        raise InputError(f"{mesh.name}: has {found:,} {pairs}; springs can be made for at most {LARGEST_PAIR_COUNT:,}")

"""Checks of a mesh from any kind of file; its objects, parts and images by name.

Crossings of a surface with itself, and limits on changes so that it has none.

Crossings of a surface with itself: edges that go through triangles with which they share no corner.

Where an edge meets a triangle at its rim, in its plane or at an end, signs of volumes do not tell. Such a place crosses
if it does so however slightly all points are moved: outward or inward, which parts faces that only touch, and a little
at random, which undoes symmetries (as in Edelsbrunner and Muecke 1990).
"""

import hashlib
import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError, did_you_mean
from balloon_warp.mesh.polygon_mesh import Look, Picture, PolygonMesh
from balloon_warp.mesh.topology import (
    border_edges,
    component_labels,
    corner_faces,
    face_areas,
    face_starts,
    first_coincident,
    mesh_edges,
    triangulate,
    vertex_components,
    with_corners,
)

MOST_NAMED = 5
"""Largest number of names in a sentence"""


class Objects:
    """The objects that are taken of a file, by name; all of it where none is named.

    A name may be a path, as of prims: /Room/Wall is an object Wall within Room.
    """

    def __init__(self, named: str | Sequence[str] | None):
        names = [named] if isinstance(named, str) else [*(named or ())]
        self._wanted = {name: tuple(word for word in name.split("/") if word) or (name,) for name in names}
        self._found = set[str]()
        self._known: dict[str, None] = {}

    @property
    def name(self) -> str:
        """Name of the only object that is taken, "" if there are several, or all."""
        only = [words[-1] for words in self._wanted.values()]
        return only[0] if len(only) == 1 else ""

    def takes(self, path: Iterable[str]) -> bool:
        """Return whether an object is taken: it is one of them, or is within one.

        Args:
            path: names of the objects around it, from the outside, and its own.
        """
        whole = [name for name in path if name]
        self._known.update(dict.fromkeys(reversed(whole)))
        hits = [name for name, words in self._wanted.items() if _holds(whole, name, words)]
        self._found.update(hits)
        return bool(hits) or not self._wanted

    def check(self, path: Path) -> None:
        """Make sure that all were found, once all objects of the file have been asked for.

        Raises:
            InputError: one was not; it names those that there are.
        """
        for name in self._wanted:
            if name not in self._found:
                known = [*self._known]
                more = f" and {len(known) - MOST_NAMED} more" if len(known) > MOST_NAMED else ""
                has = f"it has {', '.join(known[:MOST_NAMED])}{more}" if known else "nothing in it has a name"
                raise InputError(f"{path}: has no object {name} ({has}){did_you_mean(name.strip('/'), known)}")


def _holds(path: list[str], name: str, words: tuple[str, ...]) -> bool:
    """Return whether a name, or the words of its path in a row, are in another path."""
    return name in path or any(tuple(path[at : at + len(words)]) == words for at in range(len(path)))


Taken = Literal["all", "closed", "largest"]


def parts_taken(mesh: PolygonMesh, taken: Taken, source: object) -> tuple[NDArray[np.bool_], str | None]:
    """Return the vertices of the parts that are taken, shape (vertex_count,), and a sentence about those that are not.

    Args:
        taken: all parts, which share no vertex; those without a border; or the one of the largest area.
        source: where the mesh is from.

    Raises:
        InputError: none is closed; it names `source`.
    """
    edges = mesh_edges(mesh)
    component = vertex_components(mesh, edges)
    of_faces = component[mesh.face_vertex_indices[face_starts(mesh)]]
    parts = np.unique(of_faces)
    if taken == "all":
        kept = parts
    elif taken == "largest":
        kept = parts[[np.bincount(of_faces, face_areas(mesh), mesh.vertex_count)[parts].argmax()]]
    else:
        kept = np.setdiff1d(parts, component[edges.ends[border_edges(edges), 0]])
        if not len(kept):
            open_ = "its part is" if len(parts) == 1 else f"all of its {len(parts):,} parts are"
            raise InputError(
                f'{source}: has no closed part, {open_} open; expected taken = "all" or "largest", or a mesh that '
                "`balloon-warp remesh` made"
            )
    left = len(parts) - len(kept)
    if not left:
        return np.ones(mesh.vertex_count, dtype=bool), None
    faces = np.count_nonzero(~np.isin(of_faces, kept))
    which = "are open" if taken == "closed" else "are smaller than the largest"
    which = which.replace("are", "is") if left == 1 else which
    sentence = f"{left:,} of {len(parts):,} parts, of {faces:,} faces, {'is' if left == 1 else 'are'} left out: "
    return np.isin(component, kept), f"{sentence}{'it' if left == 1 else 'they'} {which}."


def of_vertices(mesh: PolygonMesh, kept: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh with the faces of some vertices alone, by a mask; its vertices keep their numbers."""
    if kept.all():
        return mesh
    return _with_faces(mesh, kept[mesh.face_vertex_indices[face_starts(mesh)]])


def of_faces(mesh: PolygonMesh, faces: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh with some of its faces alone, by a mask, and the vertices and groups that they have."""
    taken = _with_faces(mesh, faces)
    used, indices = np.unique(taken.face_vertex_indices, return_inverse=True)
    groups = {name: np.flatnonzero(np.isin(used, own)).astype(np.int32) for name, own in mesh.groups.items()}
    return replace(
        taken,
        points=mesh.points[used],
        face_vertex_indices=indices.ravel().astype(np.int32),
        groups={name: own for name, own in groups.items() if len(own)},
    )


def _with_faces(mesh: PolygonMesh, faces: NDArray[np.bool_]) -> PolygonMesh:
    return replace(with_corners(mesh, faces[corner_faces(mesh)]), face_vertex_counts=mesh.face_vertex_counts[faces])


LARGEST_FILE = 1 << 28
"""Largest size of an image [bytes]"""
KEPT = {"PNG": ".png", "JPEG": ".jpg"}
"""Suffixes of images that stay as they are, by their format; others become PNG"""


class Pictures:
    """Cache of the images that a mesh names, each read once."""

    def __init__(self, source: Path | str):
        self._source = source
        self._read: dict[str, Picture | None] = {}
        self.warnings: list[str] = []
        """Warnings, one for each image that cannot be read or placed"""

    def of_file(self, named: str, folder: Path) -> Picture | None:
        """Read the image of a file.

        Args:
            named: as a mesh names it: from its folder, or, where there is none, its bare name there.
            folder: of the mesh.
        """
        path = beside(folder, named)
        if path is None:
            return self._missing(named)
        if path.stat().st_size > LARGEST_FILE:
            return self.of_bytes(named, b"")
        try:
            return self.of_bytes(named, path.read_bytes(), path)
        except OSError:
            return self.of_bytes(named, b"")

    def of_bytes(self, named: str, data: bytes | None, file: Path | None = None) -> Picture | None:
        """Read the image of a file's content.

        Args:
            data: None where there is no such file.
            file: that it is of, if it is one of its own.
        """
        if data is None:
            return self._missing(named)
        if named not in self._read:
            self._read[named] = _picture(named, data, file)
            if self._read[named] is None:
                self.warnings.append(f"{self._source}: its texture {named} cannot be read as an image; it is left out.")
        return self._read[named]

    def mean_of(self, look: Look, named: str) -> Look:
        """Return a look with the mean color of its image, where the mesh does not say how the image lies on it."""
        if look.picture is None:
            return look
        sentence = f"{self._source}: its texture {named} has no coordinates on the mesh; its mean color is taken."
        if sentence not in self.warnings:
            self.warnings.append(sentence)
        return look.plain

    def _missing(self, named: str) -> None:
        if named not in self._read:
            self._read[named] = None
            self.warnings.append(f"{self._source}: its texture {named} is missing; it is left out.")


def beside(folder: Path, named: str) -> Path | None:
    """Find the regular file of a name in a mesh, from the mesh's folder; else that of its bare name there."""
    for name in (named, named.replace("\\", "/"), PureWindowsPath(named).name, PurePosixPath(named).name):
        try:
            if name and (path := folder / name).is_file():
                return path
        except (OSError, ValueError):  # too long for a name, or with a zero in it
            continue
    return None


def _picture(named: str, data: bytes, file: Path | None) -> Picture | None:
    """Decode an image, or return None if it is none."""
    from PIL import Image, UnidentifiedImageError  # only for a mesh that has images

    try:
        with Image.open(io.BytesIO(data)) as image:
            suffix = KEPT.get(image.format or "")
            if suffix is None or image.mode not in ("RGB", "RGBA", "L", "P"):
                deep = image.mode.startswith("I")  # gray in 16 bits
                shown = image.convert("I").point(lambda value: value / 257).convert("L") if deep else image
                with io.BytesIO() as packed:
                    shown.convert("RGB").save(packed, "PNG")
                    suffix, data = KEPT["PNG"], packed.getvalue()
            else:
                image.load()  # to the end: a truncated one would fail once all is done
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError):
        return None
    bare = re.sub(r"[^0-9A-Za-z_-]+", "_", PurePosixPath(named.replace("\\", "/")).stem).strip("_")[:40] or "texture"
    mark = f"_{hashlib.sha256(data).hexdigest()[:8]}"
    return Picture(f"{bare.removesuffix(mark)}{mark}{suffix}", data, file)


FLOAT32_MAX = float(np.finfo(np.float32).max)
LARGEST_FACE = 4096
"""Largest number of corners of a face; the springs across it grow with their square"""
LARGEST_FAN = 256
"""Number of neighbors up to which a particle gets flexion springs between all of them; past one with more, as the hub
of a wheel, each neighbor gets one"""


def check_mesh(mesh: PolygonMesh, source: str, least_corners: int = 3) -> None:
    """Check that a mesh has points and faces, and that they fit together.

    Args:
        least_corners: of a face; with 2, a face may be an edge.

    Raises:
        InputError: names `source` and the first face or vertex, from 1, that is wrong.
    """
    if mesh.vertex_count == 0 or mesh.face_count == 0:
        raise InputError(f"{source}: has {mesh.vertex_count} vertices and {mesh.face_count} faces; expected both")
    outside = ~(np.abs(mesh.points) <= FLOAT32_MAX).all(axis=1)
    if outside.any():
        vertex = int(outside.argmax())
        raise InputError(
            f"{source}: vertex {vertex + 1}: coordinates must be finite and fit in 32-bit floats "
            f"(got {' '.join(map(str, mesh.points[vertex]))})"
        )
    if mesh.face_vertex_counts.min() < least_corners:
        face = int(mesh.face_vertex_counts.argmin())
        raise InputError(
            f"{source}: face {face + 1}: a face needs {'three' if least_corners == 3 else 'two'} corners or more "
            f"(got {mesh.face_vertex_counts[face]})"
        )
    if mesh.face_vertex_counts.max() > LARGEST_FACE:
        face = int(mesh.face_vertex_counts.argmax())
        raise InputError(
            f"{source}: face {face + 1}: a face may have at most {LARGEST_FACE:,} corners "
            f"(got {mesh.face_vertex_counts[face]:,})"
        )
    corner_count = int(mesh.face_vertex_counts.sum(dtype=np.int64))
    if corner_count != len(mesh.face_vertex_indices):
        raise InputError(
            f"{source}: the face sizes add up to {corner_count} corners, but {len(mesh.face_vertex_indices)} are given"
        )
    for index in (mesh.face_vertex_indices.min(), mesh.face_vertex_indices.max()):
        if not 0 <= index < mesh.vertex_count:
            raise InputError(f"{source}: a face refers to point {index}; expected 0 to {mesh.vertex_count - 1}")


Values = NDArray[np.float64]
Numbers = NDArray[np.int64]
MOVED, RANDOM = 1.0e-9, 0.3
"""Distance by which points are moved along their normals, over the size; and at random, over that distance"""
DRAWS = 16
"""Number of ways in which they are moved: half of them outward"""
CLEAR = 20.0
"""Volume from which on its sign is certain, over that of the move"""
ROWS = 4096
"""Number of triangles whose surroundings are looked at together, to bound the memory"""


class Crossings(NamedTuple):
    """Edges that go through triangles."""

    edges: Numbers
    """Ends of each edge, shape (n, 2)"""
    triangles: Numbers
    """Number of the triangle that it goes through, shape (n,)"""
    depths: Values
    """Distance of the nearer end from the plane of the triangle [m], shape (n,)"""
    places: Values
    """Position [m], shape (n, 3)"""


@dataclass(frozen=True)
class NearPairs:
    """Edges and triangles of a surface that are near each other, and share no corner."""

    surface: Numbers
    """Corners of its triangles, shape (t, 3)"""
    ends: Numbers
    """Ends of each edge, shape (n, 2)"""
    numbers: Numbers
    """Number of each triangle, shape (n,)"""

    @classmethod
    def of(cls, points: Values, triangles: NDArray[np.integer], moves: float = 0.0) -> "NearPairs":
        """Return the pairs that may cross once every vertex has moved by at most so much [m]; open seams are closed."""
        surface = _closed_seams(points, triangles.astype(np.int64))
        found = [(np.zeros((0, 2), np.int64), np.zeros(0, np.int64)), *_near(points, surface, 2.0 * moves)]
        return cls(surface, *(np.concatenate(parts) for parts in zip(*found, strict=True)))

    @property
    def corners(self) -> Numbers:
        """Corners of each triangle, shape (n, 3)."""
        return self.surface[self.numbers]

    def crossing(self, points: Values) -> NDArray[np.bool_]:
        """Return which pairs cross where the vertices are at these points, shape (n,)."""
        points = points - points.mean(axis=0)
        moved = MOVED * _size(points)
        crosses, doubtful = _goes_through(points, self.ends, self.corners, moved)
        rows = np.flatnonzero(doubtful)
        if len(rows):
            few = replace(self, ends=self.ends[rows], numbers=self.numbers[rows])
            crosses[rows] = few._however_moved(points, moved)
        return crosses

    def _however_moved(self, points: Values, moved: float) -> NDArray[np.bool_]:
        """Return which pairs are of places that cross, however the points are moved."""
        normals, random = _normals(points, self.surface), np.random.default_rng(0)
        sides = np.concatenate([self.ends, self.corners], axis=1)
        ever, draws = np.zeros(len(sides), dtype=bool), []
        for draw in range(DRAWS):
            shift = (-1.0) ** draw * normals + RANDOM * random.uniform(-1.0, 1.0, points.shape)
            draws.append(_goes_through(points + moved * shift, self.ends, self.corners, 0.0)[0])
            if not draws[-1].any():
                return draws[-1]
            ever |= draws[-1]
        linked = sides[ever]
        labels = component_labels(len(points), np.repeat(linked[:, 0], 4), linked[:, 1:].ravel())[sides[:, 0]]
        always = np.ones(len(points), dtype=bool)
        for crosses in draws:
            always &= np.bincount(labels[crosses], minlength=len(points)) > 0
        return draws[0] & always[labels]


def find_crossings(points: Values, triangles: NDArray[np.integer]) -> Crossings:
    """Return the edges of a surface that go through triangles with which they share no corner.

    Two triangles that cross have such an edge: of the one or of the other. Triangles that only touch do not cross.
    """
    pairs = NearPairs.of(points, triangles)
    crosses = pairs.crossing(points)
    edges, corners = pairs.ends[crosses], points[pairs.corners[crosses]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    begins, ends = (np.einsum("ij,ij->i", points[edges[:, end]] - corners[:, 0], normals) for end in (0, 1))
    parts = np.clip(begins / np.where(begins == ends, 1.0, begins - ends), 0.0, 1.0)[:, None]
    places = points[edges[:, 0]] + parts * (points[edges[:, 1]] - points[edges[:, 0]])
    return Crossings(edges, pairs.numbers[crosses], np.minimum(np.abs(begins), np.abs(ends)), places)


def crossings_of(mesh: PolygonMesh) -> Crossings:
    """Return the crossings of a mesh with itself, along whichever diagonal its quads are cut."""
    return find_crossings(mesh.points, both_cuts(mesh))


def crossings_sentence(mesh: PolygonMesh) -> str | None:
    """Return "crosses itself at 2 places", as the end of a sentence on a mesh; None if it does not."""
    count = len(crossings_of(mesh).edges)
    return f"crosses itself at {count:,} place{'s' if count > 1 else ''}" if count else None


def both_cuts(mesh: PolygonMesh) -> Numbers:
    """Return the triangles of a mesh, those of quads by either diagonal, shape (n, 3)."""
    firsts = face_starts(mesh)[mesh.face_vertex_counts == 4]
    others = [mesh.face_vertex_indices[firsts[:, None] + corners] for corners in ([1, 2, 3], [3, 0, 1])]
    return np.concatenate([triangulate(mesh)[0], *others]).astype(np.int64)


def _near(points: Values, surface: Numbers, room: float) -> Iterator[tuple[Numbers, Numbers]]:
    """Yield ends of edges and numbers of triangles whose boxes, wider by some room, overlap; without shared corners."""
    from scipy.spatial import KDTree  # takes long to load

    sides = np.sort(np.stack([surface, np.roll(surface, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    edges = np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0)
    if not len(edges):
        return
    room = room + 4.0 * MOVED * _size(points)
    low, high = (bound(points[edges], axis=1) for bound in (np.min, np.max))
    halves = 0.5 * np.linalg.norm(high - low, axis=1)
    corners, joint = points[surface], _joined_by_slivers(points, surface)
    lower, upper = corners.min(axis=1) - room, corners.max(axis=1) + room
    tree = KDTree(0.5 * (low + high))
    centers, radii = 0.5 * (lower + upper), 0.5 * np.linalg.norm(upper - lower, axis=1) + halves.max()
    for first in range(0, len(surface), ROWS):
        near = tree.query_ball_point(centers[first : first + ROWS], radii[first : first + ROWS], return_sorted=False)
        numbers = np.repeat(np.arange(first, first + len(near)), [len(each) for each in near])
        beside = np.fromiter(chain.from_iterable(near), np.int64, len(numbers))
        for begin, end, least, most in zip(low.T, high.T, lower.T, upper.T, strict=True):
            meet = (begin[beside] <= most[numbers]) & (end[beside] >= least[numbers])
            beside, numbers = beside[meet], numbers[meet]
        apart = (joint[edges[beside]][:, :, None] != joint[surface[numbers]][:, None, :]).all(axis=(1, 2))
        yield edges[beside[apart]], numbers[apart]


def _goes_through(
    points: Values, ends: Numbers, corners: Numbers, moved: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which edges go through their triangles, and for which that is in doubt.

    Args:
        moved: Distance by which points may be off [m].
    """
    (start, end), of_triangle = np.moveaxis(points[ends], 1, 0), points[corners]
    first, second, third = np.moveaxis(of_triangle, 1, 0)
    way, normals = end - start, np.cross(second - first, third - first)
    before, after = ((place - first) * normals for place in (start, end))
    begins, stops = before.sum(axis=1), after.sum(axis=1)
    arms = of_triangle - start[:, None]
    around = np.stack([(way * np.cross(arms[:, k], arms[:, (k + 1) % 3])).sum(axis=1) for k in range(3)])
    lengths = np.linalg.norm(way, axis=1) + np.linalg.norm(np.ptp(of_triangle, axis=1), axis=1)
    sure = CLEAR * moved * lengths**2
    least, most = np.minimum(begins, stops), np.maximum(begins, stops)
    lowest, highest = around.min(axis=0), around.max(axis=0)
    crosses = (least < -sure) & (most > sure) & ((lowest > sure) | (highest < -sure))
    misses = (least > sure) | (most < -sure) | ((lowest < -sure) & (highest > sure))
    return crosses, ~(crosses | misses)


def _normals(points: Values, surface: Numbers) -> Values:
    """Return the unit normals at vertices, shape (n, 3); zeros where there is none."""
    corners = points[surface]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.stack([np.bincount(surface.ravel(), np.repeat(area, 3), len(points)) for area in areas.T], axis=1)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.divide(sums, lengths, out=np.zeros_like(sums), where=lengths > 0.0)


def _joined_by_slivers(points: Values, surface: Numbers) -> Numbers:
    """Return the lowest number of the vertices that triangles of no area join with each, shape (n,).

    Such triangles stand between faces that meet along a line, cut finer on one side of it.
    """
    corners = points[surface]
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    slivers = surface[doubled <= CLEAR * MOVED * _size(points) * longest]
    return component_labels(len(points), np.repeat(slivers[:, 0], 2), slivers[:, 1:].ravel())


def _closed_seams(points: Values, surface: Numbers) -> Numbers:
    """Return the corners of triangles, those on open borders that coincide as one, shape (t, 3)."""
    sides = np.sort(np.stack([surface, np.roll(surface, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    ends, counts = np.unique(sides, axis=0, return_counts=True)
    border = np.unique(ends[counts == 1])
    same = np.arange(len(points))
    same[border] = border[first_coincident(points[border])]
    return same[surface]


def _size(points: Values) -> float:
    return float(np.ptp(points, axis=0).max()) if len(points) else 0.0


ROUNDS, LEFT = 8, 0.4
"""Number of times that changes are held back in part, and the fraction that each time leaves where it crosses"""
STOPPED = 8
"""Number of times more that they are stopped there"""
AROUND = 2
"""Number of rings of neighbors that are held back, too, ever less"""


def uncrossed(
    points: Values,
    triangles: NDArray[np.integer],
    moves: Values,
    together: Any,
    spoiled: Callable[[Values], Any] = lambda points: [],
) -> Values:
    """Return moves of a surface's vertices, less of them where it would cross itself, shape (n, 3).

    It may still cross itself after the last round.

    Args:
        points: of the vertices before they move, shape (n, 3).
        triangles: corners of the surface's triangles, shape (t, 3).
        together: Means over neighbors, shape (n, n).
        spoiled: Function that returns further vertices to be held back, where the vertices are at these points.
    """
    near = NearPairs.of(points, triangles, float(np.linalg.norm(moves, axis=1).max()))

    def wrong(points: Values) -> NDArray[np.int64]:
        crossing = near.crossing(points)
        further = np.asarray(spoiled(points), dtype=np.int64)
        return np.concatenate([near.ends[crossing].ravel(), near.corners[crossing].ravel(), further])

    return _held_back(points, moves, together, wrong)


def without_crossings(before: PolygonMesh, after: PolygonMesh) -> PolygonMesh:
    """Return a mesh whose vertices have moved, less of them where it would cross itself.

    Args:
        before: the same mesh, which does not cross itself, along whichever diagonal its quads are cut.
    """
    triangles, moves = both_cuts(before), after.points - before.points

    def wrong(points: Values) -> NDArray[np.int64]:
        found = find_crossings(points, triangles)
        return np.concatenate([found.edges.ravel(), triangles[found.triangles].ravel()])

    if not len(wrong(after.points)):
        return after
    return replace(after, points=before.points + _held_back(before.points, moves, means_over_neighbors(before), wrong))


def means_over_neighbors(mesh: PolygonMesh) -> Any:
    """Return the matrix of means over each vertex and its neighbors, shape (n, n)."""
    from scipy import sparse  # takes long to load

    ends, count = mesh_edges(mesh).ends, mesh.vertex_count
    both = np.concatenate([ends, ends[:, ::-1], np.stack([np.arange(count)] * 2, axis=1)])
    beside = sparse.coo_matrix((np.ones(len(both)), both.T), shape=(count, count)).tocsr()
    return sparse.diags(1.0 / np.asarray(beside.sum(axis=1)).ravel()) @ beside


def _held_back(points: Values, moves: Values, together: Any, wrong: Callable[[Values], NDArray[np.int64]]) -> Values:
    """Return moves, less of them around the vertices that are wrong at the points reached."""
    for number in range(ROUNDS + STOPPED):
        vertices = wrong(points + moves)
        if not len(vertices):
            break
        held = np.zeros(len(points))
        held[vertices] = 1.0
        left = LEFT if number < ROUNDS else 0.0
        for _ in range(AROUND):
            held = np.maximum(held, np.minimum(1.0, 2.0 * (together @ held)))
        moves = moves * (1.0 - (1.0 - left) * held)[:, None]
    return moves

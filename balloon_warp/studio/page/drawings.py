"""Drawings of a model in a page: geometry, colors, and a camera that goes along."""

import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_matrix, csr_matrix, vstack

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import triangulate, vertex_normals
from balloon_warp.model import Model
from balloon_warp.model.starts import ANCHORED, anchors_of
from balloon_warp.scene import Scene
from balloon_warp.scene import around as palette
from balloon_warp.scene.around import BODY_COLORS, OBSTACLE_COLOR, SPHERE_COLORS, mean_color
from balloon_warp.studio.page.session import Picture
from balloon_warp.usd.balloon import string_curve
from balloon_warp.usd.solids import PLANES, SIZES, Knot, has_knot, knot_mesh, knot_size

Color = tuple[int, int, int]
SPRINGS: dict[str, Color] = {"structural": (20, 20, 20), "shear": (30, 80, 220), "flexion": (20, 150, 60)}
"""Black, blue and green of the paper (figure 3)"""
WIRE: Color = (60, 30, 30)
NORMALS: Color = (230, 140, 20)
FORCES: Color = (0, 130, 70)
CONTACTS: Color = (30, 30, 45)
STRING: Color = (95, 75, 60)
HAND: Color = (250, 200, 40)
GROUND: Color = (228, 222, 212)
GRID: Color = (214, 207, 196)
PAPER: Color = (255, 255, 255)
"""Color below a print"""
BRAND: Color = (200, 40, 36)
STRAIN_BOUNDS = (0.85, 0.97, 1.03, 1.15, 1.4, 1.8)
"""Bounds of the color bands, length over rest length"""
STRAIN: tuple[Color, ...] = (
    (35, 40, 140),
    (60, 110, 210),
    (205, 215, 220),
    (255, 205, 70),
    (245, 135, 30),
    (215, 45, 30),
    (110, 0, 30),
)


def balloon_color(scene: Scene, number: int, mesh: PolygonMesh) -> Color:
    """Return a balloon's color as in the stage; a single one for a mesh with several colors."""
    return _encoded(mean_color(mesh, scene.balloon[number], palette.balloon_color(scene, number)))


def sphere_color(number: int, own: tuple[float, float, float] | None) -> Color:
    """Return a sphere's color as in the stage: its own, or the palette's."""
    return _encoded(own or SPHERE_COLORS[number % len(SPHERE_COLORS)])


def obstacle_color(scene: Scene, number: int, mesh: PolygonMesh | None) -> Color:
    """Return an obstacle's color as in the stage: the scene's, the mesh's own, or gray."""
    said = scene.obstacle[number]
    return _encoded(said.color or mean_color(mesh, said, OBSTACLE_COLOR))


def body_color(scene: Scene, number: int, mesh: PolygonMesh | None) -> Color:
    """Return a body's color as in the stage: the scene's, the mesh's own, or the palette's."""
    said = scene.body[number]
    return _encoded(said.color or mean_color(mesh, said, BODY_COLORS[number % len(BODY_COLORS)]))


def water_color() -> Color:
    """Return the water's color as in the stage."""
    return _encoded(palette.WATER_COLOR)


def linear(color: Color) -> tuple[float, float, float]:
    """Return a color of the page as scenes have it, in linear RGB."""
    values = np.clip(np.asarray(color, float) / 255.0, 0.0, 1.0)
    r, g, b = (float(value) for value in np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4))
    return r, g, b


def _encoded(linear: tuple[float, float, float]) -> Color:
    values = np.asarray(linear)
    encoded = np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)
    r, g, b = (int(value) for value in np.clip(np.round(255 * encoded), 0, 255))
    return r, g, b


HELD_SECONDS = 0.4
"""Time for which a camera that a user turns is left alone [s], so that it is not pulled back"""
TURNED = 1e-3
"""Displacement of a camera over its distance from which on a user has turned it"""
AWAY = 1.1
"""Distance of a camera from its target, over the target's size: it fills most of the view"""
NARROW = 0.75
"""Width over height of a window in which a view that fills its height is as wide as it"""


class Follower:
    """The windows whose cameras follow."""

    def __init__(self) -> None:
        self._turn = threading.Lock()
        """Held by whoever reads or writes the windows: each key runs in a thread of its own, beside the drawing"""
        self._following: dict[int, tuple[NDArray[np.float64], float]] = {}
        """Vector to each window's camera from its target [m], and the time until which it is left alone"""

    def follows(self, window: Any) -> bool:
        """Return whether a window's camera follows."""
        return window.client_id in self._following

    def toggle(self, window: Any, center: NDArray[np.floating], distance: float) -> None:
        """Look at the balloons, shape (3,) [m], from a distance [m], and follow them; or stop, if it followed."""
        with self._turn:
            if self._following.pop(window.client_id, None) is not None:
                return
            away = _away(window)
            look_at(window, center, away * (distance / max(float(np.linalg.norm(away)), 1e-9)))
            self._following[window.client_id] = _away(window), 0.0

    def follow(self, windows: dict[int, Any], center: NDArray[np.floating]) -> None:
        """Move the cameras of windows along to where the balloons are, shape (3,) [m]; as somebody turned them."""
        now = time.monotonic()
        with self._turn:
            for number, (before, until) in list(self._following.items()):
                if number not in windows:
                    del self._following[number]
                    continue
                window = windows[number]
                away = _away(window)
                if np.linalg.norm(away - before) > TURNED * np.linalg.norm(before):
                    until = now + HELD_SECONDS
                self._following[number] = away, until
                if now >= until and np.isfinite(center).all():
                    look_at(window, center, away)


def look_at(window: Any, center: NDArray[np.floating], away: NDArray[np.floating]) -> None:
    """Turn a window's camera to a place, and put it so far away from it, shape (3,) each [m]."""
    with window.atomic():  # the place first: where it looks moves along with it
        window.camera.position = tuple((center + away).tolist())
        window.camera.look_at = tuple(center.tolist())


def go_home(camera: Any, position: NDArray[np.floating], middle: NDArray[np.floating]) -> None:
    """Move a camera to where it sees everything, farther away in a narrow window; shape (3,) each [m]."""
    width, height = getattr(camera, "image_width", 1), getattr(camera, "image_height", 1)
    away = (position - middle) * max(NARROW * height / max(width, 1), 1.0)
    camera.position, camera.look_at = tuple((middle + away).tolist()), tuple(middle.tolist())


def home_of(
    points: NDArray[np.floating], up: NDArray[np.floating], side: NDArray[np.floating]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return a camera's place to see points from a side and a little above, and its target; shape (3,) each."""
    low, high = points.min(axis=0), points.max(axis=0)
    center, size = (low + high) / 2, float((high - low).max())
    return center + AWAY * size * (side / np.linalg.norm(side)) + 0.4 * size * up, center


def _away(window: Any) -> NDArray[np.float64]:
    """Return the vector from a camera's target to the camera [m], shape (3,)."""
    return np.array(window.camera.position, float) - np.array(window.camera.look_at, float)


def hit_distance(
    origin: ArrayLike, direction: ArrayLike, points: NDArray[np.floating], triangles: NDArray[np.integer]
) -> float | None:
    """Return the distance along a ray to the nearest triangle (Moeller and Trumbore 1997), or None.

    Args:
        direction: Unit vector.
        points: Points, shape (point_count, 3).
        triangles: Corners, shape (triangle_count, 3).
    """
    origin, direction = np.asarray(origin, float), np.asarray(direction, float)
    a, b, c = (points[triangles[:, corner]].astype(np.float64) for corner in range(3))
    across = np.cross(direction, c - a)
    determinant = np.einsum("ij,ij->i", b - a, across)
    inverse = 1.0 / np.where(np.abs(determinant) < 1e-30, np.inf, determinant)
    u = np.einsum("ij,ij->i", origin - a, across) * inverse
    beside = np.cross(origin - a, b - a)
    v = beside @ direction * inverse
    distances = np.einsum("ij,ij->i", c - a, beside) * inverse
    hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distances > 0.0) & (inverse != 0.0)
    return float(distances[hit].min()) if hit.any() else None


def ground_distance(origin: ArrayLike, direction: ArrayLike, up: ArrayLike, height: float) -> float | None:
    """Return the distance along a ray to a level ground, or None if the ray does not meet it from above."""
    descent = -float(np.dot(direction, up))
    above = float(np.dot(origin, up)) - height
    return above / descent if descent > 1e-6 and above > 0.0 else None


def throw_at(target: ArrayLike, start: ArrayLike, speed: float, gravity: float, up: ArrayLike) -> NDArray[np.float64]:
    """Return the velocity [m/s] that brings a body from `start` to `target` in the time that `speed` takes there."""
    target, start, up = (np.asarray(each, float) for each in (target, start, up))
    seconds = max(float(np.linalg.norm(target - start)), 1e-9) / speed
    return (target - start) / seconds + 0.5 * gravity * seconds * up


def nearest_particle(points: NDArray[np.floating], place: NDArray[np.floating]) -> int:
    """Return the particle that is nearest to a place."""
    return int(np.argmin(((points - place) ** 2).sum(axis=1)))


Lines = NDArray[np.float32]
"""Line segments [m], shape (count, 2, 3)"""


class Drawing:
    """The parts of a model that do not change, and the lines and measures of a picture's points."""

    def __init__(self, model: Model):
        self.model = model
        self.triangles, self.triangle_faces = zip(*(triangulate(shape.mesh) for shape in model.shapes), strict=True)
        """Triangles of each balloon, and the face of each triangle"""
        self.all_triangles = np.concatenate(
            [part + offset for part, offset in zip(self.triangles, model.particle_offsets, strict=False)]
        )
        """Triangles of all balloons together"""
        springs = [shape.springs for shape in model.shapes]
        ends = [each.pairs + offset for each, offset in zip(springs, model.particle_offsets, strict=False)]
        rest_lengths = np.concatenate([each.rest_lengths for each in springs])
        self._ends = np.concatenate(ends)[rest_lengths > 0.0]
        self._rest_lengths = rest_lengths[rest_lengths > 0.0]

    def springs(self, picture: Picture, kind: str) -> Lines:
        """Return all springs of one kind."""
        number = list(SPRINGS).index(kind)
        parts = []
        for shape, points in zip(self.model.shapes, picture.frame.points, strict=True):
            parts.append(points[shape.springs.pairs[shape.springs.kind == number]])
        return np.concatenate(parts)

    def normals(self, picture: Picture, length: float) -> Lines:
        """Return the normals of all particles."""
        parts = []
        for shape, points in zip(self.model.shapes, picture.frame.points, strict=True):
            normals = vertex_normals(replace(shape.mesh, points=points.astype(np.float64)))
            parts.append(np.stack([points, points + length * normals], axis=1))
        return np.concatenate(parts).astype(np.float32)

    def net_forces(self, picture: Picture, length: float) -> Lines:
        """Return the net forces on all particles; the largest twentieth is drawn `length` long."""
        points, forces = np.concatenate(picture.frame.points), np.concatenate(picture.frame.net_forces)
        sizes = np.linalg.norm(forces, axis=1, keepdims=True)
        longest = max(float(np.percentile(sizes, 95.0)), 1e-12)
        return np.stack([points, points + forces * (length / np.maximum(sizes, longest))], axis=1).astype(np.float32)

    def strain_bands(self, picture: Picture, number: int) -> list[NDArray[np.int32]]:
        """Return the triangles of one balloon, in as many groups as there are bands of strain."""
        shape, points = self.model.shapes[number], picture.frame.points[number]
        structural = shape.springs.kind == 0
        pairs, rest = shape.springs.pairs[structural], shape.springs.rest_lengths[structural]
        stretch = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1) / np.maximum(rest, 1e-12)
        ends, twice = pairs.T.ravel(), np.tile(stretch, 2)
        if shape.membrane.count:
            ends, twice = shape.membrane.corners.ravel(), np.repeat(shape.membrane.stretches(points), 3)
        count = np.maximum(np.bincount(ends, minlength=len(points)), 1)
        of_particles = np.bincount(ends, twice, len(points)) / count
        band = np.digitize(of_particles[self.triangles[number]].mean(axis=1), STRAIN_BOUNDS)
        return [self.triangles[number][band == which] for which in range(len(STRAIN_BOUNDS) + 1)]

    def string_curves(self, picture: Picture) -> dict[int, NDArray[np.float32]]:
        """Return the points along the strings that are there [m], by their numbers."""
        model, points = self.model, np.concatenate(picture.frame.points)
        ground = picture.scene.ground.height if picture.scene.ground else -np.inf
        strong = picture.model.parameters["string_stiffness"].numpy()[0] > 0.0
        held, lengths = picture.model.string_particle.numpy(), picture.model.parameters["string_length"].numpy()[0]
        anchors = picture.frame.string_anchors
        return {
            string: string_curve(anchors[string], points[held[string]], lengths[string], model.scene.up, ground)
            for string in np.flatnonzero(strong).tolist()
        }

    @staticmethod
    def strings(picture: Picture, drawn: dict[int, NDArray[np.float32]]) -> tuple[Lines, NDArray[np.bool_]]:
        """Return the segments of strings, and which of them are hands'.

        Args:
            drawn: points along them, by their numbers.
        """
        curves, hands = [np.zeros((0, 2, 3), np.float32)], [np.zeros(0, bool)]
        for string, curve in drawn.items():
            curves.append(np.stack([curve[:-1], curve[1:]], axis=1))
            hands.append(np.full(len(curve) - 1, string in picture.hands))
        return np.concatenate(curves), np.concatenate(hands)

    def measures(self, picture: Picture) -> dict[str, float]:
        """Return volume [m^3] and pressure [Pa] of all balloons, and the largest stretch.

        The stretch is that of springs or of a membrane.
        """
        frame = picture.frame
        points = np.concatenate(frame.points).astype(np.float64)
        corners = points[self.all_triangles]
        sides = corners[:, 1:] - corners[:, :1]
        across = np.cross(sides[:, 0], sides[:, 1])
        starts = np.cumsum([0, *(len(part) for part in self.triangles[:-1])])
        areas = np.add.reduceat(0.5 * np.linalg.norm(across, axis=1), starts)
        volume = float(np.einsum("ij,ij->", corners[:, 0] - points.mean(axis=0), across)) / 6.0
        pushed = [balloon.inflation.kind == "normal_force" for balloon in picture.scene.balloon]
        force = float((np.where(pushed, 0.0, frame.pressures) * areas).sum())
        force += sum(
            float(np.linalg.norm(frame.inflation_forces[number], axis=1).sum()) for number in np.flatnonzero(pushed)
        )
        long = np.linalg.norm(points[self._ends[:, 1]] - points[self._ends[:, 0]], axis=1)
        stretch = float((long / self._rest_lengths).max(initial=0.0))
        for shape, own in zip(self.model.shapes, frame.points, strict=True):
            if shape.membrane.count:
                stretch = max(stretch, float(shape.membrane.stretches(own).max(initial=0.0)))
        area = float(areas.sum())
        return {"volume": volume, "pressure": force / area if area > 0.0 else 0.0, "stretch": stretch}


def string_reach(model: Model, up: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the reach of strings: the anchors, and the highest places of their balloons, shape (2 string_count, 3).

    A balloon rises above the anchor by the lengths of its string and itself, or hangs as far below.

    Args:
        up: Unit vector, shape (3,).
    """
    places = {name: model.parameters[name].numpy() for name in ANCHORED}
    anchors = anchors_of(model.scene, model.bodies, places)[0].reshape(-1, 3)[: len(model.scene.string)]
    lengths = model.parameters["string_length"].numpy()[0]
    held = [model.shapes[string.balloon].mesh.points for string in model.scene.string[: len(anchors)]]
    sizes = np.array([np.ptp(points, axis=0).max() for points in held])
    centers = np.array([points.mean(axis=0) for points in held]).reshape(-1, 3)
    sides = np.where((centers - anchors) @ up >= 0.0, 1.0, -1.0)
    return np.concatenate([anchors, anchors + (sides * (lengths + sizes))[:, None] * up])


MOST_PARTICLES = 5000
"""Largest number of particles of all balloons for smooth surfaces: a finer surface has four times as many points to
send"""


class Plain:
    """A mesh as it is.

    Args:
        mesh: of a balloon.
    """

    def __init__(self, mesh: PolygonMesh):
        self.triangles, self.triangle_faces = triangulate(mesh)
        corners = np.arange(len(mesh.face_vertex_indices))
        self._corners, _ = triangulate(replace(mesh, face_vertex_indices=corners, texture_coordinates=None))

    def points(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the points of the mesh."""
        return points

    def spread(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values at the corners of the triangles from those of the mesh's faces.

        Args:
            values: Values, shape (corner_count, k).

        Returns:
            Shape (n, 3, k).
        """
        return values[self._corners]


def surfaces_of(model: Model) -> "list[Plain | Smooth]":
    """Return the surface to draw of each balloon: smooth, unless that would be too much to send."""
    kind = Smooth if model.particle_count <= MOST_PARTICLES else Plain
    return [kind(shape.mesh) for shape in model.shapes]


class Smooth:
    """A mesh whose faces are split into a quad for each corner, and its points moved to a smooth surface.

    Args:
        mesh: of a balloon; open borders keep their course.
    """

    def __init__(self, mesh: PolygonMesh):
        counts, corners = np.asarray(mesh.face_vertex_counts), np.asarray(mesh.face_vertex_indices, dtype=np.int64)
        faces = np.repeat(np.arange(len(counts)), counts)
        firsts = np.repeat(np.cumsum(counts) - counts, counts)
        number = np.arange(len(corners)) - firsts
        after = firsts + (number + 1) % counts[faces]
        following = corners[after]
        pairs = np.sort(np.stack([corners, following], axis=1), axis=1)
        ends, edges, uses = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
        edges = edges.reshape(-1)
        before = edges[firsts + (number - 1) % counts[faces]]
        n_points, n_edges = mesh.vertex_count, len(ends)
        centers = _rows(faces, corners, 1.0 / counts[faces], (len(counts), n_points))
        middles = _rows(np.repeat(np.arange(n_edges), 2), ends.ravel(), np.full(2 * n_edges, 0.5), (n_edges, n_points))
        inner = uses == 2
        beside = _rows(edges, faces, np.full(len(edges), 0.5), (n_edges, len(counts)))
        smooth_edges = middles - _scaled(0.5 * inner, middles - beside @ centers)
        smooth_points = _points(corners, faces, ends, inner, (centers, middles), n_points)
        self._matrix: Any = vstack([smooth_points, smooth_edges, centers]).tocsr().astype(np.float32)
        quads = np.stack([corners, n_points + edges, n_points + n_edges + faces, n_points + before], axis=1)
        self.triangles = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        """Triangles of the finer surface, shape (n, 3)"""
        self.triangle_faces = np.repeat(faces, 2)
        """Face of the mesh of each triangle, shape (n,)"""
        self._beside = after, firsts + (number - 1) % counts[faces]
        """Next and previous corner of each corner in its face"""
        self._means = _rows(faces, np.arange(len(corners)), 1.0 / counts[faces], (len(counts), len(corners)))

    def points(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the points of the finer surface from those of the mesh; shape (n, 3)."""
        return self._matrix @ points

    def spread(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values at the corners of the triangles from those of the mesh's faces.

        They are interpolated linearly, so that an image is cut where the mesh cuts it.

        Args:
            values: Values, shape (corner_count, k).

        Returns:
            Shape (n, 3, k).
        """
        after, before = self._beside
        centers = np.repeat(self._means @ values, np.diff(self._means.indptr), axis=0)
        quads = [values, (values + values[after]) / 2, centers, (values + values[before]) / 2]
        return np.stack(quads, axis=1)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, values.shape[1])


def _points(
    corners: NDArray[np.int64],
    faces: NDArray[np.int64],
    ends: NDArray[np.int64],
    inner: NDArray[np.bool_],
    means: tuple[Any, Any],
    count: int,
) -> Any:
    """Return the matrix rows for the mesh's own points (Catmull-Clark).

    (mean of faces + 2 mean of edges + (n - 3) point) / n, n the edges there; on a border half the point, and half the
    mean of the border's two edges there.
    """
    centers, middles = means
    here = ends.ravel()
    at_edges = np.repeat(np.arange(len(ends)), 2)
    valence = np.maximum(np.bincount(here, minlength=count), 1)
    around = np.maximum(np.bincount(corners, minlength=count), 1)
    faces_mean = _rows(corners, faces, 1.0 / around[corners], (count, centers.shape[0]))
    edges_mean = _rows(here, at_edges, 1.0 / valence[here], (count, len(ends)))
    alone = _rows(np.arange(count), np.arange(count), np.ones(count), (count, count))
    inside = _scaled(1.0 / valence, faces_mean @ centers + 2.0 * (edges_mean @ middles))
    inside = inside + _scaled((valence - 3.0) / valence, alone)
    border = ~inner[at_edges]
    borders = np.bincount(here[border], minlength=count)
    rim = _rows(here[border], at_edges[border], 0.5 / borders[here[border]], (count, len(ends)))
    on_border = _scaled((borders > 0) * 0.5, alone) + rim @ middles
    kept = (borders == 0) & (np.bincount(corners, minlength=count) > 0)
    nowhere = (borders == 0) & ~kept
    return _scaled(1.0 * kept, inside) + _scaled(1.0 * (borders > 0), on_border) + _scaled(1.0 * nowhere, alone)


def _rows(rows: Any, columns: Any, values: Any, shape: tuple[int, int]) -> Any:
    return coo_matrix((values, (rows, columns)), shape=shape).tocsr()


def _scaled(factors: NDArray[np.floating], matrix: Any) -> Any:
    """Return a matrix, each row times a factor."""
    return csr_matrix(matrix.multiply(np.asarray(factors, dtype=np.float64)[:, None]))


KNOTS = "/knots"


class KnotLayer:
    """Knots of a scene, whose strings may be tied and cut."""

    def __init__(self, server: viser.ViserServer):
        self._server = server
        self._tied: list[tuple[int, int, int]] = []
        """Strings that have a knot, with the balloon and the particle that each holds"""
        self._knots: list[tuple[Knot, Any]] = []
        self._painted: list[Any] = []

    def draw(self, picture: Picture, curves: dict[int, NDArray]) -> None:
        """Move the knots to their poses.

        Args:
            curves: of the strings that are there, by their numbers, shape (n, 3) each.
        """
        tied = [self._holds(picture, number) for number in curves if _is_knotted(picture, number)]
        painted = [balloon.color for balloon in picture.scene.balloon]
        if tied != self._tied or painted != self._painted:
            self._painted = painted
            self._build(picture, tied)
        for (number, balloon, _), (knot, mesh) in zip(self._tied, self._knots, strict=True):
            pose = knot.pose(picture.frame.points[balloon], curves[number], picture.scene.up)
            mesh.position, mesh.wxyz = tuple(pose[:3].tolist()), tuple(pose[[6, 3, 4, 5]].tolist())

    def _build(self, picture: Picture, tied: list[tuple[int, int, int]]) -> None:
        scene, self._tied, self._knots = self._server.scene, tied, []
        scene.remove_by_name(KNOTS)
        scene.add_frame(KNOTS, show_axes=False)
        for number, balloon, particle in tied:
            held = picture.model.shapes[balloon].mesh
            made = knot_mesh(knot_size(held), picture.scene.up)
            color, triangles = balloon_color(picture.scene, balloon, held), triangulate(made)[0]
            mesh = scene.add_mesh_simple(f"{KNOTS}/{number}", made.points, triangles, color=color, side="double")
            self._knots.append((Knot(held, particle), mesh))

    @staticmethod
    def _holds(picture: Picture, number: int) -> tuple[int, int, int]:
        balloon = picture.scene.string[number].balloon
        particle = int(picture.model.string_particle.numpy()[number])
        return number, balloon, particle - picture.model.particle_offsets[balloon]


def _is_knotted(picture: Picture, number: int) -> bool:
    string = picture.scene.string[number]
    return has_knot(string, picture.scene.balloon[string.balloon])


LEVELS = "/levels"
SHADOW = 0.55
"""Darkness of shadows on the ground"""
GRID_SIZES = 14.0
"""Distance from the middle of the ground to where it has faded out, over the balloons' size"""


class LevelLayer:
    """Ground and water of a scene.

    Args:
        server: Server of the page.
        picture: First picture of the scene.
        center: Center of the balloons at the start [m], shape (3,).
        size: Size of the balloons [m].
    """

    def __init__(self, server: viser.ViserServer, picture: Picture, center: NDArray[np.floating], size: float):
        self._server = server
        self._up = np.array(picture.scene.up)
        self._middle = center - (center @ self._up) * self._up
        server.scene.add_frame(LEVELS, show_axes=False)
        self._planes: dict[str, Any] = {}
        """Planes by the field of a frame with their height"""
        if picture.scene.ground:
            self._planes[PLANES["ground"].height] = self._add_ground(size)
        if picture.scene.water:
            self._planes[PLANES["water"].height] = self._add_water(SIZES * size)

    def draw(self, picture: Picture) -> None:
        """Move the levels to their heights; the page is told only of changes."""
        for height, plane in self._planes.items():
            position = tuple((self._middle + getattr(picture.frame, height) * self._up).tolist())
            if tuple(plane.position) != position:
                plane.position = position
        water = self._planes.get(PLANES["water"].height)
        if water and picture.scene.ground:  # which fades out before the water's square ends
            seen = getattr(picture.frame, PLANES["water"].height) > getattr(picture.frame, PLANES["ground"].height)
            if water.visible != seen:
                water.visible = seen

    def _add_ground(self, size: float) -> Any:
        """Return a plane to throw shadows on, with a grid half a balloon's size wide."""
        wide = GRID_SIZES * size
        return self._server.scene.add_grid(
            f"{LEVELS}/ground",
            width=2 * wide,
            height=2 * wide,
            plane="xz" if self._up[1] else "xy",
            cell_size=size / 2,
            section_size=size / 2,
            cell_color=GRID,
            section_color=GRID,
            plane_color=GROUND,
            plane_opacity=1.0,
            shadow_opacity=SHADOW,
            fade_distance=wide,
        )

    def _add_water(self, half: float) -> Any:
        """Return a square that one looks through.

        Args:
            half: half its side [m].
        """
        sideways, along = (np.roll(self._up, turns) for turns in (1, 2))
        corners = [half * (a * sideways + b * along) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return self._server.scene.add_mesh_simple(
            f"{LEVELS}/water",
            np.array(corners),
            np.array([(0, 1, 2), (0, 2, 3)]),
            color=water_color(),
            opacity=PLANES["water"].opacity,
            side="double",
            cast_shadow=False,
        )

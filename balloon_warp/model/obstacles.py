"""Obstacles and free bodies on the host: shapes, masses, motion, samples, and how long their steps may be.

Coulomb's coefficient of each pair of things, resolved from the scene's coefficient of each.

The rule as a table is in docs/CONTACT.md. Things are numbered as in `kernels.loops.fixtures`: the ground, obstacles,
spheres, free bodies, balloons.

Sample points of free bodies and of obstacles that are held out of other solids.

Each is the center of a little ball inside that touches the surface there, so that for two solids edge on edge it is
clear which faces touch. Host side, float64.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.contact import AS_OTHERS
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import check_mesh
from balloon_warp.mesh.load import USD_LOADERS as STAGES
from balloon_warp.mesh.load import Treatment, axes_matrix, load_mesh, place_mesh, prepared, rotation_matrix
from balloon_warp.mesh.polygon_mesh import with_unit_and_up
from balloon_warp.mesh.topology import even_samples, is_closed, mesh_edges, signed_volume, triangulate
from balloon_warp.model.parameters import Parameters
from balloon_warp.scene import Body, Obstacle, Scene

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


FRICTION = "pair_frictions"
"""Name of the coefficients in the parameters, shape (W, thing_count, thing_count)"""
OF_THINGS = ("ground_friction", "obstacle_friction", "sphere_friction", "body_friction")
"""Coefficients of things other than balloons, in order"""
OF_BALLOONS, BETWEEN_BALLOONS = "balloon_friction", "touch_friction"
SAID = (*OF_THINGS, OF_BALLOONS, BETWEEN_BALLOONS)
"""Parameters that the coefficients follow from"""


def resolve_friction(parameters: Parameters, rounded: bool = True) -> Parameters:
    """Resolve the coefficient of each pair: the geometric mean of the coefficients of both.

    A balloon without one takes that of the other; between balloons it takes `touch.friction`.

    Args:
        rounded: whether coefficients are as devices keep them, so that resolving them again gives the same.
    """
    rows = {name: _rows(parameters[name], rounded) for name in SAID}
    worlds = max(map(len, rows.values()))
    each = {name: np.broadcast_to(values, (worlds, values.shape[1])) for name, values in rows.items()}
    said = np.concatenate([each[name] for name in (*OF_THINGS, OF_BALLOONS)], axis=1)
    is_balloon = np.arange(said.shape[1]) >= said.shape[1] - each[OF_BALLOONS].shape[1]
    otherwise = np.where(is_balloon, each[BETWEEN_BALLOONS], said)
    beside = np.where((said == AS_OTHERS)[:, :, None], otherwise[:, None, :], said[:, :, None])
    return {FRICTION: _means(beside, beside.transpose(0, 2, 1))}


def _means(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the geometric means; of two that are alike exactly their value."""
    return np.where(first == second, first, np.sqrt(first * second))


def _rows(values: NDArray[np.floating], rounded: bool) -> NDArray[np.float64]:
    """Return the rows of worlds, shape (W, count), a single one where all are alike."""
    kept = np.asarray(values, dtype=np.float32 if rounded else np.float64)
    rows = kept.astype(np.float64).reshape(len(values), -1)
    return rows[:1] if (rows == rows[:1]).all() else rows


SHEET = 1.0e-3
"""Thickness of a sheet over its size"""
FAINT = 4.0e-6
"""Resolution of float32 between two distances, over a mesh's size"""
BLURS = (1.0e-6, 1.0e-3)
"""Least and largest blur, over the mean edge; the largest is Warp's own"""


@dataclass(frozen=True)
class ObstacleShape:
    """An obstacle about its own origin, not turned."""

    kind: str
    size: NDArray[np.float64]
    """Half the edges of a box; radius, half the length and 0 of a capsule; zeros for others [m], shape (3,)"""
    mesh: PolygonMesh | None
    """Mesh in meters, in the scene's up axis"""
    closed: bool
    """Whether the mesh has an inside; one that winds inward is a room, whose walls are sheets"""
    thickness: float
    """Distance from the surface at which particles are held [m]"""
    reach: float
    """Distance of the farthest point from the origin, with the thickness [m]; infinite for a plane"""
    remarks: tuple[str, ...] = ()
    """Remarks on the reading of the mesh's file, a sentence each"""

    @property
    def triangles(self) -> NDArray[np.int32]:
        """Triangles of the mesh, shape (n, 3)."""
        return triangulate(self.mesh)[0] if self.mesh else np.zeros((0, 3), dtype=np.int32)

    @property
    def blur(self) -> float:
        """Resolution of float32 between distances from a point to two places of the mesh, over the mean edge."""
        if self.mesh is None:
            return 0.0
        corners = self.mesh.points[self.triangles]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        return float(np.clip(FAINT * self.reach / edges.mean(), *BLURS))


def shape_obstacle(number: int, obstacle: Obstacle | Body, scene: Scene) -> ObstacleShape:
    """Read the mesh of an obstacle, or of a body, and measure it.

    Raises:
        InputError: the mesh cannot be read, or has no face or no size.
    """
    mesh, closed, size, reach, remarks = None, True, np.zeros(3), np.inf, ()
    if obstacle.shape == "box":
        size = 0.5 * np.array(obstacle.size)
        reach = float(np.linalg.norm(size))
    elif obstacle.shape == "capsule":
        size = np.array([obstacle.radius, 0.5 * obstacle.length, 0.0])
        reach = float(size.sum())
    elif obstacle.shape == "mesh":
        assert obstacle.mesh is not None  # as the schema sees to
        source = str(obstacle.mesh) if isinstance(obstacle.mesh, Path) else obstacle.mesh.name
        mesh = load_mesh(obstacle.mesh, obstacle.prim)
        check_mesh(mesh, source)
        remarks = tuple(f"{source}: {warning}" for warning in mesh.warnings)
        winds_inward = signed_volume(mesh) < 0.0
        mesh = prepared(mesh, source, Treatment(holes="keep", parts="free"))
        mesh = place_mesh(with_unit_and_up(mesh, obstacle.unit, obstacle.up), scene.up_axis, obstacle.scale)
        closed = is_closed(mesh_edges(mesh)) and not (winds_inward and isinstance(obstacle, Obstacle))
        used = mesh.points[np.unique(mesh.face_vertex_indices)]
        reach = float(np.linalg.norm(used, axis=1).max())
        if np.ptp(used, axis=0).max() == 0.0:
            raise InputError(f"{source}: all vertices coincide; expected a mesh with an extent")
    thickness = obstacle.thickness
    if thickness is None:
        thickness = 0.0 if closed else SHEET * reach
    return ObstacleShape(obstacle.shape, size, mesh, closed, thickness, reach + thickness, remarks)


def warp_mesh(shape: ObstacleShape, device: wp.Device) -> wp.Mesh | None:
    """Make the Warp mesh in which kernels find the nearest place."""
    if shape.mesh is None:
        return None
    points = wp.array(shape.mesh.points, dtype=wp.vec3, device=device)
    return wp.Mesh(points, wp.array(shape.triangles.ravel(), dtype=wp.int32, device=device))


SAMPLES = 1000
"""Number of samples on the surface of a mesh, spread evenly by area"""
DEPTHS = np.array([0.1, 0.2, 0.4, 0.6, 0.8, 1.0])
"""Depths below a sample at which the mesh is looked for, over the width: walls with a gap behind them count, too"""
PART = 0.02
"""Least part of the surface that is on thin walls, for a thing that is thin: the edge of a wedge is not"""


def is_thin(solid: ObstacleShape, width: float) -> bool:
    """Return whether a solid, or a part of it, is narrower than a width [m]; a sheet is, a plane is not."""
    if solid.kind == "box":
        return 2.0 * float(solid.size.min()) < width
    if solid.kind == "capsule":
        return 2.0 * float(solid.size[0]) < width
    if solid.mesh is None:
        return False
    used = solid.mesh.points[solid.mesh.face_vertex_indices]
    return not solid.closed or float(np.ptp(used, axis=0).min()) < width or _has_thin_parts(solid, width)


def _has_thin_parts(solid: ObstacleShape, width: float) -> bool:
    """Return whether the way straight inward leaves a closed mesh again within a width, from `PART` of its surface."""
    from balloon_warp.mesh.surface_nets import MeshDistance  # takes long to load

    assert solid.mesh is not None  # as its kind says
    points, normals, _ = even_samples(solid.mesh, SAMPLES)
    behind = points[:, None] - width * DEPTHS[:, None] * normals[:, None]
    with wp.ScopedDevice("cpu"):
        distances = MeshDistance(solid.mesh.points, solid.triangles, thickness=0.0)(behind.reshape(-1, 3))
    leaves = (distances.reshape(SAMPLES, -1) > 0.0).any(axis=1)
    return bool(np.count_nonzero(leaves) >= PART * SAMPLES)


MOST_TURN = 90.0
"""Largest rotation in a frame [degrees]"""
MOST_FRAMES = 1_000_000
"""Largest number of frames of a motion"""


class Keyframes:
    """The motion that the scene says."""

    def __init__(self, obstacle: Obstacle):
        from scipy.spatial.transform import Rotation

        keyframes = obstacle.motion or [(0.0, (0.0, 0.0, 0.0))]
        self._times = [keyframe[0] for keyframe in keyframes]
        self._shifts = np.array([keyframe[1] for keyframe in keyframes])
        self._turns = np.array([keyframe[2] if len(keyframe) == 3 else (0.0, 0.0, 0.0) for keyframe in keyframes])
        self._own = Rotation.from_matrix(rotation_matrix(obstacle.rotation))
        self.seconds = self._times[-1] if obstacle.motion else 0.0

    def at(self, times: NDArray[np.float64]) -> "tuple[NDArray[np.float64], Rotation]":
        """Return the shifts from the position [m], shape (n, 3), and n turns."""
        from scipy.spatial.transform import Rotation

        turns = Rotation.from_euler("xyz", self._between(times, self._turns), degrees=True)
        return self._between(times, self._shifts), turns * self._own

    def fastest_turn(self, times: NDArray[np.float64]) -> float:
        """Return the largest rotation between successive times, about any axis [degrees]."""
        return float(np.abs(np.diff(self._between(times, self._turns), axis=0)).max(initial=0.0))

    def _between(self, times: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.interp(times, self._times, values[:, axis]) for axis in range(3)], axis=1)


class Sampled:
    """The motion that a USD stage has, beside the obstacle's own place and turn, which come after it."""

    def __init__(self, obstacle: Obstacle, scene: Scene, motion: Any):
        mesh = with_unit_and_up(load_mesh(motion.path, obstacle.prim), obstacle.unit, obstacle.up)
        self._motion, self.seconds = motion, motion.seconds
        self._size = obstacle.scale * mesh.meters_per_unit
        self._axes = axes_matrix(mesh.up_axis, scene.up_axis)
        self._own = rotation_matrix(obstacle.rotation)

    def at(self, times: NDArray[np.float64]) -> "tuple[NDArray[np.float64], Rotation]":
        """Return shifts and rotations at times, as `Keyframes` does."""
        from scipy.spatial.transform import Rotation

        matrices = self._motion.matrices(times.clip(max=self.seconds))
        into = self._own @ self._axes
        shifts = self._size * matrices[:, :3, 3] @ into.T
        return shifts, Rotation.from_matrix(into @ matrices[:, :3, :3] @ self._axes.T)

    def fastest_turn(self, times: NDArray[np.float64]) -> float:
        """Return the largest rotation between successive times, as `Keyframes` does; no more than half a turn."""
        _, turns = self.at(times)
        return float(np.degrees((turns[1:] * turns[:-1].inv()).magnitude().max(initial=0.0)))


def motion_of(obstacle: Obstacle, scene: Scene) -> Keyframes | Sampled:
    """Return the motion of an obstacle.

    Raises:
        InputError: its mesh cannot be read.
    """
    moving = [motion for motion in _motions(obstacle) if motion.seconds > 0.0]
    return Sampled(obstacle, scene, moving[0]) if moving else Keyframes(obstacle)


def _motions(obstacle: Obstacle) -> list[Any]:
    """Return the motions of an obstacle in its stage, as `read_motions`.

    Empty where its mesh is not from a stage, or the scene moves it.

    Raises:
        InputError: its mesh cannot be read.
    """
    if obstacle.motion or not isinstance(obstacle.mesh, Path) or obstacle.mesh.suffix.lower() not in STAGES:
        return []
    from balloon_warp.mesh.usd_stage import read_motions  # loads USD

    load_mesh(obstacle.mesh, obstacle.prim)  # or a file that is none gets another sentence
    return read_motions(obstacle.mesh, obstacle.prim)


def with_parts_apart(scene: Scene) -> Scene:
    """Return the scene with an obstacle for each part of a stage that moves by itself.

    The first part keeps the obstacle's number; the others follow behind all obstacles, with the same values.

    Raises:
        InputError: a mesh cannot be read.
    """
    first, others = [], []
    for obstacle in scene.obstacle:
        motions = _motions(obstacle)
        parts = [
            obstacle.model_copy(
                update={
                    "prim": [str(prim.GetPath()) for prim in motion.prims],
                    "name": "_".join(filter(None, (obstacle.name, motion.prims[0].GetName()))),
                }
            )
            for motion in motions
        ]
        first.append(parts[0] if len(parts) > 1 else obstacle)
        others += parts[1:]
    return scene.model_copy(update={"obstacle": first + others}) if others else scene


def obstacle_poses(positions: NDArray[np.floating], motion: NDArray[np.floating], frame: int) -> NDArray[np.float64]:
    """Return obstacle poses at a frame: origins [m] and quaternions (x, y, z, w), shape (..., obstacle_count, 7).

    Args:
        positions: Current positions by the scene or its worlds [m], shape (..., obstacle_count, 3).
        motion: Motion, as from `obstacle_motion`.
    """
    moved = motion[min(frame, len(motion) - 1)]
    places = positions + moved[:, :3]
    turns = np.broadcast_to(moved[:, 3:], (*places.shape[:-1], 4))
    return np.concatenate([places, turns], axis=-1).astype(np.float64)


def moves(scene: Scene, number: int, changing: Iterable[Mapping[str, tuple[NDArray[np.bool_], Any]]]) -> bool:
    """Return whether an obstacle moves at any time.

    Args:
        changing: Values changed by each change of the scene, as in `DueChange.values`.
    """
    changed = (values["obstacle_position"][0][number] for values in changing if "obstacle_position" in values)
    return motion_of(scene.obstacle[number], scene).seconds > 0.0 or any(which.any() for which in changed)


def obstacle_motion(scene: Scene) -> NDArray[np.float64]:
    """Return the motion of obstacles until all rest, shape (frames, obstacle_count, 7).

    Shifts from their positions [m] and rotations as quaternions (x, y, z, w), at the start of each frame; one frame
    where none moves.

    Raises:
        InputError: one turns by more than a quarter in a frame, so that it is not known which way, or moves for longer
            than is kept, or does not keep its size.
    """
    if not scene.obstacle:
        return np.zeros((1, 0, 7))
    motions = [motion_of(obstacle, scene) for obstacle in scene.obstacle]
    for number, its_motion in enumerate(motions):
        if its_motion.seconds * scene.frames_per_second > MOST_FRAMES:
            most = MOST_FRAMES / scene.frames_per_second
            raise InputError(
                f"obstacle.{number}.motion: ends after {its_motion.seconds:g} s; expected {most:g} s at most"
            )
    longest = max((its_motion.seconds for its_motion in motions), default=0.0)
    frames = ceil(longest * scene.frames_per_second) + 2 if longest > 0.0 else 1
    times = np.arange(frames) / scene.frames_per_second
    motion = np.zeros((frames, len(motions), 7))
    for number, its_motion in enumerate(motions):
        shifts, turns = its_motion.at(times)
        fastest = its_motion.fastest_turn(times) if frames > 1 else 0.0
        if fastest > MOST_TURN:
            raise InputError(
                f"obstacle.{number}.motion: turns by {fastest:.3g} degrees in a frame; expected at most {MOST_TURN:g}"
            )
        motion[:, number, :3], motion[:, number, 3:] = shifts, turns.as_quat()
    return motion


MOST_SAMPLES = 1024
"""Largest number of a mesh's vertices that become samples"""
SIDE_SAMPLES = 5
"""Number of samples along an edge of a box"""
ROUNDED_BOX = 0.01
"""Radius of a box's balls over half the shortest edge"""
ROUNDED_MESH = 0.002
"""Radius of a mesh's balls over the mesh's extent"""
FARTHEST_IN = 4.0
"""Largest depth of a ball at a sharp vertex, in radii"""


@dataclass(frozen=True)
class Samples:
    """Samples of a body about its center of mass, or of an obstacle about its origin."""

    points: NDArray[np.float64]
    """Centers of the balls, and their radii, shape (n, 4)"""
    outermost: int
    """Number of the first samples that suffice on something flat"""
    at_edges: int
    """Number of the first samples that suffice on something with samples of its own"""


def sample(solid: ObstacleShape, up: NDArray[np.float64]) -> Samples:
    """Return the samples of a shape; a plane has none."""
    if solid.kind == "box":
        return _of_box(solid)
    if solid.kind == "capsule":
        return _of_capsule(solid, up)
    if solid.kind == "plane":
        return Samples(np.zeros((0, 4)), 0, 0)
    return _of_mesh(solid)


def _of_box(solid: ObstacleShape) -> Samples:
    steps = np.linspace(-1.0, 1.0, SIDE_SAMPLES)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    sides = (np.abs(grid) == 1.0).sum(axis=1)
    order = np.argsort(-sides, kind="stable")[: int((sides > 0).sum())]
    radius = ROUNDED_BOX * float(solid.size.min())
    points = grid[order] * (solid.size - radius)
    return Samples(_balls(points, radius + solid.thickness), int((sides == 3).sum()), int((sides >= 2).sum()))


def _of_capsule(solid: ObstacleShape, up: NDArray[np.float64]) -> Samples:
    """Return samples along a capsule's axis, its ends first.

    They are no further apart than its radius, except in very long ones.
    """
    radius, half = float(solid.size[0]), float(solid.size[1])
    count = int(min(np.ceil(2.0 * half / radius) + 1, 33)) if half > 0.0 else 1
    places = np.linspace(-half, half, count) if count > 1 else np.zeros(1)
    places = places[np.argsort(-np.abs(places), kind="stable")]
    return Samples(_balls(np.outer(places, up), radius + solid.thickness), min(count, 2), count)


def _of_mesh(solid: ObstacleShape) -> Samples:
    """Return some of a mesh's vertices as samples, those of its convex hull first: on something flat it stands on them.

    Of many vertices all that are on the hull are chosen, and of the others those far from each other.
    """
    from scipy.spatial import ConvexHull, QhullError  # takes long to load

    assert solid.mesh is not None  # as its kind says
    points, used = solid.mesh.points, np.unique(solid.mesh.face_vertex_indices)
    try:
        hull = used[np.sort(ConvexHull(points[used]).vertices)]
    except QhullError:  # it is flat
        hull = used
    first = _spread(points, hull, hull[:0])
    rest = np.setdiff1d(used, hull)
    chosen = np.concatenate([first, _spread(points, rest, first)])
    balls, radii = points[chosen], np.zeros(len(chosen))
    if solid.closed:
        balls, radii = _rounded(solid, chosen)
    return Samples(_balls(balls, radii + solid.thickness), len(first), len(chosen))


def _rounded(solid: ObstacleShape, chosen: NDArray[np.integer]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return balls inside that touch all faces at some vertices, of zero radius where there is no room."""
    from balloon_warp.mesh.surface_nets import MeshDistance  # takes long to load

    assert solid.mesh is not None
    points, triangles = solid.mesh.points, solid.triangles
    radius = ROUNDED_MESH * solid.reach
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals = np.divide(normals, areas[:, None], out=np.zeros_like(normals), where=areas[:, None] > 0.0)
    matrices, sums = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    for column in triangles.T:
        np.add.at(matrices, column, areas[:, None, None] * normals[:, :, None] * normals[:, None, :])
        np.add.at(sums, column, areas[:, None] * normals)
    ways = -radius * np.einsum("nij,nj->ni", np.linalg.pinv(matrices, rcond=1.0e-3, hermitian=True), sums)
    depths = np.full(len(points), radius)  # of the balls' centers, below the nearest face
    for column in triangles.T:
        np.minimum.at(depths, column, -np.einsum("ni,ni->n", ways[column], normals))
    centers, depths = (points + ways)[chosen], depths[chosen]
    with wp.ScopedDevice("cpu"):
        inside = -MeshDistance(points, triangles, thickness=0.0)(centers)
    fits = (depths > 0.0) & (inside > 0.99 * depths)
    fits &= np.linalg.norm(ways[chosen], axis=1) <= FARTHEST_IN * radius
    return np.where(fits[:, None], centers, points[chosen]), np.where(fits, depths, 0.0)


def _balls(points: NDArray[np.float64], radii: NDArray[np.float64] | float) -> NDArray[np.float64]:
    return np.concatenate([points, np.broadcast_to(np.reshape(radii, (-1, 1)), (len(points), 1))], axis=1)


def _spread(
    points: NDArray[np.float64], among: NDArray[np.integer], before: NDArray[np.integer]
) -> NDArray[np.integer]:
    """Return as many of some points as there is room for, each as far as possible from those before it."""
    room = MOST_SAMPLES - len(before)
    if len(among) <= room:
        return among
    places = points[among]
    chosen = [] if len(before) else [int(np.linalg.norm(places, axis=1).argmax())]
    distances = np.full(len(among), np.inf)
    for place in (*points[before], *places[chosen]):
        distances = np.minimum(distances, np.linalg.norm(places - place, axis=1))
    while len(chosen) < room:
        chosen.append(int(distances.argmax()))
        distances = np.minimum(distances, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return among[chosen]


TOUCHES_OF_SAMPLE, TOUCHES_OF_BODY = 2, 64
"""Capacities of the contact list, for each sample and for each body"""
PLAIN_MASS = 1.0
"""Mass of a body without mass and density [kg]"""


@dataclass(frozen=True)
class BodyShape:
    """A body about its center of mass, not turned."""

    solid: ObstacleShape
    center: NDArray[np.float64]
    """Center of mass, from the body's own origin [m], shape (3,)"""
    inertia: NDArray[np.float64]
    """Inertia tensor of 1 kg about the center of mass [m^2], shape (3, 3)"""
    volume: float
    """Volume of the body's material [m^3]"""
    samples: Samples
    """Sample points that are held out of other solids"""


def shape_body(number: int, body: Body, scene: Scene) -> BodyShape:
    """Read a body's mesh and weigh it.

    Raises:
        InputError: the mesh cannot be read, has no size, or is open and without a thickness.
    """
    solid = shape_obstacle(number, body, scene)
    center, up = np.zeros(3), np.array(scene.up)
    if solid.mesh is None:
        volume, second = _moments_of_box(solid.size) if solid.kind == "box" else _moments_of_capsule(solid.size, up)
    else:
        if not solid.closed and not body.thickness:
            raise InputError(
                f"body.{number}.thickness: is missing, and {solid.mesh.name} is not closed; expected half the sheet's "
                "thickness, or a closed mesh"
            )
        corners = solid.mesh.points[solid.triangles]
        volume, center, second = _moments_of_solid(corners) if solid.closed else _moments_of_sheet(corners)
        if volume <= 0.0:
            raise InputError(f"body.{number}.mesh: {solid.mesh.name} encloses no volume; expected a solid mesh")
        if not solid.closed:
            volume *= 2.0 * solid.thickness
        mesh = replace(solid.mesh, points=solid.mesh.points - center)
        reach = float(np.linalg.norm(mesh.points[mesh.face_vertex_indices], axis=1).max()) + solid.thickness
        solid = replace(solid, mesh=mesh, reach=reach)
    return BodyShape(solid, center, np.trace(second) * np.eye(3) - second, volume, sample(solid, up))


def max_body_contacts(shapes: Sequence[BodyShape]) -> int:
    """Return the largest number of contacts of bodies in a step, over all things; no further ones are resolved."""
    return sum(TOUCHES_OF_SAMPLE * len(shape.samples.points) + TOUCHES_OF_BODY for shape in shapes)


def resolve_bodies(scene: Scene, shapes: Sequence[BodyShape], parameters: Parameters) -> Parameters:
    """Return the masses of bodies with a density, or with neither density nor mass [kg], shape (W, body_count)."""
    said = parameters["body_mass"]
    settled = [
        PLAIN_MASS if body.density is None else body.density * shape.volume
        for body, shape in zip(scene.body, shapes, strict=True)
    ]
    return {"body_mass": np.where(np.isnan(said), np.array(settled).reshape(1, -1), said)}


def initial_turns(scene: Scene) -> NDArray[np.float64]:
    """Return the initial orientations of bodies as quaternions (x, y, z, w), shape (body_count, 4)."""
    if not scene.body:
        return np.zeros((0, 4))
    from scipy.spatial.transform import Rotation  # takes long to load

    return np.array([Rotation.from_matrix(rotation_matrix(body.rotation)).as_quat() for body in scene.body])


def initial_centers(scene: Scene, shapes: Sequence[BodyShape], positions: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return initial centers of mass [m], shape (W, body_count, 3), from the initial origins, of the same shape."""
    arms = [rotation_matrix(body.rotation) @ shape.center for body, shape in zip(scene.body, shapes, strict=True)]
    return positions + np.array(arms).reshape(-1, 3)


def initial_poses(scene: Scene, shapes: Sequence[BodyShape], positions: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return initial centers of mass [m] and orientations, as `Frame.body_poses`, shape (W, body_count, 7)."""
    centers = initial_centers(scene, shapes, positions)
    turns = np.broadcast_to(initial_turns(scene), (*centers.shape[:-1], 4))
    return np.concatenate([centers, turns], axis=-1)


def largest_inverse_mass(shape: BodyShape, arms: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the largest speed that an impulse of 1 N s gives points of a body of 1 kg [m/s], of all directions.

    Args:
        arms: of the points from the center of mass, in the body's axes [m], shape (..., 3).
    """
    across = np.cross(np.eye(3), arms[..., None, :])  # row i is e_i x r
    turning = across @ np.linalg.solve(shape.inertia, across.swapaxes(-1, -2))
    return np.asarray(1.0 + np.linalg.eigvalsh(turning)[..., -1], dtype=np.float64)


def _moments_of_box(half: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return the volume, and the mean of x x^T, shape (3, 3)."""
    return float(8.0 * half.prod()), np.diag(half**2 / 3.0)


def _moments_of_capsule(size: NDArray[np.float64], up: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return a cylinder and two halves of a ball, along the up axis."""
    radius, half = float(size[0]), float(size[1])
    tube, ball = 2.0 * np.pi * radius**2 * half, 4.0 / 3.0 * np.pi * radius**3
    across = (tube * radius**2 / 4.0 + ball * radius**2 / 5.0) / (tube + ball)
    cap = radius**2 / 5.0 + half**2 + 0.75 * half * radius
    along = (tube * half**2 / 3.0 + ball * cap) / (tube + ball)
    return tube + ball, across * np.eye(3) + (along - across) * np.outer(up, up)


def _moments_of_solid(corners: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return volume, center of mass, and the mean of x x^T about it, of tetrahedra over outward triangles."""
    origin = corners.mean(axis=(0, 1))
    arms = corners - origin
    volumes = np.einsum("ij,ij->i", arms[:, 0], np.cross(arms[:, 1], arms[:, 2])) / 6.0
    return _moments(arms, volumes, origin, 4)


def _moments_of_sheet(corners: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return the area, center of mass, and the mean of x x^T about it, of triangles."""
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return _moments(corners, areas, np.zeros(3), 3)


def _moments(
    corners: NDArray[np.float64], sizes: NDArray[np.float64], origin: NDArray[np.float64], corner_count: int
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return the moments of simplices with a number of corners, of which those not given are at the origin."""
    whole, sums = float(sizes.sum()), corners.sum(axis=1)
    if whole <= 0.0:
        return whole, origin, np.zeros((3, 3))
    middle = sizes @ sums / (corner_count * whole)
    products = np.einsum("nki,nkj->nij", corners, corners) + np.einsum("ni,nj->nij", sums, sums)
    second = np.einsum("n,nij->ij", sizes, products) / (corner_count * (corner_count + 1) * whole)
    return whole, origin + middle, second - np.outer(middle, middle)


TOUCHING_STEP = 1.0 / 480.0
"""Longest step where anything may be touched [s]"""
PART_OF_REACH = 0.25
"""Largest displacement in a substep, over the extent of a body from its center of mass"""
BODY_TURN = 0.1
"""Largest rotation in a substep by the initial spin [rad]"""
SHORTEST_STEP = 1.0e-4
"""Shortest step that speed and spin may require [s]: faster contacts are found by time of impact, without more steps"""


def substeps_of_solids(scene: Scene, bodies: Sequence[BodyShape], parameters: Parameters) -> int:
    """Return the substeps in a frame that free bodies and spheres ask for, in whichever world is the fastest."""
    step = np.inf
    if scene.body or (scene.sphere and scene.solver != "projective"):  # which has a step of its own for spheres
        step = TOUCHING_STEP
    if scene.body:
        reaches = np.array([shape.solid.reach for shape in bodies])
        spins = np.linalg.norm(parameters["initial_body_spins"], axis=2)
        rates = np.maximum(_speeds(scene, parameters) / (PART_OF_REACH * reaches), spins / BODY_TURN)
        step = min(step, max(1.0 / max(float(rates.max()), 1.0e-6), SHORTEST_STEP))
    return max(ceil(1.0 / (scene.frames_per_second * step) - 1.0e-6), 1)


def _speeds(scene: Scene, parameters: Parameters) -> NDArray[np.float64]:
    """Return bounds on the speeds of bodies [m/s], shape (W, body_count).

    They fall to the ground, or down to the lowest of all things, for no longer than the scene lasts.
    """
    up, gravity = np.array(scene.up), np.abs(parameters["gravity"])
    speeds = np.linalg.norm(parameters["initial_body_velocities"], axis=2)
    heights = parameters["initial_body_positions"] @ up
    if scene.ground is not None:
        lowest = parameters["ground_height"]
    else:
        names = ("initial_body_positions", "initial_sphere_positions", "obstacle_position")
        placed = [parameters[name] for name in names] + [np.array([balloon.position for balloon in scene.balloon])]
        lowest = min(float((places @ up).min()) for places in placed if places.size)
    falls = np.maximum(heights - lowest, 0.0)
    seconds = scene.frames / scene.frames_per_second
    return np.minimum(np.sqrt(speeds**2 + 2.0 * gravity * falls), speeds + gravity * seconds)

"""Distances to obstacles and bodies on the host, in float64: overlaps at the start, and ridges that lie flush.

Check that nothing starts inside an obstacle or a free body.

It would be torn to the surface in its first step. Host side, float64.

Ridges beside which another solid lies flush: there the two are one surface, and nothing sticks out.

Seams of a floor of boxes, the foot of a wall on its floor. A body that slides over one would catch on a hidden edge
("internal edges" of game engines).
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from balloon_warp.errors import InputError
from balloon_warp.mesh.surface_nets import MeshDistance
from balloon_warp.mesh.topology import box_corners
from balloon_warp.model.obstacles import (
    BodyShape,
    ObstacleShape,
    initial_centers,
    initial_turns,
    moves,
    obstacle_motion,
)
from balloon_warp.model.parameters import DueChange, Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.starts import start_of
from balloon_warp.model.touch import FLAT, Ridges, with_tips
from balloon_warp.scene import Scene


class Solid:
    """An obstacle or a body, turned, and how far points are from its surface."""

    def __init__(self, shape: ObstacleShape, up: NDArray[np.float64], turn: Rotation):
        self.shape, self._up = shape, up
        self.matrix = turn.as_matrix()

    def seen(self, points: NDArray[np.float64], centers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the world, shape (W, n, 3), relative to the obstacle's center in each, shape (W or 1, 3)."""
        return (points - centers[:, None]) @ self.matrix

    @cached_property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest corner of the box around it, as seen from its center, shape (3,)."""
        if self.shape.mesh is not None:
            used = self.shape.mesh.points[self.shape.mesh.face_vertex_indices]
            lowest, highest = used.min(axis=0), used.max(axis=0)
        elif self.shape.kind == "plane":
            highest = np.where(self._up > 0.0, 0.0, np.inf)
            lowest = np.full(3, -np.inf)
        else:
            highest = self.shape.size
            if self.shape.kind == "capsule":
                highest = self.shape.size[0] + self.shape.size[1] * self._up
            lowest = -highest
        return lowest - self.shape.thickness, highest + self.shape.thickness

    def distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return signed distances of points, relative to the center, to the surface less its thickness, shape (n,)."""
        size = self.shape.size
        if self.shape.kind == "box":
            beyond = np.abs(points) - size
            found = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
        elif self.shape.kind == "capsule":
            along = np.clip(points @ self._up, -size[1], size[1])
            found = np.linalg.norm(points - np.outer(along, self._up), axis=1) - size[0]
        elif self.shape.kind == "plane":
            found = points @ self._up
        else:
            found = self._to_mesh(points)
        return found - self.shape.thickness

    def _to_mesh(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        with wp.ScopedDevice("cpu"):
            return self._mesh_distance(points)

    @cached_property
    def _mesh_distance(self) -> MeshDistance:
        assert self.shape.mesh is not None
        return MeshDistance(self.shape.mesh.points, self.shape.triangles, thickness=0.0)


DEEP = 0.01
"""Tolerated depth over the balloon's size, or over the obstacle's extent if that is less, for rounding and for meshes
that stand on surfaces"""


def require_no_overlap_at_start(
    scene: Scene, shapes: Sequence[BalloonShape], obstacles: Sequence[ObstacleShape], parameters: Parameters
) -> None:
    """Refuse balloons of which a particle that moves starts inside an obstacle, in any world. Sheets have no inside.

    Args:
        parameters: with those that `resolve_starts` makes.

    Raises:
        InputError: names balloon and obstacle, and how deep the one is in the other.
    """
    motion = obstacle_motion(scene)[0]
    for number, obstacle in enumerate(obstacles):
        if not obstacle.closed:
            continue
        solid = Solid(obstacle, np.array(scene.up), Rotation.from_quat(motion[number, 3:]))
        centers = parameters["obstacle_position"][:, number] + motion[number, :3]
        for balloon, shape in enumerate(shapes):
            named = f"obstacle {number}, {scene.obstacle[number].name or f'a {solid.shape.kind}'}"
            _require_outside(scene, balloon, shape, named, solid, centers, parameters)


def require_no_overlap_of_bodies(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    obstacles: Sequence[ObstacleShape],
    bodies: Sequence[BodyShape],
    parameters: Parameters,
) -> None:
    """Refuse bodies that start in other solids, and balloons and spheres that start in bodies, in any world.

    Other solids are the ground, obstacles and bodies. Sheets have no inside.

    Args:
        parameters: Parameters with the results of `resolve_starts`.

    Raises:
        InputError: Names both, and the depth of the one in the other.
    """
    up, motion = np.array(scene.up), obstacle_motion(scene)[0]
    solids = [
        Solid(shape.solid, up, Rotation.from_quat(turn)) if shape.solid.closed else None
        for shape, turn in zip(bodies, initial_turns(scene), strict=True)
    ]
    centers = initial_centers(scene, bodies, parameters["initial_body_positions"])
    ways = [
        (f"obstacle {n}", Solid(shape, up, Rotation.from_quat(motion[n, 3:])), places)
        for n, shape in enumerate(obstacles)
        for places in [parameters["obstacle_position"][:, n] + motion[n, :3]]
        if shape.closed
    ]
    ways += [(f"body {n}", solid, centers[:, n]) for n, solid in enumerate(solids) if solid]
    for number, (shape, turn) in enumerate(zip(bodies, initial_turns(scene), strict=True)):
        arms = Rotation.from_quat(turn).apply(np.concatenate([shape.samples.points[:, :3], np.zeros((1, 3))]))
        for world in range(len(centers)):
            points, allowed = centers[world, number] + arms, DEEP * shape.solid.reach
            found = [
                (way, _depth_in(solid, points, _row(at, world)[0]))
                for way, solid, at in ways
                if way != f"body {number}"
            ]
            if scene.ground is not None:
                height = float(_row(parameters["ground_height"], world)[0])
                found.append(("the ground", height - float((points @ up).min())))
            found = [(way, deep + shape.samples.points[:, 3].min()) for way, deep in found]
            for way, deep in found:
                _require_shallow(f"body.{number}.position: it", way, deep, allowed)
    for number, solid in enumerate(solids):
        if solid is None:
            continue
        for balloon, shape in enumerate(shapes):
            _require_outside(scene, balloon, shape, f"body {number}", solid, centers[:, number], parameters)
        for sphere in range(len(scene.sphere)):
            worlds = max(len(centers), len(parameters["initial_sphere_positions"]))
            for world in range(worlds):
                at = _row(parameters["initial_sphere_positions"], world)[0, sphere]
                radius = float(_row(parameters["sphere_radius"], world)[0, sphere])
                deep = _depth_in(solid, at[None], _row(centers[:, number], world)[0]) + radius
                if radius > 0.0:
                    _require_shallow(f"sphere.{sphere}.position: it", f"body {number}", deep, DEEP * radius)


def _depth_in(solid: Solid, points: NDArray[np.float64], center: NDArray[np.float64]) -> float:
    """Return the largest depth of points in a solid [m], negative outside; minus infinity far away."""
    seen = solid.seen(points[None], center[None])[0]
    near = np.linalg.norm(seen, axis=1) < 2.0 * solid.shape.reach
    return -float(solid.distances(seen[near]).min()) if near.any() else -np.inf


def _require_shallow(what: str, where: str, depth: float, allowed: float) -> None:
    if depth > allowed:
        raise InputError(f"{what} starts {depth:.3g} m deep inside {where}; expected it outside")


def _require_outside(
    scene: Scene,
    balloon: int,
    shape: BalloonShape,
    named: str,
    solid: Solid,
    centers: NDArray[np.float64],
    parameters: Parameters,
) -> None:
    """Look at the particles only in worlds where the boxes around balloon and obstacle overlap."""
    corners = solid.seen(start_of(scene, parameters, balloon, box_corners(shape.mesh)), centers)
    lowest, highest = solid.bounds
    near = ((corners.min(axis=1) < highest) & (corners.max(axis=1) > lowest)).all(axis=1)
    used = np.unique(shape.mesh.face_vertex_indices)
    moving = used[shape.mass_share[used] > 0.0]
    allowed = DEEP * min(float(np.ptp(shape.mesh.points[used], axis=0).max()), solid.shape.reach)
    for world in np.flatnonzero(near).tolist():
        alone = {name: _row(parameters[name], world) for name in ("initial_turns", "initial_shifts")}
        points = solid.seen(start_of(scene, alone, balloon, shape.mesh.points[moving]), _row(centers, world))[0]
        within = points[((points > lowest) & (points < highest)).all(axis=1)]
        depth = -float(solid.distances(within).min()) if len(within) else 0.0
        if depth > allowed:
            where = f" in world {world}" if len(near) > 1 else ""
            raise InputError(
                f"balloon.{balloon}.position: {shape.name} starts{where} {depth:.3g} m deep inside {named}; "
                "expected it outside"
            )


def _row(values: NDArray[np.float64], world: int) -> NDArray[np.float64]:
    """Return the values of one world, with the dimension of worlds."""
    return values[world : world + 1] if len(values) > 1 else values


DIRECTIONS = 24
"""Number of directions sampled around a ridge"""
CELLS = 16
"""Number of cells along a ridge whose midpoints are sampled"""
HALVINGS = 12
"""Number of bisections between two samples, to the place where a neighbor ends"""


def exposed_ridges(
    scene: Scene,
    obstacles: Sequence[ObstacleShape],
    ridges: Sequence[Ridges],
    parameters: Parameters,
    changes: Sequence[DueChange],
    kept: float,
) -> list[Ridges]:
    """Cut ridges of obstacles that rest to where they stick out of all that rests beside them, in every world.

    Args:
        ridges: of each obstacle, as seen from that; further ones behind stay as they are.
        kept: distance that faces keep from ridges [m]: a nearer solid lies flush.
    """
    placed = _placed_solids(scene, obstacles, parameters, changes)
    cut = list(ridges)
    for number, (solid, center) in placed.items():
        if number == len(obstacles) or not len(ridges[number].ends) or not ridges[number].inward[:, 0].any():
            continue
        others = []
        for other, (beside, there) in placed.items():
            shift = there - center
            if other != number and np.ptp(shift, axis=0).max() == 0.0:
                others.append(_Neighbor(solid, beside, shift[0]))
        cut[number] = _Beside(ridges[number], others, kept).cut()
    return cut


def _placed_solids(
    scene: Scene, obstacles: Sequence[ObstacleShape], parameters: Parameters, changes: Sequence[DueChange]
) -> dict[int, tuple[Solid, NDArray[np.float64]]]:
    """Return resting obstacles and, as the last, the ground, with their positions, shape (W or 1, 3)."""
    up, values = np.array(scene.up), [change.values for change in changes]
    motion = obstacle_motion(scene)[0]
    placed = {
        number: (
            Solid(shape, up, Rotation.from_quat(motion[number, 3:])),
            parameters["obstacle_position"][:, number] + motion[number, :3],
        )
        for number, shape in enumerate(obstacles)
        if not moves(scene, number, values)
    }
    if scene.ground is not None and not any("ground_height" in each for each in values):
        floor = ObstacleShape("plane", np.zeros(3), None, closed=True, thickness=0.0, reach=np.inf)
        placed[len(obstacles)] = Solid(floor, up, Rotation.identity()), np.outer(parameters["ground_height"], up)
    return placed


class _Neighbor:
    """A solid, as seen from another."""

    def __init__(self, seer: Solid, solid: Solid, shift: NDArray[np.float64]):
        self._solid = solid
        self._matrix, self._shift = seer.matrix.T, shift

    def near(self, ends: NDArray[np.float64], reach: float) -> NDArray[np.bool_]:
        """Return which lines of shape (n, 2, 3) may come within a distance of the neighbor's box, shape (n,)."""
        seen = self._seen(ends)
        lowest, highest = self._solid.bounds
        return ((seen.min(axis=1) < highest + reach) & (seen.max(axis=1) > lowest - reach)).all(axis=1)

    def holds(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points are inside the neighbor, without their last dimension."""
        return (self._solid.distances(self._seen(points).reshape(-1, 3)) < 0.0).reshape(points.shape[:-1])

    def _seen(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return (points @ self._matrix - self._shift) @ self._solid.matrix


class _Beside:
    """Ridges of a solid, and the solids beside it."""

    def __init__(self, ridges: Ridges, others: Sequence[_Neighbor], kept: float):
        self._ridges, self._others = ridges, others
        self._away = ridges.radius + kept
        angles = (np.arange(DIRECTIONS) + 0.5) * 2.0 * np.pi / DIRECTIONS
        along = ridges.ends[:, 1] - ridges.ends[:, 0]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        side, other = ridges.inward[:, 0], ridges.inward[:, 1]
        across = np.cross(along, side)
        self._around = np.cos(angles)[:, None] * side[:, None] + np.sin(angles)[:, None] * across[:, None]
        turn = np.arctan2((across * other).sum(axis=1), (side * other).sum(axis=1))[:, None]
        within = np.where(turn > 0.0, angles < turn, angles > 2.0 * np.pi + turn)
        sheet = np.abs(np.angle(np.exp(1j * angles))) < 2.0 * np.pi / DIRECTIONS
        self._own = np.where((other != 0.0).any(axis=1, keepdims=True), within, sheet)

    def cut(self) -> Ridges:
        """Return the parts of the ridges that stick out."""
        middles = (np.arange(CELLS) + 0.5) / CELLS
        near = np.zeros(len(self._ridges.ends), bool)
        for neighbor in self._others:
            near |= neighbor.near(self._ridges.ends, 2.0 * self._away)
        near &= (self._ridges.inward[:, 0] != 0.0).any(axis=1)
        if not near.any():
            return self._ridges
        which = np.flatnonzero(near)
        out = self._sticks_out(which, np.broadcast_to(middles, (len(which), CELLS)))
        left = [(row, 0.0, 1.0) for row in np.flatnonzero(~near).tolist()]
        for row, cells in zip(which.tolist(), out, strict=True):
            left += [(row, *piece) for piece in self._pieces(row, cells, middles)]
        rows = np.array([row for row, _, _ in left], int)
        parts = np.array([piece[1:] for piece in left]).reshape(-1, 2)
        begin, end = self._ridges.ends[rows, 0], self._ridges.ends[rows, 1]
        ends = begin[:, None] + parts[:, :, None] * (end - begin)[:, None]
        found = with_tips(ends, self._ridges.inward[rows], self._ridges.radius)
        whole = 1 * (parts[:, 0] == 0.0) + 2 * (parts[:, 1] == 1.0)
        return found._replace(tips=(found.tips & whole).astype(np.int32))

    def _pieces(self, row: int, out: NDArray[np.bool_], middles: NDArray[np.float64]) -> list[tuple[float, float]]:
        """Return the intervals in which a ridge sticks out, as fractions of its length."""
        bounds = [0.0] if out[0] else []
        for cell in np.flatnonzero(out[1:] != out[:-1]).tolist():
            low, high = middles[cell], middles[cell + 1]
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                same = self._sticks_out(np.array([row]), np.array([[middle]]))[0, 0] == out[cell]
                low, high = (middle, high) if same else (low, middle)
            bounds.append(0.5 * (low + high))
        bounds += [1.0] if out[-1] else []
        return list(zip(bounds[::2], bounds[1::2], strict=True))

    def _sticks_out(self, rows: NDArray[np.intp], parts: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether a ridge sticks out at fractions of its length, shape (n, k).

        It does where more than half of the directions around it are free and contiguous, or as many as if it were
        alone.
        """
        ends = self._ridges.ends[rows]
        places = ends[:, None, 0] + parts[:, :, None] * (ends[:, 1] - ends[:, 0])[:, None]
        samples = places[:, :, None] + self._away * self._around[rows][:, None]
        taken = np.zeros(samples.shape[:-1], bool)
        for neighbor in self._others:
            near = neighbor.near(ends, 2.0 * self._away)
            if near.any():
                taken[near] |= neighbor.holds(samples[near])
        free = ~(taken | self._own[rows][:, None])
        most = (np.pi + FLAT) * DIRECTIONS / (2.0 * np.pi)
        return ~taken.any(axis=-1) | (_longest_run(free) > most)


def _longest_run(free: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Count the neighbors in a circle that are free, along the last axis."""
    length = free.shape[-1]
    twice = np.concatenate([free, free], axis=-1)
    run, longest = np.zeros(free.shape[:-1], int), np.zeros(free.shape[:-1], int)
    for step in range(2 * length):
        run = np.where(twice[..., step], run + 1, 0)
        longest = np.maximum(longest, run)
    return np.minimum(longest, length)

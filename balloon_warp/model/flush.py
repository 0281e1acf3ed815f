"""Ridges beside which another solid lies flush: there the two are one surface, and nothing sticks out.

Seams of a floor of boxes, the foot of a wall on its floor. A body that slides over one would catch on a hidden edge
("internal edges" of game engines).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from balloon_warp.model.obstacles import ObstacleShape, moves, obstacle_motion
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.ridges import FLAT, Ridges, with_tips
from balloon_warp.model.solids import Solid
from balloon_warp.model.timeline import DueChange
from balloon_warp.scene import Scene

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

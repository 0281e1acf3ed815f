"""Edges of balloons that meet, in NumPy and double precision, written from the formulas of `laws.edges`.

All pairs of edges of separate balloons are looked at, and all pairs of a particle and a triangle."""

from collections.abc import Callable, Sequence
from itertools import permutations
from typing import Any

import numpy as np

from balloon_warp.kernels.contact.edge_catch import AHEAD
from balloon_warp.kernels.contact.edges import MOST_SWEEPS, SAFE, SETTLED
from balloon_warp.kernels.laws.edges import CROSSED, KEPT, PARALLEL
from balloon_warp.kernels.laws.ridges import LITTLE, PARTED

Array = np.ndarray
Skins = Callable[[int, int], tuple[float, float, float]]


def dots(a: Array, b: Array) -> Array:
    return (a * b).sum(axis=-1)


def cross(a: Array, b: Array) -> Array:
    """Return cross products, in a third of the time of NumPy's for few vectors."""
    after, before = [1, 2, 0], [2, 0, 1]
    return a[..., after] * b[..., before] - a[..., before] * b[..., after]


class MeetingEdges:
    """Contacts of edges of separate balloons.

    Args:
        edges: ends of the edges of each balloon.
        corners: of the triangles of each balloon.
        owner: balloon of each particle.
        skins: function that returns thickness, stiffness and friction between two balloons.
        weights_in: function that returns barycentric weights of what is nearest to a point in a triangle.
        ground: its height along y, below all if there is none.
    """

    def __init__(
        self, edges: Sequence[Array], corners: Sequence[Array], owner: Array, ease: Array, h: float, skins: Skins,
        weights_in: Callable[..., Array], ground: float,
    ):  # fmt: skip
        self.ground = ground
        self.owner, self.ease, self.h, self.weights_in = owner, ease, h, weights_in
        balloons = range(len(edges))
        self.skins = np.array([[skins(first, second) for second in balloons] for first in balloons])
        of_edges, of_particles = [], []
        for first, second in permutations(range(len(edges)), 2):
            if first < second:
                one, other = (np.arange(len(edges[number])) for number in (first, second))
                i, j = (each.ravel() for each in np.meshgrid(one, other, indexing="ij"))
                of_edges.append(np.concatenate([edges[first][i], edges[second][j]], axis=1))
            own, triangles = np.flatnonzero(owner == first), corners[second]
            i, j = (each.ravel() for each in np.meshgrid(own, np.arange(len(triangles)), indexing="ij"))
            of_particles.append(np.concatenate([triangles[j], i[:, None]], axis=1))
        self.edges, self.particles = np.concatenate(of_edges), np.concatenate(of_particles)

    def meet(self, x: Array, v: Array) -> tuple[Array, Array]:
        """Return places and velocities once edges have pushed each other apart."""
        caught = [
            self._may_touch(v, *self._of_edges(x - self.h * v)), self._may_touch(v, *self._of_particles(x - self.h * v))
        ]  # fmt: skip
        c = {name: np.concatenate([each[name] for each in caught]) for name in caught[0]}
        if not len(c["gap"]):
            return x, v
        for _ in range(int(MOST_SWEEPS)):
            excess = -np.maximum(c["gap"] - c["kept"], 0.0) / self.h - self._parting(c, v)
            pushed = {name: each[excess > 0.0] for name, each in c.items()}
            gains = self._gains(pushed, self._impulses(pushed, v, excess[excess > 0.0]))
            x, v = self._stopped(pushed, x + self.h * gains, v + gains, 1.0)
            least = np.minimum(float(SETTLED) * c["kept"], float(SAFE) * c["gap"])
            if not ((excess > 0.0) & (self.h * excess > least)).any():
                break
        move = float(PARTED) * np.maximum(float(LITTLE) * c["kept"] - c["gap"], 0.0)
        parted = {name: each[move > 0.0] for name, each in c.items()}
        eases = self._eases(parted)
        moves = move[move > 0.0] / np.maximum((parted["weights"] ** 2 * eases).sum(axis=1), 1e-30)
        return self._stopped(parted, x + self._gains(parted, self._along(parted, moves)), v, 0.0)

    def _stopped(self, c: Any, x: Array, v: Array, speeds: float) -> tuple[Array, Array]:
        """Return places and velocities of particles once the ground has stopped those that edges have pushed."""
        moved = np.zeros(len(x), dtype=bool)
        np.logical_or.at(moved, c["ends"], c["weights"] != 0.0)
        rise = np.where(moved, np.maximum(self.ground - x[:, 1], 0.0), 0.0)
        slowed = np.minimum(rise / self.h, np.maximum(-v[:, 1], 0.0))
        return x + rise[:, None] * (0.0, 1.0, 0.0), v + speeds * slowed[:, None] * (0.0, 1.0, 0.0)

    def _of_edges(self, x: Array) -> tuple[Array, ...]:
        a, b, c, d = (x[self.edges[:, end]] for end in range(4))
        first, second, start = b - a, d - c, a - c
        aa, ee, bb = dots(first, first), dots(second, second), dots(first, second)
        cc, ff = dots(first, start), dots(second, start)
        sine = aa * ee - bb**2
        skew = sine > float(PARALLEL) * aa * ee
        s = np.where(skew, np.clip((bb * ff - cc * ee) / np.where(skew, sine, 1.0), 0.0, 1.0), 0.5)
        t = np.clip((bb * s + ff) / ee, 0.0, 1.0)
        s = np.clip((bb * t - cc) / aa, 0.0, 1.0)
        arm = c + t[:, None] * second - a - s[:, None] * first
        return self.edges, arm, np.stack([s - 1.0, -s, 1.0 - t, t], axis=1), first, second

    def _of_particles(self, x: Array) -> tuple[Array, ...]:
        a, b, c, point = (x[self.particles[:, end]] for end in range(4))
        weights = self.weights_in(point, a, b, c)
        arm = point - (weights[:, :, None] * np.stack([a, b, c], axis=1)).sum(axis=1)
        right = dots(arm, cross(b - a, c - a)) >= 0.0
        none = np.zeros((int(right.sum()), 3))
        signed = np.concatenate([-weights, np.ones((len(weights), 1))], axis=1)
        return self.particles[right], arm[right], signed[right], none, none

    def _may_touch(self, v: Array, ends: Array, arm: Array, weights: Array, first: Array, second: Array) -> Any:
        gap = np.linalg.norm(arm, axis=1)
        skins = self.skins[tuple(self.owner[ends[:, [0, 3]]].T)]
        kept = float(KEPT) * skins[:, 0]
        speed = np.linalg.norm((weights[:, :, None] * v[ends]).sum(axis=1), axis=1)
        near = gap < 2.0 * kept + float(AHEAD) * self.h * speed
        all_of = {
            "ends": ends, "weights": weights, "gap": gap, "normal": arm / gap[:, None], "kept": kept,
            "first": first, "second": second, "friction": skins[:, 2],
        }  # fmt: skip
        return {name: each[near] for name, each in all_of.items()}

    def _parting(self, c: Any, v: Array) -> Array:
        return dots((c["weights"][:, :, None] * v[c["ends"]]).sum(axis=1), c["normal"])

    def _eases(self, c: Any) -> Array:
        """Return the inverse masses of the ends, each times the contacts among which it is shared."""
        shares = np.zeros(len(self.ease))
        np.add.at(shares, c["ends"], 1.0 * (c["weights"] != 0.0))
        return (shares * self.ease)[c["ends"]]

    @staticmethod
    def _along(c: Any, amounts: Array) -> Array:
        return (c["weights"] * amounts[:, None])[:, :, None] * c["normal"][:, None]

    def _gains(self, c: Any, impulses: Array) -> Array:
        total = np.zeros((len(self.ease), 3))
        np.add.at(total, c["ends"], impulses * (c["weights"] != 0.0)[:, :, None])
        return self.ease[:, None] * total

    def _impulses(self, c: Any, v: Array, excess: Array) -> Array:
        eases, n = self._eases(c), c["normal"]
        push = excess / np.maximum((c["weights"] ** 2 * eases).sum(axis=1), 1e-30)
        impulses, weights = self._along(c, push), c["weights"]
        span = dots(cross(c["first"], c["second"]), n)
        within = ((np.abs(weights) > 0.0) & (np.abs(weights) < 1.0)).all(axis=1)
        lengths = np.linalg.norm(c["first"], axis=1) * np.linalg.norm(c["second"], axis=1)
        rubs = within & (np.abs(span) > float(CROSSED) * lengths)
        scale = c["gap"] / np.where(rubs, span, 1.0)
        moving = v[c["ends"]] + eases[:, :, None] * impulses
        slide = (weights[:, :, None] * moving).sum(axis=1)
        slide = slide - dots(slide, n)[:, None] * n
        slide += (scale * dots(moving[:, 1] - moving[:, 0], n))[:, None] * cross(c["second"], n)
        slide += (scale * dots(moving[:, 3] - moving[:, 2], n))[:, None] * cross(n, c["first"])
        speed = np.linalg.norm(slide, axis=1)
        along = slide / np.maximum(speed, 1e-30)[:, None]
        one = (scale * dots(cross(along, c["second"]), n))[:, None] * n
        other = (scale * dots(cross(c["first"], along), n))[:, None] * n
        shares = weights[:, :, None] * along[:, None] + np.stack([-one, one, -other, other], axis=1)
        most = np.maximum((eases * dots(shares, shares)).sum(axis=1), 1e-30)
        rub = np.where(rubs, np.minimum(speed / most, c["friction"] * push), 0.0)
        return impulses - rub[:, None, None] * shares

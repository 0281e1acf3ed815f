"""Faces of a balloon that meet ridges of obstacles at rest, in NumPy and double precision, from `laws.ridges`.

All pairs of a ridge and a triangle or edge are looked at."""

from typing import Any

import numpy as np
from float64_edges import cross, dots
from float64_touch import barycentric, nearest_places
from scipy.spatial.transform import Rotation

from balloon_warp.kernels.contact.ridges import MOST_SWEEPS, SETTLED
from balloon_warp.kernels.laws.ridges import ABOVE, AT_END, LITTLE, PARTED
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model.friction import FRICTION
from balloon_warp.model.ridges import kept_distance

Array = np.ndarray


class MeetingRidges:
    """Contacts of the faces of a balloon with ridges of obstacles."""

    def __init__(self, plan: Any, p: Any, h: float):
        self.h, self.kept = h, kept_distance(plan.shapes)
        self.triangles = triangles_of(plan.shapes[0].mesh)
        sides = np.stack([self.triangles, np.roll(self.triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
        self.edges = np.unique(np.sort(sides, axis=1), axis=0)
        self.solids = [
            (obstacle, ridges, p[FRICTION][0, -1, 1 + number])
            for number, (obstacle, ridges) in enumerate(zip(plan.scene.obstacle, plan.ridges, strict=True))
            if len(ridges.ends)
        ]

    def meet(self, x: Array, v: Array, ease: Array) -> tuple[Array, Array]:
        """Return places and velocities once faces and ridges have pushed each other apart.

        Args:
            ease: inverse masses of particles.
        """
        start = x - self.h * v
        caught = [each for solid in self.solids for each in self._near(*solid, start)]
        c = {name: np.concatenate([each[name] for each in caught]) for name in caught[0]} if caught else {}
        way = self.h * np.linalg.norm(v, axis=1).max()
        c = _only(c, c["gap"] < self.kept + way) if c else c
        if not c or not len(c["gap"]):
            return x, v
        for _ in range(int(MOST_SWEEPS)):
            relative = (c["weights"][:, :, None] * v[c["corners"]]).sum(axis=1)
            excess = -dots(relative, c["normal"]) - np.maximum(c["gap"] - self.kept, 0.0) / self.h
            which = excess > 0.0
            gains = self._gains(_only(c, which), excess[which], relative[which], ease)
            x, v = x + self.h * gains, v + gains
            if self.h * excess.max() < float(SETTLED) * self.kept:
                break
        missing = float(PARTED) * np.maximum(float(LITTLE) * self.kept - c["gap"], 0.0)
        parted = _only(c, missing > 0.0) | {"friction": np.zeros(int((missing > 0.0).sum()))}
        return x + self._gains(parted, missing[missing > 0.0], 0.0, ease), v

    def _gains(self, c: Any, amount: Array, relative: Any, ease: Array) -> Array:
        """Return what particles gain where contacts are to gain an amount along their normals."""
        shares, bears = np.zeros(len(ease)), c["weights"] > 0.0
        np.add.at(shares, c["corners"], 1.0 * bears)
        n, eases = c["normal"], (c["weights"] ** 2 * (shares * ease)[c["corners"]]).sum(axis=1)
        impulse = (amount / np.maximum(eases, 1e-30))[:, None] * n
        if c["friction"].any():
            slide = relative + amount[:, None] * n
            slide = slide - dots(slide, n)[:, None] * n
            speed = np.linalg.norm(slide, axis=1)
            most = np.minimum(speed, c["friction"] * amount) / np.maximum(eases, 1e-30)
            impulse = impulse - (most / np.maximum(speed, 1e-30))[:, None] * slide
        total = np.zeros((len(ease), 3))
        np.add.at(total, c["corners"], (c["weights"] * bears)[:, :, None] * impulse[:, None])
        return ease[:, None] * total

    def _near(self, obstacle: Any, ridges: Any, friction: float, x: Array) -> list[dict[str, Array]]:
        turn = Rotation.from_euler("xyz", obstacle.rotation, degrees=True)
        places = turn.inv().apply(x - obstacle.position)
        found = []
        for number, (begin, end) in enumerate(ridges.ends):
            inward, tips = ridges.inward[number], ridges.tips[number]
            found.append(self._of_edges(places, begin, end, inward))
            faces = [
                self._of_tip(places, tip, away, inward)
                for owned, tip, away in ((1, begin, end - begin), (2, end, begin - end))
                if tips & owned
            ]
            if len(faces) == 2:  # of two tips the nearer counts
                (one, other), far = faces, 1e30
                gaps = [np.where(each["meets"], each["gap"], far) for each in faces]
                which = gaps[1] < gaps[0]
                faces = [
                    {
                        name: np.where(which.reshape(-1, *[1] * (one[name].ndim - 1)), other[name], one[name])
                        for name in one
                    }
                ]
            found += faces
        for each in found:
            each["gap"] = each["gap"] - ridges.radius
            each["normal"] = turn.apply(each["normal"])
            each["friction"] = np.full(len(each["gap"]), friction)
        return [{name: rows[each["meets"]] for name, rows in each.items()} for each in found]

    def _of_edges(self, places: Array, begin: Array, end: Array, inward: Array) -> dict[str, Array]:
        c, d = (places[self.edges[:, side]] for side in range(2))
        first, second = np.broadcast_to(end - begin, c.shape), d - c
        start = begin - c
        aa, ee, bb = dots(first, first), dots(second, second), dots(first, second)
        cc, ff = dots(first, start), dots(second, start)
        sine = aa * ee - bb**2
        skew = sine > 1e-4 * aa * ee
        s = np.where(skew, np.clip((bb * ff - cc * ee) / np.where(skew, sine, 1.0), 0.0, 1.0), 0.5)
        t = np.clip((bb * s + ff) / ee, 0.0, 1.0)
        s = np.clip((bb * t - cc) / aa, 0.0, 1.0)
        inside = c + t[:, None] * second
        meets = (s > 0.0) & (s < 1.0) & (np.minimum(t, 1.0 - t) >= float(AT_END))
        corners = np.concatenate([self.edges, self.edges[:, :1]], axis=1)
        weights = np.stack([1.0 - t, t, 0.0 * t], axis=1)
        return _near_of(inside, begin + s[:, None] * first, inward, meets, corners, weights)

    def _of_tip(self, places: Array, tip: Array, away: Array, inward: Array) -> dict[str, Array]:
        a, b, c = (places[self.triangles[:, corner]] for corner in range(3))
        met = nearest_places(np.broadcast_to(tip, a.shape), a, b, c)
        weights = barycentric(met, a, b, c, cross(b - a, c - a))
        found = _near_of(met, tip, inward, weights.max(axis=1) <= 1.0 - float(AT_END), self.triangles, weights)
        found["meets"] &= found["normal"] @ away <= float(ABOVE) * np.linalg.norm(away)
        return found


def _only(c: dict[str, Array], which: Array) -> dict[str, Array]:
    return {name: each[which] for name, each in c.items()}


def _near_of(inside: Array, at: Array, inward: Array, meets: Array, corners: Array, weights: Array) -> dict[str, Array]:
    arm = inside - at
    gap = np.linalg.norm(arm, axis=1)
    normal = arm / np.maximum(gap, 1e-30)[:, None]
    outside = (normal @ inward.T <= float(ABOVE)).all(axis=1)
    return {
        "corners": corners, "weights": weights, "normal": normal, "gap": gap, "meets": meets & outside,
    }  # fmt: skip

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
    """Contacts of the faces of a balloon with ridges of obstacles, and with spheres as ridges.

    Args:
        balls: spheres, which exchange momentum; all meet faces.
    """

    def __init__(self, plan: Any, p: Any, h: float, balls: Any):
        self.h, self.kept, self.balls = h, kept_distance(plan.shapes), balls
        self.spheres = balls.spheres if plan.scene.contact == "impulse" else []
        self.frictions = p[FRICTION][0, -1, 1:]
        self.triangles = triangles_of(plan.shapes[0].mesh)
        sides = np.stack([self.triangles, np.roll(self.triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
        self.edges = np.unique(np.sort(sides, axis=1), axis=0)
        self.solids = [
            (obstacle, ridges, self.frictions[number])
            for number, (obstacle, ridges) in enumerate(zip(plan.scene.obstacle, plan.ridges, strict=False))
            if len(ridges.ends)
        ]

    def meet(self, x: Array, v: Array, ease: Array) -> tuple[Array, Array]:
        """Return places and velocities once faces and ridges have pushed each other apart.

        Args:
            ease: inverse masses of particles.
        """
        start = x - self.h * v
        caught = [each for solid in self.solids for each in self._near(*solid, start)]
        caught += [self._of_sphere(number, start) for number in range(len(self.spheres))]
        c = {name: np.concatenate([each[name] for each in caught]) for name in caught[0]}
        speed = np.linalg.norm(v, axis=1).max()
        speed += max((np.linalg.norm(each["velocities"]) for each in self.spheres), default=0.0)
        c = _only(c, c["gap"] < c["kept"] + self.h * speed)
        if not len(c["gap"]):
            return x, v
        for _ in range(int(MOST_SWEEPS)):
            relative = (c["weights"][:, :, None] * v[c["corners"]]).sum(axis=1) - self._of_balls(c)
            excess = -dots(relative, c["normal"]) - np.maximum(c["gap"] - c["kept"], 0.0) / self.h
            which = excess > 0.0
            gains = self._gains(_only(c, which), excess[which], relative[which], ease, 1.0)
            x, v = x + self.h * gains, v + gains
            if self.h * excess.max() < float(SETTLED) * self.kept:
                break
        missing = float(PARTED) * np.maximum(float(LITTLE) * c["kept"] - c["gap"], 0.0)
        parted = _only(c, missing > 0.0) | {"friction": np.zeros(int((missing > 0.0).sum()))}
        return x + self._gains(parted, missing[missing > 0.0], 0.0, ease, 0.0), v

    def _of_balls(self, c: Any) -> Array:
        """Return the velocities of spheres at contacts."""
        moving = np.zeros_like(c["arm"])
        for number, sphere in enumerate(self.spheres):
            own = c["ball"] == number
            moving[own] = sphere["velocities"] + np.cross(sphere["spins"], c["arm"][own])
        return moving

    def _along(self, c: Any, eases: Array, shares: Array, along: Array) -> Array:
        """Return what contacts gain by 1 N s along unit vectors."""
        gains = eases[:, None] * along
        for number, sphere in enumerate(self.spheres):
            own = c["ball"] == number
            arm, turning = c["arm"][own], 2.5 / sphere["radius"] ** 2
            whole = along[own] + turning * np.cross(np.cross(arm, along[own]), arm)
            gains[own] += (shares[number] / sphere["mass"]) * whole
        return gains

    def _gains(self, c: Any, amount: Array, relative: Any, ease: Array, speeds: float) -> Array:
        """Return what particles gain where contacts are to gain an amount along their normals; spheres gain theirs.

        Args:
            speeds: 0 where all is moved without speed.
        """
        shares, bears, n = np.zeros(len(ease)), c["weights"] > 0.0, c["normal"]
        np.add.at(shares, c["corners"], 1.0 * bears)
        of_balls = np.array([(c["ball"] == number).sum() for number in range(len(self.spheres))])
        eases = (c["weights"] ** 2 * (shares * ease)[c["corners"]]).sum(axis=1)
        along = self._along(c, eases, of_balls, n)
        push = amount / np.maximum(dots(along, n), 1e-30)
        impulse = push[:, None] * n
        if c["friction"].any():
            slide = relative + push[:, None] * along
            slide = slide - dots(slide, n)[:, None] * n
            speed = np.linalg.norm(slide, axis=1)
            ahead = slide / np.maximum(speed, 1e-30)[:, None]
            easy = dots(self._along(c, eases, of_balls, ahead), ahead)
            impulse = impulse - np.minimum(speed / np.maximum(easy, 1e-30), c["friction"] * push)[:, None] * ahead
        total = np.zeros((len(ease), 3))
        np.add.at(total, c["corners"], (c["weights"] * bears)[:, :, None] * impulse[:, None])
        for number, sphere in enumerate(self.spheres):
            own = c["ball"] == number
            gain = -impulse[own].sum(axis=0) / sphere["mass"]
            torque = -np.cross(c["arm"][own], impulse[own]).sum(axis=0)
            sphere["positions"] = sphere["positions"] + (self.h if speeds else 1.0) * gain
            sphere["velocities"] = sphere["velocities"] + speeds * gain
            sphere["spins"] = sphere["spins"] + speeds * 2.5 / (sphere["mass"] * sphere["radius"] ** 2) * torque
        return ease[:, None] * total

    def _of_sphere(self, number: int, x: Array) -> dict[str, Array]:
        center = self.balls.starts[number]
        found = self._of_tip(x - center, np.zeros(3), np.zeros(3), np.zeros((2, 3)))
        found["gap"] = found["gap"] - self.spheres[number]["radius"]
        friction = self.frictions[len(self.frictions) - 1 - len(self.spheres) + number]
        return _of_solid(found, 0.0, friction, number)

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
        return [_of_solid(each, self.kept, friction, -1) for each in found]

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
        weights = np.where(weights < 1e-12, 0.0, weights)  # on an edge, whose two corners bear it alone
        found = _near_of(met, tip, inward, weights.max(axis=1) <= 1.0 - float(AT_END), self.triangles, weights)
        found["meets"] &= found["normal"] @ away <= float(ABOVE) * np.linalg.norm(away)
        return found


def _only(c: dict[str, Array], which: Array) -> dict[str, Array]:
    return {name: each[which] for name, each in c.items()}


def _of_solid(found: dict[str, Array], kept: float, friction: float, ball: int) -> dict[str, Array]:
    """Return the contacts that meet, with what they have of their solid."""
    met = _only(found, found["meets"])
    all_of = {"kept": kept, "friction": friction, "ball": ball}
    return met | {name: np.full(len(met["gap"]), value) for name, value in all_of.items()}


def _near_of(inside: Array, at: Array, inward: Array, meets: Array, corners: Array, weights: Array) -> dict[str, Array]:
    arm = inside - at
    gap = np.linalg.norm(arm, axis=1)
    normal = arm / np.maximum(gap, 1e-30)[:, None]
    outside = (normal @ inward.T <= float(ABOVE)).all(axis=1)
    return {
        "corners": corners, "weights": weights, "normal": normal, "gap": gap, "arm": inside, "meets": meets & outside,
    }  # fmt: skip

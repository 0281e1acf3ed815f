"""Small spheres that meet faces of a balloon, in NumPy and double precision, from `laws.face_contact`.

A sphere looks at all triangles, step by step until it is near one."""

from typing import Any

import numpy as np
from float64_edges import cross, dots
from float64_spheres import overlap_way, slip_impulse
from float64_touch import barycentric, nearest_places

from balloon_warp.kernels.contact.faces import LEAST_PART, MOST_LUMPED, MOST_MEETINGS, MOST_SWEEPS, SHRINKING
from balloon_warp.kernels.laws.face_contact import (
    BAND,
    FREE,
    KEPT,
    LEAST_RADIUS,
    LITTLE,
    MOST_LOOKS,
    ROUNDING,
    SAME_WAY,
)
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model.friction import FRICTION
from balloon_warp.model.tunneling import held_within, widest_opening

Array = np.ndarray
NEVER = 2.0


class MeetingFaces:
    """Contacts of small spheres with the faces of a balloon."""

    def __init__(self, plan: Any, p: Any, h: float, balls: Any):
        scene, mesh = plan.scene, plan.shapes[0].mesh
        self.h, self.balls, self.contacts, self.lumped = h, balls, 0, 0
        self.first = 1 + len(scene.obstacle)
        self.frictions, self.triangles = p[FRICTION][0, -1, self.first :], triangles_of(mesh)
        most = held_within(scene) * widest_opening(mesh) if scene.touches_spheres else 0.0
        self.small = [number for number, each in enumerate(scene.sphere) if each.radius < most]

    def meet(self, starts: Array, x: Array, v: Array, ease: Array) -> tuple[Array, Array]:
        """Return places and velocities once all small spheres have met faces.

        Args:
            starts: places before the substep.
            ease: inverse masses of particles.
        """
        x, v, moved, sweep = x.copy(), v.copy(), True, 0
        while moved and sweep < int(MOST_SWEEPS):
            moved, sweep = False, sweep + 1
            for number in self.small:
                lump: list[int] = []
                for meeting in range(int(MOST_MEETINGS) + int(MOST_LUMPED)):
                    nearest = max(1.0 - float(SHRINKING) * meeting, float(LEAST_PART))
                    which, part = self._soonest(number, nearest, starts, x)
                    if part > 1.0:
                        break
                    corners = self.triangles[which]
                    if meeting < int(MOST_MEETINGS):
                        self._impact(number, corners, part, starts, x, v, ease)
                        self.contacts += 1
                    else:
                        lump += [each for each in corners.tolist() if each not in lump]
                        self._move_lump(number, lump, starts, x, v, 1.0 / ease)
                        self.lumped += 1
                    moved = True
        return x, v

    def _radius(self, number: int, corners: Array) -> Array:
        sides = (np.linalg.norm(corners[..., side, :] - corners[..., 0, :], axis=-1) for side in (1, 2))
        return np.maximum(self.balls.spheres[number]["radius"], float(LEAST_RADIUS) * sum(sides))

    def _soonest(self, number: int, nearest: float, starts: Array, x: Array) -> tuple[int, float]:
        start = self.balls.starts[number]
        way = self.balls.spheres[number]["positions"] - start
        before = starts[self.triangles]
        ways = x[self.triangles] - before
        radius = self._radius(number, before)
        little = float(LITTLE) * radius + float(ROUNDING) * np.linalg.norm(start)
        longest = np.linalg.norm(way - ways, axis=-1).max(axis=-1)
        part, found = np.zeros(len(before)), np.full(len(before), NEVER)
        for look in range(int(MOST_LOOKS)):
            weights, arm = _seen(start + part[:, None] * way, before + part[:, None, None] * ways)
            distance = np.linalg.norm(arm, axis=1)
            nearer = -(1.0 - part) * dots(way - (weights[..., None] * ways).sum(axis=1), arm)
            meets = (distance < nearest * radius) & (nearer > little * distance)
            open_ways = (part <= 1.0) & (found > 1.0)
            found = np.where(open_ways & (meets | (look == int(MOST_LOOKS) - 1)), part, found)
            ahead = np.maximum(distance - (1.0 - 0.5 * float(BAND)) * nearest * radius, 0.5 * distance)
            further = np.where(ahead < longest, part + ahead / np.maximum(longest, 1e-300), NEVER)
            part = np.where(open_ways, further, part)
            if not ((part <= 1.0) & (found > 1.0)).any():
                break
        return int(found.argmin()), float(found.min())

    def _impact(self, number: int, corners: Array, part: float, starts: Array, x: Array, v: Array, ease: Array) -> None:
        sphere, start = self.balls.spheres[number], self.balls.starts[number]
        radius = float(self._radius(number, starts[corners]))
        corner_starts, end = starts[corners], sphere["positions"]
        places = corner_starts + part * (x[corners] - corner_starts)
        (weights,), (arm,) = _seen((start + part * (end - start))[None], places[None])
        n, nearest, seconds = arm / np.linalg.norm(arm), min(np.linalg.norm(arm), radius), (1.0 - part) * self.h
        apart, beside = end - weights @ x[corners], sphere["velocities"] - weights @ v[corners]
        bent = apart - seconds * beside
        if bent @ n > float(SAME_WAY) * np.linalg.norm(bent):
            n = bent / np.linalg.norm(bent)
        gain = max(-(beside @ n), 0.0)
        shift, inner = seconds * gain, (1.0 - float(FREE)) * radius
        gap = apart @ n + shift - inner
        shift += max(overlap_way(gap, self.h), float(KEPT) * nearest - inner - gap) if gap < 0.0 else 0.0
        mass = sphere["mass"]
        whole = 1.0 / mass + weights**2 @ ease[corners]
        slip = beside + gain * n - np.cross(sphere["spins"], bent)
        turning = 2.5 * (bent @ bent) / (sphere["radius"] ** 2 * mass)
        rub = slip_impulse(slip, n, whole + turning, self.frictions[number] * gain / whole)
        moved, pushed = (shift / whole) * n + seconds * rub, (gain / whole) * n + rub
        sphere["positions"] = end + moved / mass
        sphere["velocities"] = sphere["velocities"] + pushed / mass
        sphere["spins"] = sphere["spins"] + 2.5 / (mass * sphere["radius"] ** 2) * np.cross(-bent, rub)
        shares = -(weights * ease[corners])[:, None]
        x[corners] += shares * moved
        v[corners] += shares * pushed

    def _move_lump(self, number: int, lump: list[int], starts: Array, x: Array, v: Array, mass: Array) -> None:
        """Move a sphere and particles by their mean way and velocity."""
        sphere, start = self.balls.spheres[number], self.balls.starts[number]
        masses = np.array([sphere["mass"], *mass[lump]]) / (sphere["mass"] + mass[lump].sum())
        way = masses @ np.array([sphere["positions"] - start, *(x[lump] - starts[lump])])
        velocity = masses @ np.array([sphere["velocities"], *v[lump]])
        sphere["positions"], sphere["velocities"] = start + way, velocity
        x[lump], v[lump] = starts[lump] + way, velocity


def _seen(centers: Array, corners: Array) -> tuple[Array, Array]:
    """Return the weights of the nearest places of triangles, and the arms from there to centers."""
    a, b, c = (corners[:, corner] for corner in range(3))
    met = nearest_places(centers, a, b, c)
    return barycentric(met, a, b, c, cross(b - a, c - a)), centers - met

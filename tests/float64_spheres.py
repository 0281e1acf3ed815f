"""Spheres in NumPy and double precision: they move, meet obstacles and each other, and exchange momentum.

Written from the formulas in the documentation of the laws, not from the kernels."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from float64_parts import let_through, rolled

from balloon_warp.model.friction import FRICTION
from balloon_warp.scene import Scene

Array = np.ndarray
Sphere = dict[str, Any]
Stand = Callable[[Array, Array, Array], tuple[Array, Array, Array]]
FRICTION_OF_BALL = 3.5
"""1 + M R^2 / I of a solid ball: what slides at its surface is so much easier to stop"""


def overlap_way(gap: float, h: float) -> float:
    """Return the part of an overlap that a step removes: 10/s, at most a fifth."""
    return max(-gap, 0.0) * min(10.0 * h, 0.2)


def slip_impulse(slip: Array, normal: Array, ease: float, most: float) -> Array:
    """Return Coulomb's impulse against what slides, but no more than would stop it."""
    slip = slip - (slip @ normal) * normal
    speed = np.linalg.norm(slip)
    return np.zeros(3) if speed == 0.0 else -min(speed / ease, most) / speed * slip


def rub(sphere: Sphere, moving: Array, normal: Array, stopped: float, friction: float, seconds: float) -> None:
    """Let a sphere rub on something immovable that has changed its speed along the normal."""
    radius = sphere["radius"]
    slip = sphere["velocities"] + np.cross(sphere["spins"], -radius * normal) - moving
    gain = slip_impulse(slip, normal, FRICTION_OF_BALL, friction * stopped)
    sphere["positions"] = sphere["positions"] + seconds * gain
    sphere["velocities"] = sphere["velocities"] + gain
    sphere["spins"] = sphere["spins"] + 2.5 / radius**2 * np.cross(-radius * normal, gain)


def bounce(sphere: Sphere, normal: Array, restitution: float) -> float:
    """Let a sphere leave something at rest at the speed that it came with, times the restitution."""
    stopped = (1.0 + restitution) * max(-(sphere["velocities"] @ normal), 0.0)
    sphere["velocities"] = sphere["velocities"] + stopped * normal
    return stopped


def fell(sphere: Sphere, up: Array, h: float, gravity: float, height: float, restitution: float) -> None:
    """Advance a sphere that exchanges momentum: as far as the ground, or it turns at the speed it had before."""
    gap, rise = sphere["positions"] @ up - sphere["radius"] - height, sphere["velocities"] @ up
    sphere["velocities"] = sphere["velocities"] - h * gravity * up
    excess, stopped = h * gravity - rise - max(gap, 0.0) / h, 0.0
    if excess > 0.0:
        stopped = max(excess, -restitution * rise - sphere["velocities"] @ up)
        sphere["velocities"] = sphere["velocities"] + stopped * up
    sphere["positions"] = sphere["positions"] + h * sphere["velocities"] + overlap_way(gap, h) * up
    rub(sphere, np.zeros(3), up, stopped, sphere["friction"], h)


def beside(sphere: Sphere, start: Array, h: float, obstacles: Sequence[Any], frictions: Array) -> None:
    """Move a sphere out of obstacles at rest, in up to four turns."""
    for _ in range(4 if len(obstacles) > 1 else 1):
        met = False
        for obstacle, friction in zip(obstacles, frictions, strict=True):
            grown = obstacle.model_copy(update={"thickness": (obstacle.thickness or 0.0) + sphere["radius"]})
            low, place, normal, left = let_through(grown, start[None], sphere["positions"][None])
            if low.any():
                sphere["positions"], met = place[0], True
                stopped = bounce(sphere, normal[0], obstacle.restitution)
                rub(sphere, np.zeros(3), normal[0], stopped, friction, h * float(left[0, 0]))
        if not met:
            return


def part_of_way(start: Array, way: Array, reach: float) -> float:
    """Return after which part of its way something is so near, 0 where it begins there, 2 where it never is."""
    a, b, c = way @ way, start @ way, start @ start - reach**2
    if c <= 0.0:
        return 0.0
    if b >= 0.0 or b * b <= a * c:
        return 2.0
    part = float(c / (-b + np.sqrt(b * b - a * c)))
    return part if part <= 1.0 else 2.0


def meet(
    mine: Sphere, other: Sphere, starts: tuple[Array, Array], up: Array, h: float, gravity: float, friction: float
) -> bool:
    """Let two spheres meet on their ways, and return whether they have."""
    start, reach = starts[1] - starts[0], mine["radius"] + other["radius"]
    way = other["positions"] - mine["positions"] - start
    part = part_of_way(start, way, reach)
    if part > 1.0:
        return False
    normal = start + part * way
    normal = normal / np.linalg.norm(normal)
    approach = max(-((other["velocities"] - mine["velocities"]) @ normal), 0.0)
    rebound = 1.0 + (np.sqrt(mine["restitution"] * other["restitution"]) if approach > 2.0 * h * abs(gravity) else 0.0)
    gap = min(np.linalg.norm(start) - reach, 0.0)
    further = max(reach + gap + overlap_way(gap, h) - (start + way) @ normal, 0.0)
    shift, gain = (1.0 if gap < 0.0 else rebound) * further * normal, rebound * approach * normal
    if np.linalg.norm(shift) + h * np.linalg.norm(gain) <= 1e-6 * reach:
        return False
    common = mine["mass"] * other["mass"] / (mine["mass"] + other["mass"])
    for sphere, sign in ((mine, -1.0), (other, 1.0)):
        sphere["positions"] = sphere["positions"] + sign * common / sphere["mass"] * shift
        sphere["velocities"] = sphere["velocities"] + sign * common / sphere["mass"] * gain
    arms = mine["radius"] * normal, -other["radius"] * normal
    slip = other["velocities"] + np.cross(other["spins"], arms[1])
    slip = slip - mine["velocities"] - np.cross(mine["spins"], arms[0])
    ease = FRICTION_OF_BALL / mine["mass"] + FRICTION_OF_BALL / other["mass"]
    impulse = slip_impulse(slip, normal, ease, friction * common * np.linalg.norm(gain))
    for sphere, sign, arm in ((mine, -1.0, arms[0]), (other, 1.0, arms[1])):
        sphere["positions"] = sphere["positions"] + sign * (1.0 - part) * h / sphere["mass"] * impulse
        sphere["velocities"] = sphere["velocities"] + sign / sphere["mass"] * impulse
        inertia = 0.4 * sphere["mass"] * sphere["radius"] ** 2
        sphere["spins"] = sphere["spins"] + sign / inertia * np.cross(arm, impulse)
    return True


def collided(
    spheres: Sequence[Sphere], starts: Sequence[Array], up: Array, h: float, gravity: float, frictions: Array,
    put_beside: Callable[[int], None],
) -> None:  # fmt: skip
    """Let spheres that have moved meet each other, pair after pair, until nothing moves any more."""
    for _ in range(24):
        moving = False
        for second in range(1, len(spheres)):
            for first in range(second):
                pair = spheres[first], spheres[second]
                if meet(*pair, (starts[first], starts[second]), up, h, gravity, frictions[first, second]):
                    put_beside(first)
                    put_beside(second)
                    moving = True
        if not moving:
            return


def is_near(sphere: Sphere, x: Array, v: Array, h: float) -> Array:
    """Return which particles may meet a sphere on twice their way in a step."""
    way = h * (v - sphere["velocities"])
    arm = x - sphere["positions"] - way
    part = np.clip(-(arm * way).sum(axis=1) / np.maximum((way * way).sum(axis=1), 1e-30), 0.0, 2.0)
    return np.linalg.norm(arm + part[:, None] * way, axis=1) < 65.0 / 64.0 * sphere["radius"]


def exchanged(
    sphere: Sphere, x: Array, v: Array, mass: Array, up: Array, h: float, height: float, friction: float
) -> tuple[Array, Array]:
    """Let a sphere and particles exchange momentum, to the velocities nearest to those without contact that are
    allowed; then let particles that it presses, and the ground, rub on it. Particles of no mass are fixed."""
    center, motion, radius, heavy = (sphere[name] for name in ("positions", "velocities", "radius", "mass"))
    way = h * (v - motion)
    arm = x - center - way
    n = arm / np.linalg.norm(arm, axis=1, keepdims=True)
    gap = np.linalg.norm(arm, axis=1) - radius
    excess = -(way * n).sum(axis=1) / h - np.maximum(gap, 0.0) / h
    near = is_near(sphere, x, v, h) & (mass > 0.0)
    out = np.where(near, np.maximum(-gap, 0.0) * min(10.0 * h, 0.2), 0.0)
    sinking = -(motion @ up) - max((center - h * motion) @ up - radius - height, 0.0) / h
    change, pressed = np.zeros(3), None
    for _ in range(16):
        now = near & (n @ change + excess > 0.0), -(up @ change) + sinking > 0.0
        if pressed is not None and (now[0] == pressed[0]).all() and now[1] == pressed[1]:
            break
        pressed = now
        m = mass * pressed[0]
        ground = 1e6 * (heavy + m.sum()) * pressed[1]
        inertia = heavy * np.eye(3) + (n * m[:, None]).T @ n + ground * np.outer(up, up)
        change = -np.linalg.solve(inertia, (m * excess) @ n - ground * sinking * up)
    assert pressed is not None
    if not (pressed[0].any() or (out > 0.0).any()):
        return x, v
    m, over = mass * pressed[0], mass * (out > 0.0)
    shift = -np.linalg.solve(heavy * np.eye(3) + (n * over[:, None]).T @ n, (over * out) @ n)
    gain = np.where(pressed[0], n @ change + excess, 0.0)[:, None] * n
    rubs = _rubs(sphere, v + gain - motion - change, n, gain, arm, m, friction)
    per_mass = np.divide(rubs, m[:, None], out=np.zeros_like(rubs), where=m[:, None] > 0.0)
    x = x + h * (gain + per_mass) + np.where(out > 0.0, n @ shift + out, 0.0)[:, None] * n
    v = v + gain + per_mass
    sphere["spins"] = sphere["spins"] - 2.5 / (heavy * radius**2) * np.cross(arm, rubs).sum(axis=0)
    slowed = -rubs.sum(axis=0) / heavy
    sphere["positions"] = center + h * (change + slowed) + shift
    sphere["velocities"] = motion + change + slowed
    if pressed[1]:
        pushed = up @ (heavy * change + (m[:, None] * gain).sum(axis=0))
        rub(sphere, np.zeros(3), up, max(pushed, 0.0) / heavy, sphere["friction"], h)
    return x, v


def _rubs(sphere: Sphere, beside: Array, n: Array, gain: Array, arm: Array, mass: Array, friction: float) -> Array:
    """Return friction's impulses on the particles that a sphere presses, of which all together give no energy."""
    rubs, heavy, radius = np.zeros_like(arm), sphere["mass"], sphere["radius"]
    for number in np.flatnonzero(mass):
        ease = (1.0 + 2.5 * (arm[number] @ arm[number]) / radius**2) / heavy
        share, slip = 1.0 / (1.0 + mass.sum() * ease), beside[number] - np.cross(sphere["spins"], arm[number])
        most = friction * mass[number] * np.linalg.norm(gain[number])
        rubs[number] = slip_impulse(slip, n[number], 1.0 / (share * mass[number]), most)
    return rubs


class Spheres:
    """Spheres of a scene with parameters of its plan, which change on the way, in steps of `h` seconds."""

    def __init__(self, scene: Scene, p: dict[str, Array], h: float):
        self.scene, self.p, self.h, self.up = scene, p, h, np.array(scene.up)
        self.first = 1 + len(scene.obstacle)
        """Number of the first among all things that have friction"""
        self.spheres = [self._sphere(number) for number in range(len(scene.sphere))]

    def _sphere(self, number: int) -> Sphere:
        """State and parameters of a sphere."""
        starts = {name: self.p[f"initial_sphere_{name}"][0, number] for name in ("positions", "velocities", "spins")}
        numbers = {name: self.p[f"sphere_{name}"][0, number] for name in ("mass", "radius", "penalty", "restitution")}
        friction = self.p[FRICTION][0, self.first + number, 0]
        return {**starts, **numbers, "friction": friction, "force": np.zeros(3)}

    def places(self) -> tuple[list[Array], list[Array]]:
        """Places and velocities."""
        return [each["positions"] for each in self.spheres], [each["velocities"] for each in self.spheres]

    def move(self) -> None:
        """Move spheres beside the ground and obstacles, and let them meet each other."""
        names = ("gravity", "ground_height", "ground_restitution")
        gravity, height, restitution = (float(np.ravel(self.p[name][0])[0]) for name in names)
        starts = self.starts = [sphere["positions"] for sphere in self.spheres]
        frictions = self.p[FRICTION][0][self.first : self.first + len(starts)]

        def beside_obstacles(number: int) -> None:
            of_obstacles = frictions[number, 1 : self.first]
            beside(self.spheres[number], starts[number], self.h, self.scene.obstacle, of_obstacles)

        def put_beside(number: int) -> None:
            sphere = self.spheres[number]
            depth = height + sphere["radius"] - sphere["positions"] @ self.up
            if depth > 0.0:
                sphere["positions"] = sphere["positions"] + depth * self.up
                stopped = bounce(sphere, self.up, restitution)
                rub(sphere, np.zeros(3), self.up, stopped, sphere["friction"], self.h)
            beside_obstacles(number)

        for number, sphere in enumerate(self.spheres):
            moved = rolled if self.scene.contact == "penalty" else fell
            moved(sphere, self.up, self.h, gravity, height, restitution)
            beside_obstacles(number)
        collided(self.spheres, starts, self.up, self.h, gravity, frictions[:, self.first :], put_beside)

    def exchange(self, x: Array, v: Array, mass: Array, stand: Stand) -> tuple[Array, Array]:
        """Let each sphere exchange momentum with particles of the first balloon; those that are near one leave the
        ground and obstacles afterwards, and the others before."""
        noted = np.any([is_near(sphere, x, v, self.h) for sphere in self.spheres], axis=0)[:, None]
        out, after, _ = stand(x - self.h * v, x, v)
        x, v = np.where(noted, x, out), np.where(noted, v, after)
        height = float(np.ravel(self.p["ground_height"][0])[0])
        for number, sphere in enumerate(self.spheres):
            friction = self.p[FRICTION][0, -1, self.first + number]
            x, v = exchanged(sphere, x, v, mass, self.up, self.h, height, friction)
        out, after, _ = stand(x - self.h * v, x, v)
        return np.where(noted, out, x), np.where(noted, after, v)

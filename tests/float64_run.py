"""A scene's motion in NumPy and double precision: springs or a film, damping, weight, a pressure or a gas, the ground.

Written from the formulas, not from the kernels, so that differences of it tell what gradients are to be. Films are
those of `statics`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from balloon_warp.kernels.laws.air import density_of_given_air
from balloon_warp.kernels.laws.gas import STANDARD_PRESSURE
from balloon_warp.model import plan_model
from balloon_warp.model.friction import FRICTION
from balloon_warp.model.plan import settled_parameters
from balloon_warp.model.starts import start_of
from balloon_warp.scene import Scene
from balloon_warp.statics.of_model import film_of
from balloon_warp.statics.volume import Volume

Array = np.ndarray


def motion(scene: Scene, values: Mapping[str, float] | None = None) -> tuple[Array, Array, Array]:
    """Places and velocities of the first balloon in all frames, shape (frames + 1, n, 3), and its pressures."""
    return _Motion(scene, values or {}).frames()


class _Motion:
    def __init__(self, scene: Scene, values: Mapping[str, float]):
        plan = plan_model(scene)
        vary = {path: np.array([value]) for path, value in values.items()}
        self.plan, self.scene, self.p = plan, plan.scene, settled_parameters(plan, vary)
        self.shape = plan.shapes[0]
        self.volume = Volume(self.shape.mesh)
        self.h = 1.0 / scene.frames_per_second / plan.substeps
        self.up = np.array(scene.up)
        self.share = self.shape.mass_share
        self.gas = scene.balloon[0].inflation.kind == "gas"
        springs = self.shape.springs
        self.ends, self.lengths = springs.pairs, np.float32(springs.rest_lengths).astype(float)
        constants = np.array([self.of("structural"), self.of("shear"), self.of("flexion")])
        self.constants = constants[springs.kind]
        of_film = scene.balloon[0].material.law != "springs"
        self.film = film_of(self.scene, 0, self.shape, self.p) if of_film else None
        self.load = np.zeros(2)

    def of(self, name: str) -> Any:
        value = self.p[name][0]
        return float(np.ravel(value)[0])

    def frames(self) -> tuple[Array, Array, Array]:
        x = start_of(self.scene, self.p, 0, self.shape.mesh.points)[0]
        spin, center = self.p["initial_spins"][0, 0], self.p["initial_centers"][0, 0]
        v = self.p["initial_velocities"][0, 0] + np.cross(spin, x - center)
        self.load, self.pressure = self.p["initial_loads"][0, 0], self.of("initial_pressures")
        found = [(x, v, self.pressure)]
        for frame in range(self.scene.frames):
            mass = self._mass()
            for substep in range(self.plan.substeps):
                x, v = self._substep(x, v, mass, frame, substep / self.plan.substeps)
            found.append((x, v, self.pressure))
        points, velocities, pressures = (np.array(each) for each in zip(*found, strict=True))
        return points, velocities, pressures

    def _mass(self) -> Array:
        mass = self.of("mass")
        if self.gas:
            outside = self.of("air_pressure")
            volume = self.of("initial_free_volumes") * STANDARD_PRESSURE / (outside + self.pressure)
            mass += (
                self.of("initial_gas_amounts") * self.of("molar_mass") + self.of("added_mass") * self._air() * volume
            )
        return self.share * mass

    def _air(self) -> float:
        return density_of_given_air(*(self.of(f"air_{name}") for name in ("pressure", "temperature", "density")))

    def _substep(self, x: Array, v: Array, mass: Array, frame: int, part: float) -> tuple[Array, Array]:
        gain = (self.h / mass)[:, None]
        force = self._springs(x) + (self.share * self.of("mass") * -self.of("gravity"))[:, None] * self.up
        force -= (self.share * self.of("damping"))[:, None] * v
        area = self.volume.slopes(x)
        if self.gas:
            free = v + gain * force
            self._find_load(x, area, free, gain)
            push = self.load[0] + self.load[1] * (x @ self.up)
            v = free + gain * push[:, None] * area
        else:
            self.pressure = self._given(frame, part)
            v = v + gain * (force + self.pressure * area)
        return self._leave(x + self.h * v, v)

    def _springs(self, x: Array) -> Array:
        if self.film:
            return self.film.forces(x)
        d = x[self.ends[:, 1]] - x[self.ends[:, 0]]
        pull = d * (self.constants * (1.0 - self.lengths / np.linalg.norm(d, axis=1)))[:, None]
        force = np.zeros_like(x)
        np.add.at(force, self.ends[:, 0], pull)
        np.add.at(force, self.ends[:, 1], -pull)
        return force

    def _given(self, frame: int, part: float) -> float:
        """Linear over a frame, whose ends alone see keyframes."""
        times, values = [at for at, _ in self.scene.balloon[0].inflation.keyframes], self.p["keyframe_values"][0, 0]
        first, last = np.interp(
            [frame / self.scene.frames_per_second, (frame + 1) / self.scene.frames_per_second], times, values
        )
        return float(first + part * (last - first))

    def _find_load(self, x: Array, area: Array, free: Array, gain: Array) -> None:
        """With gamma 1, in uniform air, and backward Euler in the direction in which the gas is stiff."""
        heights = x @ self.up
        before = self.load[0] + self.load[1] * heights
        course = free + gain * before[:, None] * area
        stood, _ = self._leave(x + self.h * course, course)
        meets = self._low(x + self.h * course)[:, None]
        along = area - meets * np.outer(area @ self.up, self.up)
        swings = gain[:, 0] * (along * along).sum(axis=1)
        response, height = swings.sum(), float(self.share @ heights)
        deflected = course + (stood - x - self.h * course) / self.h
        rate = ((area * deflected).sum(axis=1) - before * swings).sum()
        volume, outside = self.volume.of(x), self.of("air_pressure")
        explicit = STANDARD_PRESSURE * self.of("initial_free_volumes") / volume - outside
        weight = self._air() - self.of("initial_gas_amounts") * self.of("molar_mass") / volume
        rise = weight * self.of("gravity")
        rate += rise * ((swings * heights).sum() - height * response)
        pull = (outside + explicit) / volume * self.h
        self.pressure = (explicit - pull * rate) / (1.0 + pull * response)
        self.load = np.array([self.pressure - rise * height, rise])

    def _low(self, x: Array) -> Array:
        if self.scene.ground is None:
            return np.zeros(len(x), dtype=bool)
        return x @ self.up < self.of("ground_height")

    def _leave(self, x: Array, v: Array) -> tuple[Array, Array]:
        """Coulomb's law: what is stopped into the ground stops at most so much along it."""
        low = self._low(x)[:, None]
        rise = (v @ self.up)[:, None]
        along, stopped = v - rise * self.up, np.maximum(-rise, 0.0)
        friction = self.p[FRICTION][0, -1, 0] if self.scene.ground is not None else 0.0
        speed = np.sqrt((along * along).sum(axis=1, keepdims=True) + 1e-20)
        lost = np.minimum(friction * stopped / speed, 1.0)
        out = x + np.maximum(self.of("ground_height") - x @ self.up, 0.0)[:, None] * self.up - self.h * lost * along
        return np.where(low, out, x), np.where(low, v - lost * along + stopped * self.up, v)

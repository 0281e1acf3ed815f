"""Motion of a scene in NumPy and double precision: springs or a film, damping, weight, a pressure or a gas, contact.

Written from the formulas, not the kernels: its differences are a reference for gradients. Films are of `statics`."""

from collections.abc import Generator, Mapping
from functools import partial
from typing import Any

import numpy as np
from float64_faces import MeetingFaces
from float64_parts import air_on_faces, directions, gusts, let_through, out_of_sphere, thrusts, torsion, water
from float64_ridges import MeetingRidges
from float64_spheres import Spheres

from balloon_warp.kernels.laws.air import GAS_CONSTANT, density_of_given_air
from balloon_warp.kernels.laws.gas import STANDARD_PRESSURE
from balloon_warp.model import plan_model
from balloon_warp.model.friction import FRICTION
from balloon_warp.model.neck import neck_of
from balloon_warp.model.plan import settled_parameters
from balloon_warp.model.starts import start_of
from balloon_warp.scene import Scene
from balloon_warp.statics.of_model import film_of
from balloon_warp.statics.volume import Volume

Array = np.ndarray


def motion(
    scene: Scene, values: Mapping[str, float] | None = None, shifts: tuple[Any, Any] = (0.0, 0.0)
) -> tuple[Array, Array, Array]:
    """Return places and velocities of the first balloon in all frames, shape (frames + 1, n, 3), and its pressures.

    Args: shifts: offsets of places and velocities at the start, with the amount of gas unchanged."""
    return started(scene, values).frames(*shifts)


def motion_of_spheres(scene: Scene, values: Mapping[str, float], shifts: Any = (0.0, 0.0)) -> tuple[Array, ...]:
    """Return places and velocities of the first balloon's particles and of spheres in all frames."""
    points, velocities, _ = (run := started(scene, values)).frames(*shifts)
    positions, motions = (np.array(track) for track in zip(*run.tracks, strict=True))
    return points, velocities, positions, motions


def started(scene: Scene, values: Mapping[str, float] | None, number: int = 0) -> "Motion":
    told = dict(values or {})
    changes = [change.model_copy(update={"set": dict(change.set)}) for change in scene.change]
    for path in [path for path in told if path.startswith("change.")]:
        which, inner = path.removeprefix("change.").split(".set.")
        changes[int(which)].set[inner] = told.pop(path)
    return Motion(scene.model_copy(update={"change": changes}), told, number)


class Motion:
    def __init__(self, scene: Scene, values: Mapping[str, float], number: int):
        plan = plan_model(scene)
        vary = {path: np.array([value]) for path, value in values.items()}
        self.plan, self.scene, self.p = plan, plan.scene, settled_parameters(plan, vary)
        self.number, self.balloon, self.shape = number, scene.balloon[number], plan.shapes[number]
        self.volume = Volume(self.shape.mesh)
        self.h = 1.0 / scene.frames_per_second / plan.substeps
        self.up = np.array(scene.up)
        self.share = self.shape.mass_share
        self.gas = self.balloon.inflation.kind == "gas"
        springs = self.shape.springs
        self.ends, self.lengths = springs.pairs, np.float32(springs.rest_lengths).astype(float)
        of_film = self.balloon.material.law != "springs"
        self.film = film_of(self.scene, number, self.shape, self.p) if of_film else None
        self.load, self.leaks_alone, neck = np.zeros(2), True, self.balloon.neck
        self.neck = neck_of(neck.at, self.shape.mesh, self.share, self.up) if neck else None
        self.balls = Spheres(self.scene, self.p, self.h)
        self.spheres = self.balls.spheres
        self.ridges = MeetingRidges(plan, self.p, self.h, self.balls) if scene.faces is True else None
        self.small = MeetingFaces(plan, self.p, self.h, self.balls)

    @property
    def constants(self) -> Array:
        """Return the constants of all springs."""
        return np.array([self.of(kind) for kind in ("structural", "shear", "flexion")])[self.shape.springs.kind]

    def _change(self, frame: int) -> None:
        """Apply the scene's planned changes for the start of a frame."""
        for change in self.plan.due_changes:
            for name in change.values if change.frame == frame else ():
                self.p[name] = self.p[name].copy()
                change.apply(name, self.p[name])

    def of(self, name: str) -> Any:
        value = self.p[name][0]
        return float(np.ravel(value)[self.number if np.size(value) == len(self.plan.shapes) else 0])

    def frames(self, shift: Any, push: Any) -> tuple[Array, Array, Array]:
        course = self.course(shift, push)
        while True:
            try:
                next(course)
            except StopIteration as end:
                return end.value

    def course(self, shift: Any, push: Any) -> Generator[None, None, tuple[Array, Array, Array]]:
        """Return all frames, waiting in each substep for the pressures of others."""
        x = start_of(self.scene, self.p, self.number, self.shape.mesh.points)[0]
        spin, center = (self.p[f"initial_{name}"][0, self.number] for name in ("spins", "centers"))
        v = self.p["initial_velocities"][0, self.number] + np.cross(spin, x - center)
        x, v = x + shift, v + push
        self.moles = self.of("initial_gas_amounts") if self.gas else 0.0
        self.load, self.pressure = self.p["initial_loads"][0, self.number], self.of("initial_pressures")
        found, self.tracks = [(x, v, self.pressure)], [self.balls.places()]
        for frame in range(self.scene.frames):
            self._change(frame)
            along = self._air_along() if self.gas else 0.0
            for substep in range(self.plan.substeps):
                part = substep / self.plan.substeps
                self.time = (frame + part) / self.scene.frames_per_second
                self._pump(frame, part)
                mass = self.share * (self.of("mass") + self.moles * self.of("molar_mass") + along)
                x, v = yield from self._substep(x, v, mass, frame, part)
            found.append((x, v, self.pressure))
            self.tracks.append(self.balls.places())
        points, velocities, pressures = (np.array(each) for each in zip(*found, strict=True))
        return points, velocities, pressures

    def _air_along(self) -> float:
        volume = self.free_volume * STANDARD_PRESSURE / (self.of("air_pressure") + self.pressure)
        return self.of("added_mass") * self._air() * volume

    @property
    def free_volume(self) -> float:
        """Return the free volume of the gas at the air's temperature, under one atmosphere."""
        return self.moles * GAS_CONSTANT * self.of("air_temperature") / STANDARD_PRESSURE

    def _pump(self, frame: int, part: float) -> None:
        """Return the gas that is pumped in: by keyframes, or as a number of moles in some time."""
        if not self.gas:
            return
        self.moles += self.h * self._given(frame, part + 0.5 / self.plan.substeps)
        during = np.clip(self.of("fill_time") - self.time, 0.0, self.h) if self.of("fill_moles") else 0.0
        self.moles += self.of("fill_moles") * during / self.of("fill_time")

    def _air(self) -> float:
        return density_of_given_air(*(self.of(f"air_{name}") for name in ("pressure", "temperature", "density")))

    def _substep(
        self, x: Array, v: Array, mass: Array, frame: int, part: float
    ) -> Generator[None, None, tuple[Array, Array]]:
        self.balls.move()
        gain = (self.h / mass)[:, None]
        force = self._springs(x) + (self.share * self.of("mass") * -self.of("gravity"))[:, None] * self.up
        force -= (self.share * self.of("damping"))[:, None] * v
        area = self.volume.slopes(x)
        force += self._drag(x, v, area)
        if self.of("face_drag") or self.of("face_friction"):
            by = self.of("face_drag"), self.of("face_friction")
            force += air_on_faces(self.shape.mesh, x, v, self._wind, self._air(), *by)
        if self.neck:
            force += thrusts(x, self.neck, self._opening(), self.load[0] + self.load[1] * (x @ self.up))
        for outer in self.scene.force:
            taken = np.zeros(len(x))
            taken[slice(None) if outer.particles is None else list(outer.particles)] = 1.0
            force += np.outer(taken * self.share / (taken @ self.share), outer.newtons)
        if self.scene.water is not None:
            numbers = (self.of(f"water_{name}") for name in ("level", "density", "drag"))
            force += water(self.shape.mesh, x, v, self.h / mass, self.up, self.of("gravity"), *numbers)
        force += torsion(self.shape, self.of("torsion"), x) if self.of("torsion") else 0.0
        if self.gas:
            free = v + gain * force
            rise, height = self._find_pressure(x, area, free, gain)
            yield
            self.moles -= self.h * self.leak(0.0) if self.leaks_alone else 0.0
            self.load = np.array([self.pressure - rise * height, rise])
            inflation = (self.load[0] + self.load[1] * (x @ self.up))[:, None] * area
            v = free + gain * inflation
        elif self.balloon.inflation.kind == "normal_force":
            if part == 0.0 or self.scene.normals == "fresh":
                self.directions = directions(self.shape.mesh, x)
            v = v + gain * (force + (inflation := 100.0 * self._given(frame, part) * self.directions))
        else:
            self.pressure = self._given(frame, part)
            v = v + gain * (force + (inflation := self.pressure * area))
        start, x = x, x + self.h * v
        if self.ridges:
            x, v = self.ridges.meet(x, v, 1.0 / mass)
        exchanges = self.spheres and self.scene.contact == "impulse"
        x, v = self.balls.exchange(x, v, mass, self._stand) if exchanges else self._leave(x, v, inflation)
        return self.small.meet(start, x, v, 1.0 / mass) if self.small.small else (x, v)

    def _springs(self, x: Array) -> Array:
        if self.film:
            return self.film.forces(x)
        d = x[self.ends[:, 1]] - x[self.ends[:, 0]]
        pull = d * (self.constants * (1.0 - self.lengths / np.linalg.norm(d, axis=1)))[:, None]
        force = np.zeros_like(x)
        np.add.at(force, self.ends[:, 0], pull)
        np.add.at(force, self.ends[:, 1], -pull)
        return force

    def _wind(self, x: Array) -> Array:
        """Return the wind by the power law of height, with gusts that it carries along."""
        wind = np.ravel(self.p["wind"][0])
        heights, shear = np.clip(x @ self.up / self.of("wind_height"), 0.0, 10.0), self.of("wind_shear")
        growth = heights**shear if shear > 0.0 else np.ones(len(x))
        steady = growth[:, None] * wind
        if not self.of("gusts"):
            return steady
        carried = (x - self.time * wind) / self.of("gust_length")
        return steady + self.of("gusts") * np.linalg.norm(wind) * gusts(carried)

    def _drag(self, x: Array, v: Array, area: Array) -> Array:
        flux = ((v - self._wind(x)) * area).sum(axis=1)
        scale = -0.5 * self._air() * self.of("drag_coefficient") * flux * np.abs(flux)
        return (scale / (area**2).sum(axis=1))[:, None] * area

    def _given(self, frame: int, part: float) -> float:
        """Interpolate linearly over a frame: keyframes are evaluated at its ends alone."""
        times, values = [at for at, _ in self.balloon.inflation.keyframes], self.p["keyframe_values"][0, self.number]
        first, last = np.interp(
            [frame / self.scene.frames_per_second, (frame + 1) / self.scene.frames_per_second], times, values
        )
        return float(first + part * (last - first))

    def _find_pressure(self, x: Array, area: Array, free: Array, gain: Array) -> tuple[float, float]:
        """Return the growth of the gas's pressure with height, and its height; finds its pressure.

        With gamma 1, in uniform air, by backward Euler in the direction in which the gas is stiff."""
        heights = x @ self.up
        before = self.load[0] + self.load[1] * heights
        course = free + gain * before[:, None] * area
        stood, _, normals = self._stand(x, x + self.h * course, course, foreseen=True)
        along = area - (area * normals).sum(axis=1, keepdims=True) * normals
        swings = gain[:, 0] * (along * along).sum(axis=1)
        response, height = swings.sum(), float(self.share @ heights)
        deflected = course + (stood - x - self.h * course) / self.h
        rate = ((area * deflected).sum(axis=1) - before * swings).sum()
        volume, outside = self.volume.of(x), self.of("air_pressure")
        explicit = STANDARD_PRESSURE * self.free_volume / volume - outside
        weight = self._air() - self.moles * self.of("molar_mass") / volume
        rise = weight * self.of("gravity")
        rate += rise * ((swings * heights).sum() - height * response)
        pull = (outside + explicit) / volume * self.h
        self.pressure = (explicit - pull * rate) / (1.0 + pull * response)
        self.slope = (outside + explicit) / self.free_volume / (1.0 + pull * response)
        """Derivative of the pressure by the free volume [Pa/m^3]"""
        return rise, height

    def leak(self, before: float) -> float:
        """Return the leak by Bernoulli's law at the substep's end, instead of the one before, which pressures know."""
        outside, mole, believed = self.of("air_pressure"), self.free_volume / self.moles, self.pressure
        self.pressure += self.slope * self.h * before * mole
        sign, volume, density = np.sign(self.pressure), mole * STANDARD_PRESSURE / outside, self._air()  # of the air
        if sign > 0.0:
            volume *= outside / (outside + believed)
            density = self.of("molar_mass") / volume
        squared = 2.0 * (self.of("leak") + self._opening()) ** 2 / (density * volume**2)
        held, driven = squared * self.slope * mole * self.h, squared * abs(self.pressure)
        flow = sign * 2.0 * driven / (held + np.sqrt(held**2 + 4.0 * driven) + 1e-300)
        self.pressure -= self.slope * self.h * flow * mole
        return flow

    def _opening(self) -> float:
        """Return the opening of the neck."""
        return 0.25 * np.pi * self.of("neck_diameter") ** 2 * self.of("neck_discharge") if self.neck else 0.0

    def _leave(self, x: Array, v: Array, inflation: Array) -> tuple[Array, Array]:
        for sphere in self.spheres:
            x, v, outward = out_of_sphere(sphere, x, v)
            push = sphere["penalty"] * np.linalg.norm(inflation, axis=1, keepdims=True) * outward
            sphere["force"] = sphere["force"] - push.sum(axis=0)
        out, after, _ = self._stand(x - self.h * v, x, v)
        return out, after

    def _stand(self, start: Array, x: Array, v: Array, foreseen: bool = False) -> tuple[Array, Array, Array]:
        """Resolve contact with obstacles and then the ground by Coulomb's law, with a bounded slide along the surface.

        Takes places, velocities and the normals of the last contact. Each contact sees the velocity that the one before
        has left, or always the predicted one."""
        normals = np.zeros_like(x)
        if foreseen:
            for sphere in self.spheres:
                x, _, outward = out_of_sphere(sphere, x, v)
                normals = np.where((outward != 0.0).any(axis=1, keepdims=True), outward, normals)
        ground = [(self._on_ground, self.p[FRICTION][0, -1, 0])] if self.scene.ground is not None else []
        of_obstacles = [
            (partial(let_through, obstacle, start), self.p[FRICTION][0, -1, 1 + number])
            for number, obstacle in enumerate(self.scene.obstacle)
        ]
        for let, friction in (*of_obstacles, *ground):
            low, place, normal, left = let(x)
            rise = (v * normal).sum(axis=1, keepdims=True)
            along, stopped = v - rise * normal, np.maximum(-rise, 0.0)
            speed = np.sqrt((along * along).sum(axis=1, keepdims=True) + 1e-20)
            lost = np.minimum(friction * stopped / speed, 1.0)
            x = np.where(low, place - self.h * left * lost * along, x)
            normals = np.where(low, normal, normals)
            if not foreseen:
                v = np.where(low, v - lost * along + stopped * normal, v)
        return x, v, normals

    def _on_ground(self, x: Array) -> tuple[Array, Array, Array, Array]:
        depth = (self.of("ground_height") - x @ self.up)[:, None]
        return depth > 0.0, x + depth * self.up, np.broadcast_to(self.up, x.shape), np.ones_like(depth)

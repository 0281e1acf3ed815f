"""The step of the reference: a scene's balloons, spheres and gases through one substep, in the order of docs/PHYSICS.md.

It is written to be read, and the arbiter of all schedules: NumPy in float64, no Warp, and no thought of speed.
"""

from collections.abc import Mapping
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from balloon_warp.reference import gas as gases
from balloon_warp.reference import laws, of_scene, solids
from balloon_warp.reference.balls import collide
from balloon_warp.reference.contacts import Contacts
from balloon_warp.scene import Scene
from balloon_warp.scene.timeline import frame_at

Array = np.ndarray


class Reference:
    """A scene in float64, advanced by substeps or by frames.

    Args:
        values: Values of the scene that are others, by their paths.
        shifts: Offsets of all particles' places [m] and velocities [m/s] at the start, numbers or (particles, 3).
    """

    def __init__(self, scene: Scene, values: Mapping[str, float] | None = None, shifts: tuple[Any, Any] = (0.0, 0.0)):
        self.plan, self.parameters = of_scene.planned(scene, dict(values or {}))
        self.scene, self.substeps = self.plan.scene, self.plan.substeps
        count = len(self.plan.shapes)
        self.balloons = [of_scene.balloon_of(self.plan, number) for number in range(count)]
        self.obstacles, self.spheres = of_scene.obstacles_of(self.plan), of_scene.spheres_of(self.parameters)
        starts = [of_scene.start_of_balloon(self.plan, self.parameters, number) for number in range(count)]
        self.x, self.v = (np.concatenate(each) + shift for each, shift in zip(zip(*starts, strict=True), shifts, strict=True))
        """Places and velocities of all particles, shape (particles, 3)"""
        self.v[np.concatenate([balloon.share for balloon in self.balloons]) == 0.0] = 0.0
        self.owner = np.repeat(np.arange(count), [len(x) for x, _ in starts])
        self.parts = [np.flatnonzero(self.owner == number) for number in range(count)]
        self.up, self.bodies = np.array(self.scene.up), []
        self.frame_number, self.substep_number = 0, 0
        given = (self.parameters[f"initial_{name}"][0] for name in ("gas_amounts", "free_volumes", "pressures", "loads"))
        self.gases = [
            SimpleNamespace(amount=n, free_volume=free, pressure=p, load=load[0], rise=load[1], along=0.0, vent=0.0)
            for n, free, p, load in zip(*given, strict=True)
        ]
        self.contacts = Contacts(self.plan, self.owner)
        self._take_parameters()

    points = property(lambda self: [self.x[part] for part in self.parts])
    velocities = property(lambda self: [self.v[part] for part in self.parts])
    pressures = property(lambda self: np.array([gas.pressure for gas in self.gases]))
    gas_amounts = property(lambda self: np.array([gas.amount for gas in self.gases]))

    @property
    def volumes(self) -> Array:
        """Volumes of the balloons [m^3]."""
        return np.array([laws.volume(x, b.faces)[0] for x, b in zip(self.points, self.balloons, strict=True)])

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return (self.frame_number + self.substep_number / self.substeps) / self.scene.frames_per_second

    @property
    def h(self) -> float:
        """Length of a substep [s]."""
        return 1.0 / self.scene.frames_per_second / self.substeps

    @staticmethod
    def lacks(scene: Scene) -> list[str]:
        """Name what a scene asks for that the reference does not have."""
        return [
            name
            for name, asked in {
                "projective": scene.solver == "projective",
                "tears": any(balloon.material.strength is not None for balloon in scene.balloon),
                "mesh obstacles": any(obstacle.shape == "mesh" for obstacle in scene.obstacle),
            }.items()
            if asked
        ]

    def frame(self) -> None:
        """Advance by the substeps that are left of a frame."""
        number = self.frame_number
        while self.frame_number == number:
            self.substep()

    def substep(self) -> None:
        """Advance by a substep."""
        if self.substep_number == 0:
            self._begin_frame()
        h, start = self.h, self.x
        self._move_spheres()
        self._pump()
        self.mass = self._masses()
        gain = np.where(self.mass > 0.0, h / np.where(self.mass > 0.0, self.mass, 1.0), 0.0)[:, None]
        each = [self._forces(number) for number in range(len(self.balloons))]
        force, area = (np.concatenate(parts) for parts in zip(*each, strict=True))
        self._drive(force)
        if self.contacts.touch:
            force += self.contacts.touch.forces(self.x, self.v, h)
        self._find_pressures(self.v + gain * force, area, gain)
        inflation = self._inflate(area)
        old, self.v = self.v, self.v + gain * (force + inflation)
        self.x = self.x + h * (old if self.scene.solver == "forward_euler" else self.v)
        if self.scene.correction != "none":
            self._correct()
        self._meet_ridges()
        self._meet_solids(start, inflation)
        self._meet_faces_and_edges(start)
        self.substep_number += 1
        if self.substep_number == self.substeps:
            self.frame_number, self.substep_number = self.frame_number + 1, 0
            self._hold_late_spheres()

    def _take_parameters(self) -> None:
        """Take parameters from the scene's, which change over time."""
        self.p = [of_scene.numbers(self.plan, self.parameters, number) for number in range(len(self.balloons))]
        self.friction = self.parameters[of_scene.FRICTION][0]
        for balloon, p in zip(self.balloons, self.p, strict=True):
            constants = np.array([p.structural, p.shear, p.flexion])[balloon.kinds] * balloon.scales
            balloon.springs.constants = constants[:, None]
        self.contacts.settle(self.parameters)
        self.waves = of_scene.waves_of(int(self.p[0].gust_seed))
        for name in ("mass", "radius", "penalty", "restitution"):
            for ball, value in zip(self.spheres, self.parameters[f"sphere_{name}"][0], strict=True):
                ball[name] = float(value)
        for ball in self.spheres:
            stiff = 2.5 / (ball["mass"] * ball["radius"] ** 2) if ball["radius"] > 0.0 else 0.0
            ball |= {"turn": np.eye(3), "turning": stiff * np.eye(3)}
        for obstacle, position in zip(self.obstacles, self.parameters["obstacle_position"][0], strict=True):
            obstacle.position = position

    def _begin_frame(self) -> None:
        """Make the changes that the scene plans, and find the air around balloons."""
        for change in self.plan.due_changes:
            if change.frame == self.frame_number:
                self.parameters = of_scene.changed(self.plan, change, self.parameters)
                self.scene = self.scene.model_copy(update={n: getattr(change.scene, n) for n in change.methods})
                self.substeps = self.scene.substeps if "substeps" in change.methods else self.substeps
                self._take_parameters()
        for x, balloon, gas, p in zip(self.points, self.balloons, self.gases, self.p, strict=True):
            gas.outside, gas.temperature, gas.density = gases.air(x[0] @ self.up, p)
            if balloon.kind == "gas":
                inside = gases.ATMOSPHERE / (gas.outside + gas.pressure)
                gas.along = p.added_mass * gas.density * gases.there(gas.free_volume, gas.temperature, p)
                gas.along *= inside ** (1.0 / p.gamma)
            gas.least = gases.EMPTY * balloon.volume * gas.outside / (gases.R * gas.temperature)
        if self.contacts.touch:
            self.contacts.touch.begin_frame(self.x, self.v, self.h)

    def _given(self, number: int, part: float) -> float:
        """Interpolate keyframes over a frame, between their values at its ends."""
        rate, values = self.scene.frames_per_second, self.parameters["keyframe_values"][0, number]
        ends = [(self.frame_number + end) / rate for end in (0, 1)]
        times = self.balloons[number].times
        first, last = np.interp(ends, times, values[: len(times)])
        return first + part * (last - first)

    def _pump(self) -> None:
        """Pump gas in, or out until a balloon is flat."""
        middle = (self.substep_number + 0.5) / self.substeps
        for number, (balloon, gas, p) in enumerate(zip(self.balloons, self.gases, self.p, strict=True)):
            if balloon.kind == "gas":
                pumped = self.h * self._given(number, middle)
                moles = gases.filled(gas, p, self.h, self.time, pumped, balloon.curve)
                if moles:
                    moles = max(moles, min(gas.least - gas.amount, 0.0))
                    gases.take(gas, moles, p, gas.temperature)

    def _masses(self) -> Array:
        """Return the masses that move: of particles, with their parts of the gas and of the air around."""
        each = zip(self.balloons, self.gases, self.p, strict=True)
        return np.concatenate([b.share * (p.mass + gas.amount * p.molar_mass + gas.along) for b, gas, p in each])

    def _forces(self, number: int) -> tuple[Array, Array]:
        """Return the forces on a balloon but for its inflation and contact, and its area vectors."""
        balloon, p, up = self.balloons[number], self.p[number], self.up
        x, v, mass = self.points[number], self.velocities[number], balloon.share[:, None] * p.mass
        _, area = laws.volume(x, balloon.faces)

        def density_at(place: Array) -> Array:
            return gases.air(laws.dot(place, up), p)[2] + 0.0 * laws.dot(place, up)

        def wind_at(place: Array) -> Array:
            return laws.wind(place, self.time, up, p, self.waves)

        force = mass * (p.helium - p.gravity) * up - balloon.share[:, None] * p.damping * v
        limit = p.correction_limit if self.scene.correction == "tarantino" else None
        force = force + laws.springs(x, v, balloon.springs, p.viscosity, p.yield_stretch, limit)
        if balloon.film:
            pull, balloon.peak = laws.membrane(x, v, balloon.film, balloon.peak, p)
            force = force + pull
        if p.torsion:
            force = force + laws.torsion(x, balloon.hinges, p.torsion)
        if p.drag_coefficient:
            force = force + laws.drag(v - wind_at(x), area, density_at(x), p.drag_coefficient)
        if p.face_drag or p.face_friction:
            force = force + laws.face_air(x, v, balloon.faces, wind_at, density_at, p.face_drag, p.face_friction)
        if self.scene.water is not None:
            moving = self.mass[self.parts[number]][:, None]
            force = force + laws.water(x, v, balloon.faces, self.h / np.where(moving > 0.0, moving, np.inf), up, p)
        if opening := self._opening(number):
            edges, gas = balloon.neck.edges, self.gases[number]
            out = np.cross(x[edges[:, 0]], x[edges[:, 1]]).sum(axis=0)
            thrust = 2.0 * opening * np.maximum(gas.load + gas.rise * (x @ up), 0.0)
            force = force - (balloon.neck.weights * thrust)[:, None] * out / np.linalg.norm(out)
        return force, area

    def _opening(self, number: int) -> float:
        """Return C_d A of a neck [m^2], 0 while it is shut."""
        p = self.p[number]
        opened = len(self.balloons[number].neck.edges) and p.neck_opens <= self.time < p.neck_closes
        return 0.25 * np.pi * p.neck_diameter**2 * p.neck_discharge if opened else 0.0

    def _drive(self, force: Array) -> None:
        """Add strings and outer forces."""
        first = np.searchsorted(self.owner, [string.balloon for string in self.scene.string])
        held = (first + self.plan.held).astype(int)
        anchors, lengths, constants = (self.parameters[f"string_{name}"][0] for name in ("anchor", "length", "stiffness"))
        force += laws.strings(self.x, held, anchors, lengths[:, None], constants[:, None])
        driven = self.plan.driven
        newtons = driven.shares[:, None] * self.parameters["force_newtons"][0][driven.forces]
        force += laws.summed(len(force), driven.particles, newtons)

    def _find_pressures(self, free: Array, area: Array, gain: Array) -> None:
        """Find the pressures of gases over the step, and let gas flow.

        Args:
            free: velocities after the step without inflation.
        """
        of_gas = [number for number, balloon in enumerate(self.balloons) if balloon.kind == "gas"]
        if not of_gas:
            return
        heights = self.x @ self.up
        loads, rises = (np.array([getattr(gas, name) for gas in self.gases]) for name in ("load", "rise"))
        before = (loads[self.owner] + rises[self.owner] * heights)[:, None]
        course = free + gain * before * area
        end = self.x + self.h * course
        stood, normals = end, np.zeros_like(end)
        for ball in self.spheres:
            stood, _, normal = solids.leave_sphere(ball, stood, course)
            normals = np.where(normal.any(axis=1, keepdims=True), normal, normals)
        stood, _, normal = solids.stand(self._around(), self.x, stood, course, self.h, foreseen=True)
        normals = np.where(normal.any(axis=1, keepdims=True), normal, normals)
        detour = np.where(gain > 0.0, (stood - end) / self.h, 0.0)
        along = area - laws.dot(area, normals) * normals
        swings = (gain * laws.dot(along, along))[:, 0]
        for number in of_gas:
            part, share, gas, p = self.parts[number], self.balloons[number].share, self.gases[number], self.p[number]
            k = (1.0 - p.breathing_damping) / (1.0 + 3.0 * p.breathing_damping)
            k, damping = (0.0, 1.0) if self.scene.solver == "forward_euler" else (k, p.breathing_damping)
            rates = laws.dot(area, course + detour - k * self.v)[:, 0] - before[:, 0] * swings
            volume = laws.volume(self.x[part], self.balloons[number].faces)[0]
            moments = swings[part].sum(), rates[part].sum(), share @ heights[part], swings[part] @ heights[part]
            now = SimpleNamespace(**{**vars(p), "breathing_damping": damping})
            gases.implicit_pressure(gas, now, self.h, volume, *moments)
        tubes = [
            (*tube.balloons, conductance)
            for tube, conductance in zip(self.scene.tube, self.parameters["tube_conductance"][0], strict=True)
        ]
        openings = [self._opening(number) + p.leak for number, p in enumerate(self.p)]
        gases.flow(self.gases, tubes, openings, self.p, self.h)

    def _inflate(self, area: Array) -> Array:
        """Return the forces of the inflation: a pressure times area vectors, or the paper's normal forces."""
        found = []
        part = self.substep_number / self.substeps
        for number, (balloon, gas) in enumerate(zip(self.balloons, self.gases, strict=True)):
            x = self.points[number]
            if balloon.kind == "normal_force":
                if self.substep_number == 0 or self.scene.normals == "fresh":
                    balloon.directions = laws.normal_directions(x, balloon.faces)
                found.append(100.0 * self._given(number, part) * balloon.directions)
                continue
            if balloon.kind == "pressure":
                gas.pressure = gas.load = self._given(number, part)
                gas.rise = 0.0
            found.append((gas.load + gas.rise * laws.dot(x, self.up)) * area[self.parts[number]])
        return np.concatenate(found)

    def _correct(self) -> None:
        """Shorten springs that are too long, in sweeps."""
        for part, balloon, p in zip(self.parts, self.balloons, self.p, strict=True):
            for _ in range(self.scene.correction_sweeps):
                given = self.x[part], self.v[part], balloon.springs, balloon.share, p.correction_limit, self.h
                self.x[part], self.v[part] = laws.shortened(*given)

    def _around(self) -> list[Any]:
        """Return the obstacles and the ground as `solids.stand` takes them."""
        of_balloons = self.friction[len(self.friction) - len(self.balloons) :][self.owner]
        around = [
            (let_through, of_balloons[:, 1 + number, None]) for number, let_through in enumerate(self._obstacles_now())
        ]
        if self.scene.ground is not None:
            around.append((self._on_ground, of_balloons[:, :1]))
        return around

    def _obstacles_now(self) -> list[Any]:
        parts = [(self.substep_number + step) / self.substeps for step in (0, 1)]
        seconds = 1.0 / self.scene.frames_per_second
        return [
            partial(solids.beside_obstacle, each, [solids.pose(each, self.frame_number, part, seconds) for part in parts])
            for each in self.obstacles
        ]

    def _on_ground(self, start: Array, x: Array) -> tuple[Array, Array, float, Array, Array]:
        depth = self.p[0].ground_height - laws.dot(x, self.up)
        low = depth > 0.0
        return x + low * depth * self.up, low * self.up, 1.0, np.zeros(3), np.where(low, 0.0, np.inf)

    def _move_spheres(self) -> None:
        """Move spheres beside the ground and obstacles, and let them meet each other."""
        p, first = self.p[0], 1 + len(self.obstacles)
        frictions = self.friction[first : first + len(self.spheres)]
        grounds = [(p.ground_height, p.ground_restitution, friction[0]) for friction in frictions]
        obstacles, restitutions = self._obstacles_now(), self.parameters["obstacle_restitution"][0]

        def leave_obstacles(number: int) -> None:
            ball, friction = self.spheres[number], frictions[number, 1:first]
            around = list(zip(obstacles, restitutions, friction, strict=True))
            solids.leave_obstacles(ball, ball["start"], around, self.h)

        def put_beside(number: int) -> None:
            solids.leave_ground(self.spheres[number], self.h, self.up, grounds[number])
            leave_obstacles(number)

        for number, ball in enumerate(self.spheres):
            ball["start"] = ball["position"]
            solids.roll(ball, self.h, self.up, p.gravity, grounds[number], self.scene.contact == "impulse")
            leave_obstacles(number)
        collide(self.spheres, frictions[:, first:], 2.0 * self.h * abs(p.gravity), self.h, put_beside)

    def _ease(self) -> Array:
        """Return the inverse masses of particles, 0 of fixed ones."""
        return np.where(self.mass > 0.0, 1.0 / np.where(self.mass > 0.0, self.mass, 1.0), 0.0)[:, None]

    def _meet_ridges(self) -> None:
        """Let faces meet ridges of obstacles and spheres."""
        part, seconds = self.substep_number / self.substeps, 1.0 / self.scene.frames_per_second
        poses = [solids.pose(each, self.frame_number, part, seconds) for each in self.obstacles]
        still = {"mass": np.inf, "turning": np.zeros((3, 3)), "radius": 0.0}
        around = [
            {"position": place, "start": place, "turn": turn, "velocity": velocity, "spin": spin, **still}
            for place, turn, velocity, spin in poses
        ]
        if self.contacts.ridges:
            around += self.spheres
            self.x, self.v = self.contacts.ridges.sweep(self.x, self.v, self._ease(), self.h, around)

    def _meet_faces_and_edges(self, start: Array) -> None:
        """Let small spheres meet faces, and then edges each other."""
        x, v, ease, ground = self.x, self.v, self._ease(), (self.p[0].ground_height, self.up)
        if self.contacts.small:
            x, v = self.contacts.small.sweep(start, x, v, ease, self.h, self.spheres)
        if self.contacts.edges:
            x, v = self.contacts.edges.sweep(x, v, ease, self.h, ground if self.scene.ground is not None else None)
        self.x, self.v = x, v

    def _meet_solids(self, start: Array, inflation: Array) -> None:
        """Leave spheres, obstacles and the ground, or exchange momentum with spheres once the others have left these."""
        x, v, moves = self.x, self.v, (self.mass > 0.0)[:, None]
        near = np.zeros(len(x), dtype=bool)
        if self.scene.contact == "penalty":
            for ball in self.spheres:
                x, v, normal = solids.leave_sphere(ball, x, v)
                ball["force"] = ball["force"] - ball["penalty"] * (laws.size(inflation) * normal * moves).sum(axis=0)
        else:
            near = np.any([near, *(solids.may_meet(ball, x, v, self.h) for ball in self.spheres)], axis=0)
        waits = near[:, None]
        out, after, _ = solids.stand(self._around(), x - self.h * v, x, v, self.h)
        x, v = np.where(waits, x, out), np.where(waits, v, after)
        if near.any():
            first = 1 + len(self.obstacles)
            for number, ball in enumerate(self.spheres):
                friction = self.friction[first + number][-len(self.balloons) :][self.owner][:, None]
                ground = self.p[0].ground_height, 0.0, self.friction[first + number, 0]
                x, v = solids.exchange(ball, x, v, self.mass, friction, self.h, self.up, ground)
            out, after, _ = solids.stand(self._around(), x - self.h * v, x, v, self.h)
            x, v = np.where(waits, out, x), np.where(waits, after, v)
        self.x, self.v = np.where(moves, x, self.x), np.where(moves, v, self.v)

    def _hold_late_spheres(self) -> None:
        """Put spheres that have not appeared back to their start."""
        for ball, sphere, start in zip(self.spheres, self.scene.sphere, of_scene.spheres_of(self.parameters), strict=True):
            if self.frame_number <= frame_at(self.scene, sphere.start) > 0:
                ball.update(start)

"""Step of the reference: a scene's balloons, gases and spheres through one substep, in the order of the product's list.

It is written to be read, and the arbiter of all schedules: NumPy in float64, no Warp, and no thought of speed.
"""

from collections.abc import Mapping
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from balloon_warp.model.friction import FRICTION
from balloon_warp.model.strings import anchors_of
from balloon_warp.reference import bodies, contact, laws, solids, tables
from balloon_warp.reference import gas as gases
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
        self.plan, self.parameters = tables.planned(scene, dict(values or {}))
        self.scene = self.plan.scene
        self.substeps: Any = self.plan.substeps
        count = len(self.plan.shapes)
        self.balloons = [tables.balloon_of(self.plan, number) for number in range(count)]
        self.owner = np.repeat(np.arange(count), [len(balloon.share) for balloon in self.balloons])
        self.parts = [np.flatnonzero(self.owner == number) for number in range(count)]
        self.things = tables.things_of(self.plan, self.owner)
        self.m = tables.movers_of(self.plan, self.parameters, self.things, shifts)
        self.meetings = tables.meetings_of(self.plan, self.things, self.owner)
        self.pushes = np.zeros((len(self.things.spheres), 3))
        """Forces of penalties on spheres [N]"""
        self.small_contacts = np.zeros(2, int)
        """Numbers of contacts of small spheres, and of those in which one moves on with faces as one"""
        self.up, self.frame_number, self.substep_number = np.array(self.scene.up), 0, 0
        names = "initial_gas_amounts", "initial_free_volumes", "initial_pressures", "initial_loads"
        given = (self.parameters[name][0] for name in names)
        self.gases = [
            SimpleNamespace(amount=n, free_volume=free, pressure=p, load=load[0], rise=load[1], along=0.0, vent=0.0)
            for n, free, p, load in zip(*given, strict=True)
        ]
        self._take_parameters()

    x = property(lambda self: self.m.x[: len(self.owner)])
    v = property(lambda self: self.m.v[: len(self.owner)])
    spheres = property(lambda self: self._solids(self.things.spheres))
    bodies = property(lambda self: self._solids(self.things.bodies))
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
        """Name the features of a scene that the reference does not have."""
        asked = {
            "projective": scene.solver == "projective",
            "tears": any(balloon.material.strength is not None for balloon in scene.balloon),
            "solids of meshes": any(solid.shape == "mesh" for solid in (*scene.obstacle, *scene.body)),
            "changes of gamma": any(path.endswith("gamma") for change in scene.change for path in change.set),
        }
        return [name for name, is_asked in asked.items() if is_asked]

    def frame(self) -> None:
        """Advance by the substeps that are left of a frame."""
        number = self.frame_number
        while self.frame_number == number:
            self.substep()

    def substep(self) -> None:
        """Advance by a substep."""
        if self.substep_number == 0:
            self._begin_frame()
        h, m, count = self.h, self.m, len(self.owner)
        m.start = m.x.copy()
        pulls = self._pull_strings()
        self._move_obstacles()
        self._move_spheres()
        self._move_bodies()
        self._pump()
        self.mass = self._masses()
        damping = np.concatenate([b.share * p.damping for b, p in zip(self.balloons, self.p, strict=True)])
        gain = np.where(self.mass > 0.0, h / np.where(self.mass > 0.0, self.mass + h * damping, 1.0), 0.0)[:, None]
        each = [self._forces(number) for number in range(len(self.balloons))]
        force, area, k = (np.concatenate(parts) for parts in zip(*each, strict=True))
        self._drive(force, pulls)
        if self.meetings.touch:
            force += self.meetings.touch.forces(self.x, self.v, h)
        others = force + k * laws.size(self.v) * self.v
        free, gain = laws.resisted(self.v, others, self._inflate(area), k, gain)
        self._find_pressures(free, area, gain)
        inflation = self._inflate(area)
        old, m.v[:count] = self.v.copy(), free + gain * inflation
        m.x[:count] = self.x + h * (old if self.scene.solver == "forward_euler" else self.v)
        if self.scene.correction != "none":
            self._correct()
        x, v = self.x.copy(), self.v.copy()
        self._meet(inflation)
        m.x[:count], m.v[:count] = np.where(gain > 0.0, self.x, x), np.where(gain > 0.0, self.v, v)
        self.substep_number += 1
        if self.substep_number == self.substeps:
            self.frame_number, self.substep_number = self.frame_number + 1, 0
            self._hold_late_spheres()

    def _solids(self, numbers: Array) -> list[dict[str, Any]]:
        """Return the state of solids, each by name."""
        m = self.m
        names = {"position": m.x, "velocity": m.v, "spin": m.spin, "turn": m.turn}
        return [{name: values[number].copy() for name, values in names.items()} for number in numbers]

    def _take_parameters(self) -> None:
        """Take parameters from the scene's, which change over time."""
        self.p = [tables.numbers(self.plan, self.parameters, number) for number in range(len(self.balloons))]
        for balloon, p in zip(self.balloons, self.p, strict=True):
            constants = np.array([p.structural, p.shear, p.flexion])[balloon.kinds] * balloon.scales
            balloon.springs.constants = constants[:, None]
        m, things, meetings, friction = self.m, self.things, self.meetings, self.parameters[FRICTION][0]
        count = len(things.shapes) + len(things.spheres)
        self.rubs = friction[:count, :count]
        """Friction of the ground, obstacles, spheres and bodies with each other"""
        self.of_particles = friction[count:][self.owner, :count]
        """And of particles with these, shape (particles, things)"""
        mass, radius = (self.parameters[f"sphere_{name}"][0] for name in ("mass", "radius"))
        m.ease[things.spheres, 0], m.radius[things.spheres] = 1.0 / mass, radius
        stiff = np.where(radius > 0.0, 2.5 / (mass * np.where(radius > 0.0, radius, 1.0) ** 2), 0.0)
        m.turning[things.spheres] = stiff[:, None, None] * np.eye(3)
        rebounds = (self.parameters[f"{thing}_restitution"][0] for thing in ("obstacle", "sphere", "body"))
        m.restitution[len(self.owner) :] = np.concatenate([[self.p[0].ground_restitution], *rebounds])
        m.x[things.ground] = self.p[0].ground_height * self.up
        if meetings.touch:
            share = np.concatenate([balloon.share for balloon in self.balloons])
            mass = (share * self.parameters["mass"][0, self.owner])[:, None]
            meetings.touch.ease = np.where(mass > 0.0, 1.0 / np.where(mass > 0.0, mass, 1.0), 0.0)
            meetings.touch.skins = tables.skins_of(self.plan, self.parameters)
        self.waves = tables.waves_of(int(self.p[0].gust_seed))

    def _begin_frame(self) -> None:
        """Make the changes that the scene plans, and find the air around balloons."""
        for change in self.plan.due_changes:
            if change.frame == self.frame_number:
                self.parameters = tables.changed(self.plan, change, self.parameters)
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
        if self.meetings.touch:
            self.meetings.touch.begin_frame(self.x, self.v, self.h)

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

    def _forces(self, number: int) -> tuple[Array, Array, Array]:
        """Return the forces on a balloon but for its inflation and contact, its area vectors, and k of -k |v| v."""
        balloon, p, up = self.balloons[number], self.p[number], self.up
        x, v, mass = self.points[number], self.velocities[number], balloon.share[:, None] * p.mass
        _, area = laws.volume(x, balloon.faces)

        def density_at(place: Array) -> Array:
            return gases.air(laws.dot(place, up), p)[2] + 0.0 * laws.dot(place, up)

        def wind_at(place: Array) -> Array:
            return laws.wind(place, self.time, up, p, self.waves)

        k = 0.0 * mass
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
            push, k = laws.water(x, v, balloon.faces, balloon.share, up, p)
            force = force + push
        if opening := self._opening(number):
            edges, gas = balloon.neck.edges, self.gases[number]
            out = np.cross(x[edges[:, 0]], x[edges[:, 1]]).sum(axis=0)
            above = np.maximum(gas.load + gas.rise * (x @ up), 0.0)
            thrust = 2.0 * opening * above * gases.nozzle(above, p.air_pressure + above, p.gamma)[1]
            force = force - (balloon.neck.weights * thrust)[:, None] * out / np.linalg.norm(out)
        return force, area, k

    def _opening(self, number: int) -> float:
        """Return C_d A of a neck [m^2], 0 while it is shut."""
        p = self.p[number]
        opened = len(self.balloons[number].neck.edges) and p.neck_opens <= self.time < p.neck_closes
        return 0.25 * np.pi * p.neck_diameter**2 * p.neck_discharge if opened else 0.0

    def _pull_strings(self) -> Array:
        """Return the forces of strings on particles, and pull at the bodies to which they are tied."""
        first = np.searchsorted(self.owner, [string.balloon for string in self.scene.string])
        held = (first + self.plan.held).astype(int)
        lengths, constants = (self.parameters[f"string_{name}"][0] for name in ("length", "stiffness"))
        time = self.frame_number + self.substep_number / self.substeps
        anchors = anchors_of(self.scene, self.plan.bodies, self.parameters, time)[0]
        tied = [(number, string.body) for number, string in enumerate(self.scene.string) if string.body is not None]
        for number, body in tied:
            arm = self.parameters["string_anchor"][0, number] - self.plan.bodies[body].center
            row = self.things.bodies[body]
            anchors[number] = self.m.x[row] + self.m.turn[row] @ arm
        pulls = laws.pulls_of_strings(self.x, held, anchors, lengths[:, None], constants[:, None])
        self.tugs = np.zeros((len(self.things.bodies), 6))
        for number, body in tied:
            row, impulse = self.things.bodies[body], -self.h * pulls[number]
            spin = self.m.turning[row] @ np.cross(anchors[number] - self.m.x[row], impulse)
            self.tugs[body] += [*(self.m.ease[row] * impulse), *spin]
        self.m.v[self.things.bodies] += self.tugs[:, :3]
        self.m.spin[self.things.bodies] += self.tugs[:, 3:]
        return laws.summed(len(self.x), held, pulls)

    def _move_obstacles(self) -> None:
        """Move obstacles over the substep, and find how they let particles and spheres through."""
        m, seconds, self.let_through = self.m, 1.0 / self.scene.frames_per_second, []
        each = zip(self.things.obstacles, self.things.shifts, self.things.turns, strict=True)
        for (row, *motion), position in zip(each, self.parameters["obstacle_position"][0], strict=True):
            parts = ((self.substep_number + end) / self.substeps for end in (0, 1))
            poses = [solids.pose(*motion, self.frame_number, part, seconds) for part in parts]
            poses = [(position + shift, *more) for shift, *more in poses]
            m.x[row], m.turn[row], m.v[row], m.spin[row] = poses[0]
            m.start[row] = m.x[row]
            self.let_through.append(partial(solids.beside_obstacle, *self.things.shapes[row], poses, self.h))

    def _move_spheres(self) -> None:
        """Move spheres beside the ground and obstacles, and let them meet each other."""
        m, h, p, up, things = self.m, self.h, self.p[0], self.up, self.things
        first, penalty = things.spheres[:1].sum() - things.ground, self.scene.contact == "penalty"
        kick, rebounds = -h * p.gravity * up, m.restitution[things.obstacles]

        def ground_of(ball: int) -> tuple[float, float, float]:
            return p.ground_height, p.ground_restitution, self.rubs[ball - things.ground, 0]

        def leave_obstacles(ball: int) -> None:
            rubs = self.rubs[ball - things.ground, 1:first]
            solids.leave_obstacles(m, ball, list(zip(self.let_through, rebounds, rubs, strict=True)), kick, h)

        def put_beside(ball: int) -> None:
            solids.leave_ground(m, ball, up, ground_of(ball), h)
            leave_obstacles(ball)

        for ball, push in zip(things.spheres, self.pushes, strict=True):
            fall = h * (penalty * m.ease[ball] * push - p.gravity * up)
            solids.roll(m, ball, up, fall, ground_of(ball), h)
            leave_obstacles(ball)
        self.pushes[:] = 0.0
        rubs = self.rubs[first:, first:]
        contact.spheres_meet(m, things.spheres, rubs, 2.0 * h * abs(p.gravity), h, put_beside)

    def _move_bodies(self) -> None:
        """Move bodies beside the ground, obstacles and each other, and let them meet spheres."""
        m, things, told = self.m, self.things, (self.h, self.p[0].gravity, self.up)
        if things.grips is None:
            return
        bodies.move(m, things.grips, lambda *ends: self.rubs[tuple(np.subtract(ends, things.ground))], *told, self.tugs)
        for ball in things.spheres[m.radius[things.spheres] > 0.0]:
            for body in things.bodies:
                rubs = self.rubs[body - things.ground, ball - things.ground]
                bodies.meet_sphere(m, body, ball, things.shapes[body], things.tensors[body], rubs, *told)

    def _drive(self, force: Array, pulls: Array) -> None:
        """Add strings and outer forces."""
        force += pulls
        driven = self.plan.driven
        newtons = driven.shares[:, None] * self.parameters["force_newtons"][0][driven.forces]
        force += laws.summed(len(force), driven.particles, newtons)

    def _find_pressures(self, free: Array, area: Array, gain: Array) -> None:
        """Find the pressures of balloons over the step, and let gas flow.

        Args:
            free: velocities after the step without inflation.
        """
        of_gas = [number for number, balloon in enumerate(self.balloons) if balloon.kind != "normal_force"]
        if not of_gas:
            return
        heights = self.x @ self.up
        loads, rises = (np.array([getattr(gas, name) for gas in self.gases]) for name in ("load", "rise"))
        before = (loads[self.owner] + rises[self.owner] * heights)[:, None]
        course = free + gain * before * area
        end = self.x + self.h * course
        stood, normals = self._foresee(end, course)
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
            if self.balloons[number].kind == "gas":
                gases.implicit_pressure(gas, now, self.h, self.balloons[number].bound, volume, *moments)
            else:
                given = self._given(number, self.substep_number / self.substeps)
                fall = 0.0 if self.scene.water is None else p.water_density * p.gravity
                enclosed = self.balloons[number].enclosed
                gases.given_pressure(gas, p, self.h, given, enclosed, fall, volume, *moments)
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
            found.append((gas.load + gas.rise * laws.dot(x, self.up)) * area[self.parts[number]])
        return np.concatenate(found)

    def _correct(self) -> None:
        """Shorten springs that are too long, in sweeps."""
        for part, balloon, p in zip(self.parts, self.balloons, self.p, strict=True):
            for _ in range(self.scene.correction_sweeps):
                given = self.x[part], self.v[part], balloon.springs, balloon.share, p.correction_limit, self.h
                self.m.x[part], self.m.v[part] = laws.shortened(*given)

    def _stands(self) -> list[tuple[Any, Array]]:
        """Return obstacles and the ground as `solids.stand` takes them."""
        around: list = [(let, self.of_particles[:, [number]]) for number, let in enumerate(self.let_through, 1)]
        if self.scene.ground is not None:
            around.append((partial(solids.on_ground, self.p[0].ground_height, self.up), self.of_particles[:, :1]))
        return around

    def _foresee(self, end: Array, course: Array) -> tuple[Array, Array]:
        """Return foreseen places of particles beside spheres, obstacles and the ground, and the normals there."""
        normals, stood, m = np.zeros_like(end), end, self.m
        for ball in self.things.spheres:
            stood, _, normal = solids.leave_sphere(m.x[ball], m.v[ball], m.radius[ball], stood, course, self.h)
            normals = np.where(normal.any(axis=1, keepdims=True), normal, normals)
        stood, _, normal = solids.stand(self._stands(), self.x, stood, course, self.h, foreseen=True)
        return stood, np.where(normal.any(axis=1, keepdims=True), normal, normals)

    def _meet(self, inflation: Array) -> None:
        """Let particles that have moved meet all."""
        m, h, things, meetings, mass = self.m, self.h, self.things, self.meetings, self.mass[:, None]
        count, ground = len(mass), self.things.ground
        m.ease[:count] = np.where(mass == 0.0, 0.0, 1.0 / np.where(mass == 0.0, 1.0, mass))
        friction = self.parameters[FRICTION][0][-len(self.balloons) :]
        if meetings.ridges:
            told = meetings.kept, friction[:, 1:], self.owner, meetings.triangles, meetings.edges
            contact.ridges_meet(m, meetings.ridges, *told, h)
        near = np.zeros((count, 1), dtype=bool)
        for ball, penalty, push in zip(things.spheres, self.parameters["sphere_penalty"][0], self.pushes, strict=True):
            if self.scene.contact == "impulse":
                near |= solids.may_meet(m, ball, count, h)
                continue
            told = m.x[ball], m.v[ball], m.radius[ball]
            m.x[:count], m.v[:count], normal = solids.leave_sphere(*told, self.x, self.v, h)
            push -= penalty * (laws.size(inflation) * normal * (m.ease[:count] > 0.0)).sum(axis=0)
        self._stand(~near)
        if near.any():  # they leave the ground and obstacles once they have met spheres
            for ball in things.spheres:
                passing = solids.passing_sphere(m, ball, mass, h)
                widest = 1.0 + 2.5 * laws.dot(passing[2], passing[2]) / m.radius[ball] ** 2
                told = self.of_particles[:, [ball - ground]], widest, h
                below = self.p[0].ground_height, self.up, self.rubs[ball - ground, 0]
                solids.exchange(m, ball, mass, passing, *told, below)
            self._stand(near)
        for body in things.bodies:
            turn = bodies.turned(m, body, things.tensors[body], h)
            told = self.x - h * self.v, self.x, self.v, 0.0, h
            passing = solids.passing_body(m, body, *things.shapes[body], turn, *told)
            widest = 1.0 + things.reach[body] ** 2 * np.linalg.norm(things.tensors[body]) / m.ease[body]
            solids.exchange(m, body, mass, passing, self.of_particles[:, [body - ground]], widest, h)
        if meetings.small:
            rubs = self.of_particles[:, np.subtract(meetings.small, ground)]
            told = meetings.small, rubs, meetings.triangles, self.owner, h
            self.small_contacts += contact.small_spheres_meet(m, *told)
        if meetings.pairs:
            below = (self.p[0].ground_height, self.up) if self.scene.ground is not None else None
            contact.skins_meet(m, *meetings.pairs, self.owner, meetings.touch.skins, h, below)
        for body in things.bodies:
            bodies.take_turn(m, body, things.tensors[body], bodies.turned(m, body, things.tensors[body], h))

    def _stand(self, of: Array) -> None:
        """Let some particles leave obstacles and the ground."""
        out, after, _ = solids.stand(self._stands(), self.x - self.h * self.v, self.x, self.v, self.h)
        self.m.x[: len(of)], self.m.v[: len(of)] = np.where(of, out, self.x), np.where(of, after, self.v)

    def _hold_late_spheres(self) -> None:
        """Put spheres that have not appeared back to their start."""
        starts = zip(self.things.spheres, self.scene.sphere, *tables.starts_of_spheres(self.parameters), strict=True)
        for ball, sphere, *start in starts:
            if self.frame_number <= frame_at(self.scene, sphere.start) > 0:
                self.m.x[ball], self.m.v[ball], self.m.spin[ball] = start

"""Step of the reference: a scene's balloons, gases and solids through one substep, in the order of the product's list.

It is written to be read, and the arbiter of all schedules: NumPy in float64, no Warp, and no thought of speed.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from balloon_warp.lab.reference import contact, laws, solids, tables
from balloon_warp.lab.reference import laws as gas
from balloon_warp.lab.reference import solids as bodies
from balloon_warp.model.obstacles import FRICTION
from balloon_warp.model.starts import anchors_of
from balloon_warp.scene import Scene
from balloon_warp.scene.load import frame_at

Array = np.ndarray


class Reference:
    """A scene in float64, advanced by substeps or by frames.

    Args:
        values: Values of the scene that are others, by their paths.
        shifts: Offsets of all particles' places [m] and velocities [m/s] at the start, numbers or (particles, 3).
    """

    def __init__(self, scene: Scene, values: Mapping[str, float] | None = None, shifts: tuple[Any, Any] = (0.0, 0.0)):
        self.plan, self.parameters = tables.planned(scene, dict(values or {}))
        self.scene, self.up = self.plan.scene, np.array(scene.up)
        self.substeps: Any = self.plan.substeps
        self.frame_number, self.substep_number = 0, 0
        self.world, self.balloons = tables.balloons_of(self.plan, self.parameters)
        self.share = np.concatenate([b.share for b in self.balloons])
        self.owner = np.repeat(np.arange(len(self.balloons)), [len(b.share) for b in self.balloons])
        self.things = tables.things_of(self.plan, self.owner)
        self.m = tables.movers_of(self.plan, self.parameters, self.things, self.owner, shifts)
        self.meetings = tables.meetings_of(self.plan, self.things, self.owner)
        self.pushes = np.zeros((len(self.things.spheres), 3))
        """Forces of penalties on spheres [N]"""
        self.small_contacts = np.zeros(2, int)
        """Numbers of contacts of small spheres, and of those in which one moves on with faces as one"""
        self._take_parameters()

    x = property(lambda self: self.m.x[: len(self.owner)])
    v = property(lambda self: self.m.v[: len(self.owner)])
    points = property(lambda self: [self.x[b.part].copy() for b in self.balloons])
    velocities = property(lambda self: [self.v[b.part].copy() for b in self.balloons])
    pressures = property(lambda self: np.array([b.pressure for b in self.balloons]))
    gas_amounts = property(lambda self: np.array([b.amount for b in self.balloons]))
    volumes = property(lambda self: np.array([laws.volume(self.x[b.part], b.faces)[0] for b in self.balloons]))
    spheres = property(lambda self: self.m.states(self.things.spheres))
    bodies = property(lambda self: self.m.states(self.things.bodies))
    time = property(lambda self: (self.frame_number + self.part) / self.scene.frames_per_second)
    part = property(lambda self: self.substep_number / self.substeps)
    h = property(lambda self: 1.0 / self.scene.frames_per_second / self.substeps)

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
        m.h, m.start, self.world.time = h, m.x.copy(), self.time
        pulls = self._pull_strings()
        self._move_obstacles()
        self._move_spheres_and_bodies()
        self._pump()
        moving = [b.share * (b.p.mass + b.amount * b.p.molar_mass + b.along) for b in self.balloons]
        mass, damping = np.concatenate(moving), np.concatenate([b.share * b.p.damping for b in self.balloons])
        gain = np.where(mass > 0.0, h / np.where(mass > 0.0, mass + h * damping, 1.0), 0.0)
        force, k = self._forces(pulls)
        area = np.concatenate([laws.volume(self.x[b.part], b.faces)[1] for b in self.balloons])
        free, gain = laws.resisted(self.v, force, self._inflate(area), k, gain)
        self._find_pressures(free, area, gain)
        inflation, old = self._inflate(area), self.v.copy()
        m.v[:count] = free + gain * inflation
        m.x[:count] = self.x + h * (old if self.scene.solver == "forward_euler" else self.v)
        for b in self.balloons * self.scene.correction_sweeps if self.scene.correction != "none" else ():
            m.x[b.part], m.v[b.part] = laws.shortened(m.x[b.part], m.v[b.part], b, h)
        x, v = self.x.copy(), self.v.copy()
        self._meet(mass, inflation)
        m.x[:count], m.v[:count] = np.where(gain > 0.0, self.x, x), np.where(gain > 0.0, self.v, v)
        self.substep_number += 1
        if self.substep_number == self.substeps:
            self.frame_number, self.substep_number = self.frame_number + 1, 0
            starts = tables.starts_of_spheres(self.parameters)
            for ball, sphere, *start in zip(self.things.spheres, self.scene.sphere, *starts, strict=True):
                if self.frame_number <= frame_at(self.scene, sphere.start) > 0:  # it has yet to appear
                    m.x[ball], m.v[ball], m.spin[ball] = start

    def _take_parameters(self) -> None:
        """Take parameters from the scene's, which change over time."""
        m, things, touch = self.m, self.things, self.meetings.touch
        for number, b in enumerate(self.balloons):
            b.p = tables.numbers(self.plan, self.parameters, number)
            stiffnesses = np.array([b.p.structural, b.p.shear, b.p.flexion])
            b.springs.constants = (stiffnesses[b.kinds] * b.scales)[:, None]
        p = self.balloons[0].p
        self.world.waves, self.world.correction = tables.waves_of(int(p.gust_seed)), self.scene.correction
        m.friction = self.parameters[FRICTION][0]
        mass, radius = (self.parameters[f"sphere_{name}"][0] for name in ("mass", "radius"))
        m.inverse_mass[things.spheres, 0], m.radius[things.spheres] = 1.0 / mass, radius
        stiff = np.where(radius > 0.0, 2.5 / (mass * np.where(radius > 0.0, radius, 1.0) ** 2), 0.0)
        m.turning[things.spheres] = stiff[:, None, None] * np.eye(3)
        rebounds = (self.parameters[f"{thing}_restitution"][0] for thing in ("obstacle", "sphere", "body"))
        m.restitution[len(self.owner) :] = np.concatenate([[p.ground_restitution], *rebounds])
        m.gravity, m.height, m.x[m.ground] = p.gravity, p.ground_height, p.ground_height * self.up
        if touch:
            mass = self.share * self.parameters["mass"][0, self.owner][:, None]
            touch.inverse_mass = np.where(mass > 0.0, 1.0 / np.where(mass > 0.0, mass, 1.0), 0.0)
            touch.skins = tables.skins_of(self.plan, self.parameters)

    def _begin_frame(self) -> None:
        """Make the changes that the scene plans, and find the air around balloons."""
        for change in self.plan.due_changes:
            if change.frame == self.frame_number:
                self.parameters = tables.changed(self.plan, change, self.parameters)
                self.scene = self.scene.model_copy(update={n: getattr(change.scene, n) for n in change.methods})
                self.substeps = self.scene.substeps if "substeps" in change.methods else self.substeps
                self._take_parameters()
        for b in self.balloons:
            gas.begin_frame(b, self.x[b.part][0] @ self.up)
        if self.meetings.touch:
            self.meetings.touch.begin_frame(self.x, self.v, self.h)

    def _given(self, b: Any, part: float) -> float:
        """Interpolate keyframes over a frame, between their values at its ends."""
        ends = [(self.frame_number + end) / self.scene.frames_per_second for end in (0, 1)]
        first, last = np.interp(ends, b.times, self.parameters["keyframe_values"][0, b.number, : len(b.times)])
        return first + part * (last - first)

    def _pump(self) -> None:
        """Pump gas in or out, and open necks."""
        for b in self.balloons:
            if b.kind == "gas":
                gas.fill(b, self.h, self.h * self._given(b, (self.substep_number + 0.5) / self.substeps))
            is_open = len(b.neck.edges) and b.p.neck_opens <= self.time < b.p.neck_closes
            b.opening = 0.25 * np.pi * b.p.neck_diameter**2 * b.p.neck_discharge if is_open else 0.0

    def _forces(self, pulls: Array) -> tuple[Array, Array]:
        """Return the forces on particles but for inflation and the water's drag -k |v| v, and k."""
        each = [sum(law(self.x[b.part], self.v[b.part], b) for law in laws.LAWS) for b in self.balloons]
        driven = self.plan.driven
        newtons = driven.shares[:, None] * self.parameters["force_newtons"][0][driven.forces]
        force = np.concatenate(each) + pulls + laws.summed(len(self.x), driven.particles, newtons)
        if self.meetings.touch:
            force += self.meetings.touch.forces(self.x, self.v, self.h)
        return force, np.concatenate([laws.resistance(self.x[b.part], b) for b in self.balloons])

    def _inflate(self, area: Array) -> Array:
        """Return the forces of the inflation: a pressure times area vectors, or the paper's normal forces."""
        found = []
        for b in self.balloons:
            if b.kind == "normal_force":
                if self.substep_number == 0 or self.scene.normals == "fresh":
                    b.directions = laws.normal_directions(self.x[b.part], b.faces)
                found.append(100.0 * self._given(b, self.part) * b.directions)
            else:
                found.append((b.load + b.rise * laws.dot(self.x[b.part], self.up)) * area[b.part])
        return np.concatenate(found)

    def _find_pressures(self, free: Array, area: Array, gain: Array) -> None:
        """Find the pressures of balloons over the step, from velocities without inflation, and let gas flow."""
        of_gas = [b for b in self.balloons if b.kind != "normal_force"]
        if not of_gas:
            return
        heights = laws.dot(self.x, self.up)
        before = np.concatenate([b.load + b.rise * heights[b.part] for b in self.balloons])
        predicted_velocity = free + gain * before * area
        end = self.x + self.h * predicted_velocity
        stood, normals = self._predict_deflection(end, predicted_velocity)
        deflection = np.where(gain > 0.0, (stood - end) / self.h, 0.0)
        along = laws.across(area, normals)
        swings = gain * laws.dot(along, along)
        for b in of_gas:
            damping = 1.0 if self.scene.solver == "forward_euler" else b.p.breathing_damping
            k = (1.0 - damping) / (1.0 + 3.0 * damping)
            rates = (laws.dot(area, predicted_velocity + deflection - k * self.v) - before * swings)[b.part, 0]
            swing, height = swings[b.part, 0], heights[b.part, 0]
            volume = laws.volume(self.x[b.part], b.faces)[0]
            moments = volume, swing.sum(), rates.sum(), b.share[:, 0] @ height, swing @ height
            if b.kind == "gas":
                gas.implicit_pressure(b, self.h, damping, *moments)
            else:
                gas.given_pressure(b, self.h, self._given(b, self.part), *moments)
        ends = ([self.balloons[number] for number in tube.balloons] for tube in self.scene.tube)
        tubes = zip(ends, self.parameters["tube_conductance"][0], strict=True)
        gas.flow(self.balloons, [(*pair, conductance) for pair, conductance in tubes], self.h)

    def _pull_strings(self) -> Array:
        """Return the forces of strings on particles, and pull at the bodies to which they are tied."""
        m, held = self.m, self.plan.held + np.searchsorted(self.owner, [each.balloon for each in self.scene.string])
        told = [self.parameters[f"string_{name}"][0][:, None] for name in ("length", "stiffness")]
        anchors = anchors_of(self.scene, self.plan.bodies, self.parameters, self.frame_number + self.part)[0]
        tied = [(number, string.body) for number, string in enumerate(self.scene.string) if string.body is not None]
        for number, body in tied:
            arm = self.parameters["string_anchor"][0, number] - self.plan.bodies[body].center
            anchors[number] = m.x[self.things.bodies[body]] + m.turn[self.things.bodies[body]] @ arm
        pulls = laws.strings(self.x[held.astype(int)], anchors, *told)
        self.tugs = np.zeros((len(self.things.bodies), 6))
        for number, body in tied:
            row, impulse = self.things.bodies[body], -self.h * pulls[number]
            spin = m.turning[row] @ np.cross(anchors[number] - m.x[row], impulse)
            self.tugs[body] += [*(m.inverse_mass[row] * impulse), *spin]
        m.v[self.things.bodies] += self.tugs[:, :3]
        m.spin[self.things.bodies] += self.tugs[:, 3:]
        return laws.summed(len(self.x), held.astype(int), pulls)

    def _move_obstacles(self) -> None:
        """Move obstacles over the substep, and find how they let particles and spheres through."""
        m, things, seconds, m.around = self.m, self.things, 1.0 / self.scene.frames_per_second, []
        each = zip(things.obstacles, things.shifts, things.turns, self.parameters["obstacle_position"][0], strict=True)
        for row, shifts, turns, position in each:
            parts = ((self.substep_number + end) / self.substeps for end in (0, 1))
            poses = [solids.pose(position + shifts, turns, self.frame_number, part, seconds) for part in parts]
            m.x[row], m.turn[row], m.v[row], m.spin[row] = poses[0]
            m.start[row] = m.x[row]
            m.around.append((partial(solids.beside_obstacle, *m.shapes[row], poses, m.h), row))
        if self.scene.ground is not None:
            m.around.append((partial(solids.on_ground, m.height, m.up), m.ground))

    def _move_spheres_and_bodies(self) -> None:
        """Move spheres and bodies beside the ground, obstacles and their likes, and let them meet."""
        m, things = self.m, self.things
        for ball, push in zip(things.spheres, self.pushes, strict=True):
            solids.roll(m, ball, m.inverse_mass[ball] * push)
            solids.leave_obstacles(m, ball)
        self.pushes[:] = 0.0
        contact.spheres_meet(m, things.spheres, solids.put_beside)
        if things.grips:
            bodies.move(m, things.grips, self.tugs)
        for ball in things.spheres[m.radius[things.spheres] > 0.0]:
            for body in things.bodies:
                bodies.meet_sphere(m, body, ball)

    def _predict_deflection(self, end: Array, predicted_velocity: Array) -> tuple[Array, Array]:
        """Return foreseen places of particles beside spheres, obstacles and the ground, and the normals there."""
        normals, stood, m = np.zeros_like(end), end, self.m
        for ball in self.things.spheres:
            stood, _, normal = solids.leave_sphere(m, ball, stood, predicted_velocity)
            normals = np.where(normal.any(axis=1, keepdims=True), normal, normals)
        stood, _, normal = solids.stand(m, self.x, stood, predicted_velocity, predicted=True)
        return stood, np.where(normal.any(axis=1, keepdims=True), normal, normals)

    def _meet(self, mass: Array, inflation: Array) -> None:
        """Let particles that have moved meet all."""
        m, h, things, meetings = self.m, self.h, self.things, self.meetings
        count = len(mass)
        m.inverse_mass[:count] = np.where(mass == 0.0, 0.0, 1.0 / np.where(mass == 0.0, 1.0, mass))
        told = m, meetings.ridges, meetings.kept, count, meetings.triangles, meetings.edges
        first = len(things.obstacles) > 0 or not len(things.bodies)
        if meetings.ridges and first:
            contact.sweep(m, contact.contacts_of_ridges(*told), h, 24)
        near = np.zeros((count, 1), dtype=bool)
        for ball, penalty, push in zip(things.spheres, self.parameters["sphere_penalty"][0], self.pushes, strict=True):
            if self.scene.contact == "impulse":
                near |= solids.may_meet(m, ball, count)
                continue
            m.x[:count], m.v[:count], normal = solids.leave_sphere(m, ball, self.x, self.v)
            push -= penalty * (laws.size(inflation) * normal * (m.inverse_mass[:count] > 0.0)).sum(axis=0)
        self._stand(~near)
        if near.any():  # they leave the ground and obstacles once they have met spheres
            for ball in things.spheres:
                solids.exchange(m, ball, mass, solids.passing_sphere(m, ball, mass))
            self._stand(near)
        if meetings.small:
            self.small_contacts += contact.small_spheres_meet(m, meetings.small, meetings.triangles)
        found, way = [], (self.x - h * self.v, self.x, self.v)
        for body in things.bodies:
            passing = solids.passing_body(m, body, bodies.turned(m, body), *way)
            found.append(contact.contacts_of_body(m, body, things.reach[body], mass, passing))
        if meetings.ridges and not first:
            found.append(contact.contacts_of_ridges(*told))
        if meetings.pairs:
            found.append(contact.contacts_of_skins(m, meetings.pairs, self.owner, meetings.touch.skins))
        if found:
            most = 300 if meetings.pairs else 50
            contact.sweep(m, np.concatenate(found), h, most, any(thing == m.ground for _, thing in m.around))
        for body in things.bodies:
            bodies.take_turn(m, body)

    def _stand(self, of: Array) -> None:
        """Let some particles leave obstacles and the ground."""
        out, after, _ = solids.stand(self.m, self.x - self.h * self.v, self.x, self.v)
        self.m.x[: len(of)], self.m.v[: len(of)] = np.where(of, out, self.x), np.where(of, after, self.v)

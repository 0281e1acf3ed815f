"""Contact in a step: the ground, obstacles, spheres and bodies around balloons, and contact of these.

All that moves has moved before it meets, in the order of `kernels.substep`.
"""

from functools import partial

import numpy as np

from balloon_warp.model.friction import FRICTION
from balloon_warp.reference import bodies, of_scene, solids
from balloon_warp.reference.balls import collide
from balloon_warp.reference.contacts import Contacts, bodies_of, things_of
from balloon_warp.reference.laws import dot, size
from balloon_warp.scene.timeline import frame_at


class Around:
    """Solids around balloons, and contacts, of a plan with its parameters.

    Args:
        owner: Balloon of each particle.
    """

    def __init__(self, plan, parameters, owner):
        self.owner, self.up, self.contacts = owner, np.array(plan.scene.up), Contacts(plan, owner)
        self.obstacles, self.spheres = of_scene.obstacles_of(plan), of_scene.spheres_of(parameters)
        self.bodies, self.things, self.kept = bodies_of(plan, parameters), things_of(plan), {}

    def settle(self, scene, parameters, p):
        """Take the scene and parameters, which change over time; `p` has those of the world."""
        self.scene, self.parameters, self.p, friction = scene, parameters, p, parameters[FRICTION][0]
        first, last = 1 + len(self.obstacles), friction.shape[0] - 1 - self.owner[-1]
        self.of_particles = friction[last:][self.owner]
        """Friction of particles with all things; spheres and bodies are after the ground and obstacles"""
        of_solids = friction[first:last]
        self.of_spheres, self.of_bodies = of_solids[: len(self.spheres)], of_solids[len(self.spheres) :]
        self.contacts.settle(parameters)
        for name in ("mass", "radius", "penalty", "restitution"):
            for ball, value in zip(self.spheres, parameters[f"sphere_{name}"][0], strict=True):
                ball[name] = float(value)
        for ball in self.spheres:
            stiff = 2.5 / (ball["mass"] * ball["radius"] ** 2) if ball["radius"] > 0.0 else 0.0
            ball |= {"turn": np.eye(3), "turning": stiff * np.eye(3)}
        restitutions = parameters["obstacle_restitution"][0]
        for obstacle, position in zip(self.obstacles, parameters["obstacle_position"][0], strict=True):
            obstacle.position = position
        self.things[0] |= {"position": p.ground_height * self.up, "restitution": p.ground_restitution}
        rebounding = [*self.things[1:], *self.bodies], [*restitutions, *parameters["body_restitution"][0]]
        for thing, restitution in zip(*rebounding, strict=True):
            thing["restitution"] = float(restitution)

    def begin_frame(self, x, v, h):
        if self.contacts.touch:
            self.contacts.touch.begin_frame(x, v, h)

    def tie(self, ties, h):
        """Pull at bodies, by number, at a place with a force, as a step begins."""
        self.tugs = np.zeros((len(self.bodies), 6))
        for number, place, force in ties:
            body = self.bodies[number]
            spin = body["turning"] @ np.cross(place - body["position"], h * force)
            self.tugs[number] += [*(h * force / body["mass"]), *spin]
        for body, tug in zip(self.bodies, self.tugs, strict=True):
            body["velocity"], body["spin"] = body["velocity"] + tug[:3], body["spin"] + tug[3:]

    def move(self, h, frame, parts):
        """Begin a step between two parts of a frame: move obstacles, spheres and bodies."""
        seconds = 1.0 / self.scene.frames_per_second
        poses = [[solids.pose(each, frame, part, seconds) for part in parts] for each in self.obstacles]
        self.h, self.let_through = h, [
            partial(solids.beside_obstacle, each, pose, h) for each, pose in zip(self.obstacles, poses, strict=True)
        ]  # fmt: skip
        for thing, (pose, _) in zip(self.things[1:], poses, strict=True):
            thing |= dict(zip(("position", "turn", "velocity", "spin"), pose, strict=True)) | {"start": pose[0]}
        self._move_spheres()
        if self.bodies:
            self._move_bodies()

    def _move_spheres(self):
        """Move spheres beside the ground and obstacles, and let them meet each other."""
        p, first = self.p, 1 + len(self.obstacles)
        kick = -self.h * p.gravity * self.up
        grounds = [(p.ground_height, p.ground_restitution, friction[0]) for friction in self.of_spheres]

        def leave_obstacles(number):
            restitutions = (thing["restitution"] for thing in self.things[1:])
            around = list(zip(self.let_through, restitutions, self.of_spheres[number, 1:first], strict=True))
            solids.leave_obstacles(self.spheres[number], self.spheres[number]["start"], around, kick, self.h)

        def put_beside(number):
            solids.leave_ground(self.spheres[number], self.h, self.up, grounds[number])
            leave_obstacles(number)

        for number, ball in enumerate(self.spheres):
            ball["start"] = ball["position"]
            solids.roll(ball, self.h, self.up, p.gravity, grounds[number], self.scene.contact == "impulse")
            leave_obstacles(number)
        collide(self.spheres, self.of_spheres[:, first:], 2.0 * self.h * abs(p.gravity), self.h, put_beside)

    def _move_bodies(self):
        """Move bodies beside the ground, obstacles and each other, and let them meet spheres."""
        first, gravity = 1 + len(self.obstacles), self.p.gravity
        last = first + len(self.spheres)
        friction = np.delete(self.of_bodies[:, : last + len(self.bodies)], np.s_[first:last], axis=1)
        things = [*self.things, *self.bodies]
        self.kept = bodies.move(self.bodies, things, friction, self.kept, self.h, gravity, self.up, self.tugs)
        for number, ball in enumerate(self.spheres):
            for body, of_body in zip(self.bodies, self.of_bodies, strict=True):
                if ball["radius"] > 0.0:
                    bodies.meet_sphere(body, ball, of_body[first + number], self.h, gravity, self.up)

    def touch(self, x, v):
        """Return the forces of balloons that touch, as a step begins."""
        return self.contacts.touch.forces(x, v, self.h) if self.contacts.touch else 0.0

    def foresee(self, x, end, course):
        """Return foreseen places of particles beside spheres, obstacles and the ground, and the normals there."""
        normals, stood = np.zeros_like(x), end
        for ball in self.spheres:
            stood, _, normal = solids.leave_sphere(ball, stood, course, self.h)
            normals = np.where(normal.any(axis=1, keepdims=True), normal, normals)
        stood, _, normal = solids.stand(self._stands(), x, stood, course, self.h, foreseen=True)
        return stood, np.where(normal.any(axis=1, keepdims=True), normal, normals)

    def meet(self, start, x, v, mass, inflation):
        """Return places and velocities of particles that were at `start`, once they have met all; solids change."""
        h, fixed, first = self.h, mass == 0.0, 1 + len(self.obstacles)
        ease = np.where(fixed, 0.0, 1.0 / np.where(fixed, 1.0, mass))[:, None]
        if self.contacts.ridges:
            x, v = self.contacts.ridges.sweep(x, v, ease, h, [*self.things[1:], *self.spheres, *self.bodies])
        near = np.zeros((len(x), 1), dtype=bool)
        if self.scene.contact == "penalty":
            for ball in self.spheres:
                x, v, normal = solids.leave_sphere(ball, x, v, h)
                ball["force"] = ball["force"] - ball["penalty"] * (size(inflation) * normal * (ease > 0.0)).sum(axis=0)
        else:  # they leave the ground and obstacles once they have met spheres
            near = np.any([near[:, 0], *(solids.may_meet(ball, x, v, h) for ball in self.spheres)], axis=0)[:, None]
        out, after, _ = solids.stand(self._stands(), x - h * v, x, v, h)
        x, v = np.where(near, x, out), np.where(near, v, after)
        if near.any():
            for number, (ball, friction) in enumerate(zip(self.spheres, self.of_spheres, strict=True)):
                ground, rubs = (self.p.ground_height, 0.0, friction[0]), self.of_particles[:, [first + number]]
                x, v = solids.exchange(ball, x, v, mass, rubs, h, self.up, ground)
            out, after, _ = solids.stand(self._stands(), x - h * v, x, v, h)
            x, v = np.where(near, out, x), np.where(near, after, v)
        for number, body in enumerate(self.bodies, first + len(self.spheres)):
            x, v = bodies.exchange(body, x, v, mass[:, None], self.of_particles[:, [number]], h)
        if self.contacts.small:
            x, v = self.contacts.small.sweep(start, x, v, ease, h, self.spheres)
        if self.contacts.edges:
            ground = (self.p.ground_height, self.up) if self.scene.ground is not None else None
            x, v = self.contacts.edges.sweep(x, v, ease, h, ground)
        for body in self.bodies:
            bodies.take_turn(body, bodies.turned(body, h))
        return x, v

    def _stands(self):
        """Return obstacles and the ground as `solids.stand` takes them."""
        around: list = [(let, self.of_particles[:, [number]]) for number, let in enumerate(self.let_through, 1)]
        if self.scene.ground is not None:
            around.append((self._on_ground, self.of_particles[:, :1]))
        return around

    def _on_ground(self, start, x):
        depth = self.p.ground_height - dot(x, self.up)
        low = depth > 0.0
        return x + low * depth * self.up, low * self.up, (False, 1.0), np.zeros(3), np.where(low, 0.0, np.inf)

    def hold_late_spheres(self, frame):
        """Put spheres that have not appeared back to their start."""
        starts = of_scene.spheres_of(self.parameters)
        for ball, sphere, start in zip(self.spheres, self.scene.sphere, starts, strict=True):
            if frame <= frame_at(self.scene, sphere.start) > 0:
                ball.update(start)

"""Scenes for the `projective` solver, and the objective of its step, whose minimum Newton's method finds."""

import numpy as np
import warp as wp
from meshes import quad_sphere
from numpy.typing import NDArray
from trajectories import stepped

from balloon_warp import Balloon, Ground, Inflation, Scene, Simulator, Sphere, Stiffness, String
from balloon_warp.lab.reference import Reference, laws

SOFT = Stiffness(structural=20.0, shear=10.0, flexion=5.0)


def kicked_balloon(iterations: int = 10, stiffness: Stiffness = SOFT, **fields) -> Scene:
    """Return a small balloon in large steps, with fixed particles, a taut string and a slack one; no contacts."""
    balloon = Balloon(
        mesh=quad_sphere(2, radius=0.5), damping=0.2, stiffness=stiffness, inflation=Inflation(k_normal=0.1), fixed=[3]
    )
    strings = [
        String(anchor=(0.0, -1.5, 0.0), particle="lowest", length=0.8),
        String(anchor=(0.0, 1.5, 0.0), particle="highest", length=2.0),
    ]
    fields = {"substeps": 1, "string": strings} | fields
    return Scene(balloon=[balloon], solver="projective", solver_iterations=iterations, **fields)


def kick(simulator: Simulator, speed: float = 3.0) -> None:
    """Give every free particle a velocity of its own."""
    shape = (1, simulator.model.particle_count, 3)
    velocities = np.random.default_rng(7).normal(0.0, speed, shape)
    velocities[:, simulator.model.particle_mass_share.numpy() == 0.0] = 0.0
    velocities = np.repeat(velocities, simulator.model.world_count, axis=0)
    wp.copy(simulator.state.velocities, wp.array(velocities, dtype=wp.vec3, device=simulator.model.device))


def full_scene(**fields) -> Scene:
    """Return a scene with changing inflation, varied springs, fixed particles, strings, a struck sphere, and ground."""
    balloon = Balloon(
        mesh=quad_sphere(3, radius=0.5),
        position=(0.0, 0.495, 0.0),
        damping=0.2,
        stiffness=Stiffness(variation=0.3),
        inflation=Inflation(k_normal=[(0.0, 0.1), (0.05, 0.3)]),
        fixed=[5],
    )
    return Scene(
        balloon=[balloon, balloon.model_copy(update={"position": (3.0, 0.6, 0.0), "mass": 0.2, "fixed": []})],
        sphere=[Sphere(position=(0.0, 1.14, 0.0), radius=0.25, mass=0.2, velocity=(0.0, -0.5, 0.0))],
        string=[String(anchor=(3.0, 2.0, 0.0), balloon=1, particle="highest", length=0.7)],
        ground=Ground(),
        **fields,
    )


def after_frames(scene: Scene, device: str, frames: int = 4, worlds: int = 1, vary=None, schedule="auto") -> Simulator:
    return stepped(Simulator(scene, device, worlds, vary, schedule), frames)


class ImplicitStep:
    """Slope of the objective of one step of backward Euler, with the springs and strings of the reference."""

    def __init__(self, simulator: Simulator):
        model, state = simulator.model, simulator.state
        self.reference, self.h = Reference(model.scene), model.step_seconds
        scene, balloon = model.scene, model.scene.balloon[0]
        self.start = state.points.numpy()[0].astype(np.float64)
        self.share = model.particle_mass_share.numpy().astype(np.float64)
        self.inertia = self.share * (balloon.mass + self.h * balloon.damping)
        inflation = np.concatenate(simulator.read_frame().inflation_forces)
        force = inflation - self.share[:, None] * balloon.mass * [0.0, scene.gravity, 0.0]
        impulse = self.share[:, None] * balloon.mass * state.velocities.numpy()[0] + self.h * force
        moves = self.inertia > 0.0
        self.free = np.zeros_like(self.start)
        self.free[moves] = self.h * impulse[moves] / self.inertia[moves, None]

    def slope(self, points: NDArray) -> NDArray:
        """Return the slope of the objective [N]."""
        parameters = (self.reference.parameters[f"string_{name}"][0] for name in ("anchor", "length", "stiffness"))
        held = self.reference.plan.held
        told = (np.reshape(each, (len(held), -1)) for each in parameters)
        pulls = laws.springs(points, 0.0 * points, self.reference.balloons[0])
        pulls += laws.summed(len(points), held, laws.strings(points[held], *told))
        return self.inertia[:, None] * (points - self.start - self.free) / self.h**2 - pulls

    def minimum(self, points: NDArray) -> NDArray:
        """Return the minimum, by Newton's method from a start, with a curvature by differences."""
        moves, aside = np.repeat(self.share > 0.0, 3), 1e-6 * np.eye(points.size)
        for _ in range(10):
            sides = [
                [self.slope(points + sign * each.reshape(-1, 3)).ravel()[moves] for each in aside[moves]]
                for sign in (1.0, -1.0)
            ]
            step = np.zeros(points.size)
            step[moves] = np.linalg.solve(np.subtract(*sides).T / 2e-6, self.slope(points).ravel()[moves])
            points = points - step.reshape(-1, 3)
        return points


def one_step(iterations: int, device: str) -> tuple[ImplicitStep, NDArray]:
    simulator = Simulator(kicked_balloon(iterations), device)
    kick(simulator)
    step = ImplicitStep(simulator)
    simulator.step_unread()
    return step, simulator.state.points.numpy()[0].astype(np.float64)

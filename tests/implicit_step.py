"""Objective of a step of the `projective` solver, whose minimum Newton's method finds."""

import numpy as np
from numpy.typing import NDArray
from projective_scenes import kick, kicked_balloon

from balloon_warp.lab.reference import Reference, laws
from balloon_warp.simulator import Simulator


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

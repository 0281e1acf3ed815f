"""Objective of a step of the `projective` solver, for Newton's method."""

import numpy as np
from numpy.typing import NDArray
from projective_scenes import SOFT, kick, kicked_balloon

from balloon_warp.simulator import Simulator


class ImplicitStep:
    """Objective of one step of backward Euler, its gradient and its Hessian, in float64 and by loops."""

    def __init__(self, simulator: Simulator):
        model, state = simulator.model, simulator.state
        self.model, self.h = model, model.step_seconds
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
        springs = model.shapes[0].springs
        constants = np.array([SOFT.structural, SOFT.shear, SOFT.flexion])
        self.springs = list(zip(springs.pairs, constants[springs.kind], springs.rest_lengths, strict=True))

    def value(self, points: NDArray) -> float:
        lag = points - self.start - self.free
        total = float((self.inertia[:, None] * lag**2).sum()) / (2.0 * self.h**2)
        for (p, q), k, length in self.springs:
            total += 0.5 * k * (np.linalg.norm(points[q] - points[p]) - length) ** 2
        for p, anchor, length, k in self.strings():
            total += 0.5 * k * max(float(np.linalg.norm(anchor - points[p])) - length, 0.0) ** 2
        return total

    def derivatives(self, points: NDArray) -> tuple[NDArray, NDArray]:
        count = len(points)
        slope = self.inertia[:, None] * (points - self.start - self.free) / self.h**2
        curvature = np.einsum("pq,ij->piqj", np.diag(self.inertia / self.h**2), np.eye(3))
        for (p, q), k, length in self.springs:
            force, block = self.pull(points[q] - points[p], k, length)
            slope[p] -= force
            slope[q] += force
            for a, b, sign in ((p, p, 1), (q, q, 1), (p, q, -1), (q, p, -1)):
                curvature[a, :, b] += sign * block
        for p, anchor, length, k in self.strings():
            if np.linalg.norm(anchor - points[p]) > length:
                force, block = self.pull(anchor - points[p], k, length)
                slope[p] -= force
                curvature[p, :, p] += block
        return slope, curvature.reshape(3 * count, 3 * count)

    def strings(self):
        model = self.model
        places = zip(model.string_particle.numpy(), model.parameters["string_anchor"].numpy()[0], strict=True)
        numbers = zip(
            model.parameters["string_length"].numpy()[0], model.parameters["string_stiffness"].numpy()[0], strict=True
        )
        return [(*place, *number) for place, number in zip(places, numbers, strict=True)]

    @staticmethod
    def pull(d: NDArray, k: float, length: float) -> tuple[NDArray, NDArray]:
        size = np.linalg.norm(d)
        along = np.outer(d, d) / size**2
        return k * (size - length) * d / size, k * (along + (1.0 - length / size) * (np.eye(3) - along))

    def minimum(self, points: NDArray) -> NDArray:
        """Return the minimum, by Newton's method from a start."""
        moves = np.repeat(self.share > 0.0, 3)
        for _ in range(30):
            slope, curvature = self.derivatives(points)
            step = np.zeros(points.size)
            step[moves] = np.linalg.solve(curvature[np.ix_(moves, moves)], slope.ravel()[moves])
            points = points - step.reshape(-1, 3)
        return points


def one_step(iterations: int, device: str) -> tuple[ImplicitStep, NDArray]:
    simulator = Simulator(kicked_balloon(iterations), device)
    kick(simulator)
    step = ImplicitStep(simulator)
    simulator.step_unread()
    return step, simulator.state.points.numpy()[0].astype(np.float64)

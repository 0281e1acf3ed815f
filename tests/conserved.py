"""Conserved quantities of a simulation's first world, in float64."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.simulator import Simulator


def masses(simulator: Simulator) -> NDArray[np.float64]:
    """Return the moving mass of each particle [kg], with its share of the balloon's gas, shape (particle_count,)."""
    model = simulator.model
    amounts = simulator.state.gas_amounts.numpy()[0]
    parts = []
    for balloon, shape, amount in zip(model.scene.balloon, model.shapes, amounts, strict=True):
        gas = amount * balloon.inflation.molar_mass if balloon.inflation.kind == "gas" else 0.0
        parts.append((balloon.mass + gas) * shape.mass_share)
    return np.concatenate(parts)


def motion(simulator: Simulator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points [m] and velocities [m/s] of the particles, shape (particle_count, 3)."""
    state = simulator.state
    return state.points.numpy()[0].astype(np.float64), state.velocities.numpy()[0].astype(np.float64)


def momentum(simulator: Simulator) -> NDArray[np.float64]:
    """Return the momentum of the balloons [kg m/s], shape (3,)."""
    _, velocities = motion(simulator)
    return masses(simulator) @ velocities


def angular_momentum(simulator: Simulator) -> NDArray[np.float64]:
    """Return the angular momentum of the balloons about the origin [kg m^2/s], shape (3,)."""
    points, velocities = motion(simulator)
    return masses(simulator) @ np.cross(points, velocities)


def energy(simulator: Simulator) -> float:
    """Return the energy of the first balloon's motion and springs [J], from the scene's own numbers."""
    shape, balloon = simulator.model.shapes[0], simulator.model.scene.balloon[0]
    points, velocities = motion(simulator)
    kinds = np.array([balloon.stiffness.structural, balloon.stiffness.shear, balloon.stiffness.flexion])
    first, second = points[shape.springs.pairs].swapaxes(0, 1)
    strain = np.linalg.norm(second - first, axis=1) - shape.springs.rest_lengths
    moving = balloon.mass * shape.mass_share
    return float(0.5 * (kinds[shape.springs.kind] @ strain**2 + moving @ (velocities**2).sum(axis=1)))


def put(simulator: Simulator, points: NDArray | None = None, velocities: NDArray | None = None) -> None:
    """Set the places of the particles, all worlds alike, shape (particle_count, 3)."""
    for array, values in ((simulator.state.points, points), (simulator.state.velocities, velocities)):
        if values is not None:
            rows = np.broadcast_to(values, (*array.shape, 3))
            wp.copy(array, wp.array(rows, dtype=wp.vec3, device=simulator.model.device))


def sphere_momenta(simulator: Simulator) -> NDArray[np.float64]:
    """Return the momenta of the spheres [kg m/s], with their next push by the paper's rule, shape (sphere_count, 3)."""
    model, state = simulator.model, simulator.state
    velocities, forces = (a.numpy()[0].astype(np.float64) for a in (state.sphere_velocities, state.sphere_forces))
    coming = model.step_seconds * forces if model.scene.contact == "penalty" else 0.0
    return model.parameters["sphere_mass"].numpy()[0, :, None] * velocities + coming


def sphere_energies(simulator: Simulator) -> NDArray[np.float64]:
    """Return the energies of the spheres' motion [J], shape (sphere_count,)."""
    return (sphere_momenta(simulator) ** 2).sum(axis=1) / (
        2.0 * simulator.model.parameters["sphere_mass"].numpy()[0].astype(np.float64)
    )

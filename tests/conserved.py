"""Conserved quantities of a simulation's first world, in float64, and how tests place and advance it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from trajectories import stepped

from balloon_warp import Frame, Simulator
from balloon_warp.schedules.gather import ScatterSchedule


def masses(simulator: Simulator) -> NDArray[np.float64]:
    """Return the moving mass of each particle [kg], with its share of the balloon's gas, shape (particle_count,)."""
    model = simulator.model
    skins, amounts = model.parameters["mass"].numpy()[0], simulator.state.gas_amounts.numpy()[0]
    parts = []
    for balloon, shape, skin, amount in zip(model.scene.balloon, model.shapes, skins, amounts, strict=True):
        gas = amount * balloon.inflation.molar_mass if balloon.inflation.kind == "gas" else 0.0
        parts.append((skin + gas) * shape.mass_share)
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
    """Return the energy of motion and springs of all balloons [J], from the scene's own numbers."""
    points, velocities = motion(simulator)
    total = 0.5 * masses(simulator) @ (velocities**2).sum(axis=1)
    for number, (shape, balloon) in enumerate(zip(simulator.model.shapes, simulator.model.scene.balloon, strict=True)):
        kinds = np.array([balloon.stiffness.structural, balloon.stiffness.shear, balloon.stiffness.flexion])
        first, second = points[shape.springs.pairs + simulator.model.particle_offsets[number]].swapaxes(0, 1)
        strain = np.linalg.norm(second - first, axis=1) - shape.springs.rest_lengths
        total += 0.5 * kinds[shape.springs.kind] @ strain**2
    return float(total)


def put(simulator: Simulator, points: NDArray | None = None, velocities: NDArray | None = None) -> None:
    """Set the places of the particles, all worlds alike, shape (particle_count, 3)."""
    for array, values in ((simulator.state.points, points), (simulator.state.velocities, velocities)):
        if values is not None:
            rows = np.broadcast_to(values, (*array.shape, 3))
            wp.copy(array, wp.array(rows, dtype=wp.vec3, device=simulator.model.device))


def advanced(simulator: Simulator, frames: int) -> Frame:
    """Return the frame after so many more."""
    return stepped(simulator, frames).read_frame()


def after_each(simulator: Simulator, frames: int, measure: Callable[[Simulator], Any]) -> list[Any]:
    """Return measurements after each of so many more frames."""
    found = []
    for _ in range(frames):
        simulator.step_unread()
        found.append(measure(simulator))
    return found


def most_in(simulator: Simulator, frames: int, *measures: Callable[[Simulator], float]) -> list[float]:
    """Return the most of each measurement after any of so many more frames."""
    return np.max(after_each(simulator, frames, lambda each: [measure(each) for measure in measures]), axis=0).tolist()


def speed(simulator: Simulator) -> float:
    """Return the speed of the fastest particle [m/s]."""
    return float(np.linalg.norm(motion(simulator)[1], axis=1).max())


def forces_by_scatter(simulator: Simulator) -> NDArray[np.float32]:
    """Return the net forces on the particles [N], as `scatter` sums them, shape (particle_count, 3)."""
    scatter = ScatterSchedule(simulator.model)
    scatter.sum_forces(simulator.state)
    return scatter.forces.numpy()[0]


def assert_goes_on_alike(one: Simulator, other: Simulator, frames: int) -> None:
    """Require that another simulator that gets the state of one goes on to the same bits."""
    other.restore({name: array.numpy().copy() for name, array in one.state.arrays.items()})
    for simulator in (one, other):
        advanced(simulator, frames)
    for name, array in one.state.arrays.items():
        np.testing.assert_array_equal(array.numpy(), other.state.arrays[name].numpy(), err_msg=name)


def sphere_momenta(simulator: Simulator) -> NDArray[np.float64]:
    """Return the momenta of the spheres [kg m/s], with their next push by the paper's rule, shape (sphere_count, 3)."""
    model, state = simulator.model, simulator.state
    velocities, forces = (a.numpy()[0].astype(np.float64) for a in (state.sphere_velocities, state.sphere_forces))
    coming = model.step_seconds * forces if model.scene.contact == "penalty" else 0.0
    return model.parameters["sphere_mass"].numpy()[0, :, None] * velocities + coming


def sphere_spins(simulator: Simulator) -> NDArray[np.float64]:
    """Return the spins of the spheres [rad/s], shape (sphere_count, 3)."""
    return simulator.state.sphere_spins.numpy()[0].astype(np.float64)


def sphere_inertias(simulator: Simulator) -> NDArray[np.float64]:
    """Return the inertias of the spheres 2/5 M R^2 [kg m^2], shape (sphere_count, 1)."""
    mass, radius = (simulator.model.parameters[f"sphere_{name}"].numpy()[0, :, None] for name in ("mass", "radius"))
    return 0.4 * mass.astype(np.float64) * radius.astype(np.float64) ** 2


def sphere_turning(simulator: Simulator) -> NDArray[np.float64]:
    """Return the angular momentum of all spheres about the origin [kg m^2/s], shape (3,)."""
    centers = simulator.state.sphere_positions.numpy()[0].astype(np.float64)
    own = sphere_inertias(simulator) * sphere_spins(simulator)
    return (np.cross(centers, sphere_momenta(simulator)) + own).sum(axis=0)


def sphere_energies(simulator: Simulator) -> NDArray[np.float64]:
    """Return the energies of the spheres' motion and spin [J], shape (sphere_count,)."""
    masses = simulator.model.parameters["sphere_mass"].numpy()[0].astype(np.float64)
    spinning = 0.5 * (sphere_inertias(simulator) * sphere_spins(simulator) ** 2).sum(axis=1)
    return (sphere_momenta(simulator) ** 2).sum(axis=1) / (2.0 * masses) + spinning


def whole(simulator: Simulator) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return momentum, angular momentum and energy of balloons and spheres together."""
    total, turning = momentum(simulator) + sphere_momenta(simulator).sum(axis=0), angular_momentum(simulator)
    return total, turning + sphere_turning(simulator), energy(simulator) + float(sphere_energies(simulator).sum())

"""Buoyancy and weight of gas in the air around it."""

import numpy as np
import pytest
from gas_balloons import advanced, gas_balloon, with_volume
from meshes import quad_sphere

from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics


def test_helium_lifts_by_the_difference_of_densities(device: str):
    """A helium balloon of 28 cm lifts 11.93 g, straight up, and without a torque about the center."""
    mesh = with_volume(quad_sphere(4), np.pi / 6.0 * 0.28**3)
    scene = Scene(balloon=[gas_balloon(mesh, mass=0.003)], net_forces=True)
    simulator = Simulator(scene, device)
    forces = simulator.read_frame().net_forces[0].astype(np.float64)
    lifted = forces.sum(axis=0) / 9.81 + [0.0, 0.003, 0.0]
    np.testing.assert_allclose(lifted, [0.0, 11.93e-3, 0.0], atol=5e-6)
    np.testing.assert_allclose(np.cross(mesh.points, forces).sum(axis=0), 0.0, atol=1e-6)


def test_a_balloon_of_air_weighs_its_rubber_and_the_gas_moves_along(device: str):
    """A balloon of air falls by m g on a mass of m + n M, in air as dense as its gas."""
    mesh = with_volume(quad_sphere(3), 0.01)
    balloon = gas_balloon(mesh, {"molar_mass": 0.0289652}, mass=0.004)
    scene = Scene(balloon=[balloon], frames_per_second=10, substeps=200)
    velocities = advanced(Simulator(scene, device), 1).velocities[0]
    acceleration = 9.81 * 0.004 / (0.004 + 1.20412 * 0.01)
    np.testing.assert_allclose(velocities[:, 1].mean(), -0.1 * acceleration, rtol=1e-3)


def test_density_follows_pressure_and_temperature_where_the_scene_says_none(device: str):
    """Density follows the ideal gas law per world: half the pressure at the same temperature is half the density, of
    air and gas, at the start and on the device a step later."""
    mesh = with_volume(quad_sphere(3), 0.01)
    scene = Scene(balloon=[gas_balloon(mesh, mass=0.003)], net_forces=True, frames_per_second=1e6, substeps=1)
    vary = {"atmosphere.pressure": [101325.0, 50662.5, 101325.0], "atmosphere.temperature": [293.15, 293.15, 586.3]}
    simulator = Simulator(scene, device, 3, vary)
    for _ in range(2):
        lifted = [simulator.read_frame(world).net_forces[0][:, 1].sum() / 9.81 + 0.003 for world in range(3)]
        np.testing.assert_allclose(lifted, [10.377e-3, 5.189e-3, 5.189e-3], rtol=1e-3)
        simulator.step()

"""Rubber and film in motion: conservation, damping, and a balloon of two flat discs of foil."""

from typing import Any

import numpy as np
import pytest
from conserved import put
from meshes import mesh_of, quad_sphere
from numpy.typing import NDArray
from rubber_theory import ENERGIES, MATERIALS, quad_energy, relaxed

from balloon_warp.kernels.laws.air import GAS_CONSTANT
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.scene import Atmosphere, Balloon, Inflation, Material, Scene
from balloon_warp.schedules.readout import ForceReader
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

AIR, KELVIN = 101325.0, 293.15
THICKNESS, DENSITY = 2.5e-4, 950.0
VACUUM = Atmosphere(density=0.0)


def simulator_of(balloon: Balloon, device: str, schedule: str = "auto", **fields: Any) -> Simulator:
    return Simulator(Scene(balloon=[balloon], **{"gravity": 0.0} | fields), device, schedule=schedule)


def masses(simulator: Simulator) -> NDArray[np.float64]:
    """Return the moving mass of each particle [kg], its part of the gas included."""
    model = simulator.model
    gas = simulator.state.gas_amounts.numpy()[0, 0] * model.parameters["molar_mass"].numpy()[0, 0]
    if model.scene.balloon[0].inflation.kind != "gas":
        gas = 0.0
    return (float(model.parameters["mass"].numpy()[0, 0]) + gas) * model.shapes[0].mass_share


def motion(simulator: Simulator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    state = simulator.state
    return state.points.numpy()[0].astype(np.float64), state.velocities.numpy()[0].astype(np.float64)


def energy_of(simulator: Simulator, kind: str) -> float:
    """Return the energy of rubber, gas and motion [J]; of the gas, p_a V - n R T ln V."""
    mesh = simulator.model.shapes[0].mesh
    faces = mesh.face_vertex_indices.reshape(mesh.face_count, -1)
    points, velocities = motion(simulator)

    def in_wrinkles(a: NDArray, b: NDArray) -> NDArray:
        return relaxed(ENERGIES[kind], a, b)

    volume = signed_volume(mesh_of(points, faces.tolist()))
    heat = float(simulator.state.gas_amounts.numpy()[0, 0]) * GAS_CONSTANT * KELVIN
    gas = AIR * volume - heat * np.log(volume / signed_volume(mesh))
    moving = 0.5 * float(masses(simulator) @ (velocities**2).sum(axis=1))
    return THICKNESS * quad_energy(in_wrinkles, mesh.points, points, faces) + gas + moving


@pytest.mark.full
@pytest.mark.parametrize("kind", ["neo_hookean", "mooney_rivlin"])
def test_energy_of_gas_and_rubber_and_motion_stays_within_bounds_for_twenty_seconds(kind: str, device: str):
    """Energy of a dented balloon that swings, breathes and wrinkles undamped at half the stable step is bounded:
    symplectic Euler's energy swings by omega h / 2 of the energy above the minimum, and does not drift."""
    material = MATERIALS[kind].model_copy(update={"thickness": THICKNESS, "density": DENSITY})
    inside = Inflation(kind="gas", start_pressure=3.0e4, breathing_damping=0.0)
    mesh = quad_sphere(3, 0.1)
    balloon = Balloon(mesh=mesh, material=material, inflation=inside, damping=0.0)
    steady = simulator_of(balloon.model_copy(update={"damping": 6.0}), device, atmosphere=VACUUM)
    for _ in range(40):
        steady.step()
    least = energy_of(steady, kind)
    simulator = simulator_of(balloon, device, atmosphere=VACUUM, substeps=2 * steady.model.substeps)
    rest, _ = motion(steady)
    random = np.random.default_rng(3)
    put(simulator, rest * (1.15, 1.0, 0.9), random.normal(scale=1.0, size=rest.shape))
    above = []
    for _ in range(20 * 60):
        simulator.step()
        if len(above) < 100 or simulator.frame_number % 10 == 0:
            above.append(energy_of(simulator, kind) - least)
    first, last = np.mean(above[:60]), np.mean(above[-60:])
    assert first > 0.01 * THICKNESS  # something swings
    assert abs(last - first) < 0.1 * first
    assert np.max(above) < 1.5 * first
    assert np.min(above) > 0.5 * first


SCHEDULES = ["scatter", "gather", "lanes", "octets", "block"]


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_momentum_and_angular_momentum_stay(schedule: str, device: str):
    """Momentum and angular momentum of viscous rubber that flies and spins are conserved, up to half an epsilon of
    rounding each step.

    In `gather` and `block` each corner computes its triangles' tensions for itself, with a difference of a millionth of
    the total pressure force, alike in every step."""
    if schedule in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{schedule} is for the CPU")
    material = Material(preset="latex", viscosity=2.0)
    balloon = Balloon(mesh=quad_sphere(3, 0.1), material=material, inflation=Inflation(pressure=300.0), damping=0.0)
    simulator = simulator_of(balloon, device, schedule, atmosphere=VACUUM)
    points, _ = motion(simulator)
    random = np.random.default_rng(1)
    put(simulator, points, np.cross((5.0, 10.0, 20.0), points) + (2.0, -1.0, 1.0) + random.normal(size=points.shape))

    def momenta() -> NDArray[np.float64]:
        now, velocities = motion(simulator)
        mass = masses(simulator)
        return np.concatenate([mass @ velocities, mass @ np.cross(now, velocities)])

    before = momenta()
    for _ in range(5):
        simulator.step()
    steps = 5 * simulator.model.substeps
    rounding = 2.4e-7 * np.sqrt(steps) * masses(simulator).sum() * np.abs(motion(simulator)[1]).max()
    if schedule in ("gather", "block"):
        rounding += 1e-6 * 300.0 * 0.126 * 5 / 60.0
    assert np.abs(momenta() - before).max() < rounding  # of the angular one, too: no particle is a meter away
    assert np.linalg.norm(before[:3]) > 1e3 * rounding


def drag_of(simulator: Simulator, points: NDArray, velocities: NDArray) -> NDArray[np.float64]:
    """Return forces of moving particles, less those of the same at rest [N], shape (P, 3)."""
    forces = []
    for moving in (velocities, 0.0 * velocities):
        put(simulator, points, moving)
        reader = ForceReader(simulator.model)
        reader.refresh(simulator.state)
        forces.append(reader.net_forces(simulator.state).numpy()[0].astype(np.float64))
    return forces[0] - forces[1]


def test_the_material_s_viscosity_damps_a_stretched_bar_as_kelvin_and_voigt_say(device: str):
    """The damping of a wrinkled strip, one and a half times as long as at rest, whose end flies off, is Kelvin and
    Voigt's 3 eta l' / l over its section."""
    length, width, viscosity = 1.0, 0.1, 400.0
    strip = mesh_of([(0, 0, 0), (length, 0, 0), (length, width, 0), (0, width, 0)], [[0, 1, 2, 3]])
    material = MATERIALS["neo_hookean"].model_copy(
        update={"thickness": 1e-3, "density": 1000.0, "viscosity": viscosity}
    )
    balloon = Balloon(mesh=strip, material=material, inflation=Inflation(pressure=0.0), damping=0.0, fixed=[0, 3])
    simulator = simulator_of(balloon, device, atmosphere=VACUUM, frames_per_second=2000.0)
    points, _ = motion(simulator)
    speed = 3.0
    moving = np.zeros_like(points)
    moving[[1, 2], 0] = speed
    drag = drag_of(simulator, points * (1.5, 0.5, 1.0), moving)[[1, 2], 0].sum()
    expected = -3.0 * viscosity * (speed / length / 1.5) * (width * 1e-3 / 1.5)
    assert drag == pytest.approx(expected, rel=1e-4)


def test_viscosity_of_what_is_taut_is_that_of_a_newtonian_sheet(device: str):
    """The viscous force of a sheet stretched both ways is the Newtonian 2 eta (d + tr d) = 6 eta l' / l."""
    length, viscosity, stretch, rate = 1.0, 400.0, 1.4, 3.0
    square = mesh_of([(0, 0, 0), (length, 0, 0), (length, length, 0), (0, length, 0)], [[0, 1, 2, 3]])
    material = MATERIALS["neo_hookean"].model_copy(
        update={"thickness": 1e-3, "density": 1000.0, "viscosity": viscosity}
    )
    balloon = Balloon(mesh=square, material=material, inflation=Inflation(pressure=0.0), damping=0.0)
    simulator = simulator_of(balloon, device, atmosphere=VACUUM)
    points, _ = motion(simulator)
    drag = drag_of(simulator, stretch * points, rate * points)[[1, 2], 0].sum()
    # over the side, stretched, and the thickness, 1 / stretch^2 of that at rest
    expected = -6.0 * viscosity * (rate / stretch) * (stretch * length) * (1e-3 / stretch**2)
    assert drag == pytest.approx(expected, rel=1e-4)

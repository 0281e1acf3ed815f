"""Rubber and film against analytic answers: equilibrium pressure, breathing frequency, and viscosity."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from conserved import advanced, after_each, put
from meshes import mesh_of, quad_sphere
from numpy.typing import NDArray
from rubber_theory import ENERGIES, MATERIALS, sphere_pressure

from balloon_warp import Atmosphere, Balloon, Inflation, Material, PolygonMesh, Scene, Simulator
from balloon_warp.kernels.laws.air import GAS_CONSTANT
from balloon_warp.kernels.laws.membrane import MEMBRANES
from balloon_warp.mesh.topology import signed_volume, total_area
from balloon_warp.schedules.readout import ForceReader

AIR, KELVIN = 101325.0, 293.15
BALL = quad_sphere(9, 0.1)
"""488 particles"""
THICKNESS, DENSITY = 2.5e-4, 950.0
GAS = Inflation(kind="gas", start_pressure=0.0)


def made_of(kind: str = "neo_hookean", **material: Any) -> Material:
    return MATERIALS[kind].model_copy(update={"thickness": THICKNESS, "density": DENSITY, **material})


def scene_of(kind: str, mesh: PolygonMesh, inflation: Inflation, damping: float, **fields: Any) -> Scene:
    balloon = Balloon(mesh=mesh, material=made_of(kind), inflation=inflation, damping=damping)
    return Scene(balloon=[balloon], **{"gravity": 0.0} | fields)


def amount_at(mesh: PolygonMesh, pressure: Any, stretch: Any) -> Any:
    """Return the amount of gas at this pressure above the air's in the stretched mesh [mol]."""
    return (AIR + pressure) * signed_volume(mesh) * np.asarray(stretch) ** 3 / (GAS_CONSTANT * KELVIN)


def stretched(simulator: Simulator, stretches: Any) -> None:
    """Put each world's particles to where its stretch has them."""
    points = simulator.state.points
    grown = points.numpy() * np.reshape(stretches, (-1, 1, 1))
    wp.copy(points, wp.array(grown, dtype=wp.vec3, device=points.device))


def volumes(simulator: Simulator) -> NDArray[np.float64]:
    mesh = simulator.model.shapes[0].mesh
    return np.array(
        [signed_volume(mesh_of(points, mesh.face_vertex_indices.reshape(mesh.face_count, -1).tolist()))
         for points in simulator.state.points.numpy().astype(np.float64)]
    )  # fmt: skip


STRETCHES = np.array([1.05, 1.2, 1.38, 1.6, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.2, 6.0])


RISING = np.array([1.02, 1.1, 1.2, 1.3, 5.6, 5.9])
"""Stretches at which a pressure holds rubber, up to the peak and, but for neo-Hookean rubber, on a later branch"""


def settled(inflation: Inflation, path: str, values: Any, starts: Any, frames: int, device: str) -> list[NDArray]:
    """Return the stretches and pressures to which balls of all laws come, shape (worlds, laws); worlds differ in a
    number of the inflation, with values and the stretches that balls start from by law and world."""
    balloons = [scene_of(kind, BALL, inflation, damping=6.0).balloon[0] for kind in MEMBRANES]
    scene = Scene(balloon=balloons, gravity=0.0, touch=False)
    vary = {f"balloon.{law}.inflation.{path}": each for law, each in enumerate(values)}
    simulator = Simulator(scene, device, len(starts[0]), vary)
    points = simulator.state.points
    shape = (len(starts[0]), len(balloons), BALL.vertex_count, 3)
    grown = points.numpy().reshape(shape) * np.transpose(starts)[:, :, None, None]
    wp.copy(points, wp.array(grown.reshape(len(grown), -1, 3), dtype=wp.vec3, device=device))
    advanced(simulator, frames)
    found = [[signed_volume(replace(BALL, points=ball)) for ball in world]
             for world in points.numpy().astype(np.float64).reshape(shape)]  # fmt: skip
    return [(np.array(found) / signed_volume(BALL)) ** (1.0 / 3.0), simulator.state.pressures.numpy()]


@pytest.mark.nightly
def test_a_sealed_balloon_has_the_pressure_of_the_analytic_curve(device: str):
    """Each stretch is a world, past the peak, too. Balloons start off it: the volume of each gives the stretch."""
    curves = [sphere_pressure(energy, BALL, THICKNESS, STRETCHES) for energy in ENERGIES.values()]
    amounts = [amount_at(BALL, curve, STRETCHES) for curve in curves]
    starts = [np.where(STRETCHES < 1.1, 1.0, 0.98) * STRETCHES] * len(curves)
    found, pressures = settled(GAS, "amount", amounts, starts, 20, device)
    for law, energy in enumerate(ENERGIES.values()):
        np.testing.assert_allclose(found[:, law], STRETCHES, rtol=0.003)
        expected = sphere_pressure(energy, BALL, THICKNESS, found[:, law])
        np.testing.assert_allclose(pressures[:, law], expected, rtol=0.01)


def test_a_given_pressure_stretches_as_the_analytic_curve_says(device: str):
    branches = [np.where(RISING < 2.0, RISING, 1.1) if kind == "neo_hookean" else RISING for kind in ENERGIES]
    pressures = [
        sphere_pressure(energy, BALL, THICKNESS, rising)
        for energy, rising in zip(ENERGIES.values(), branches, strict=True)
    ]
    given = Inflation(kind="pressure", pressure=1.0)
    found, _ = settled(given, "pressure", pressures, branches, 30, device)
    for law, (energy, rising) in enumerate(zip(ENERGIES.values(), branches, strict=True)):
        held = sphere_pressure(energy, BALL, THICKNESS, found[:, law])
        np.testing.assert_allclose(held, pressures[law], rtol=0.01)
        np.testing.assert_allclose(found[:, law], rising, rtol=0.01)


def breathing(mesh: PolygonMesh, device: str, amount: float) -> tuple[float, float, float]:
    """Return volume [m^3], pressure [Pa] and frequency [1/s] of a sealed balloon that is twice its size."""
    still = {"breathing_damping": 0.0, "added_mass": 0.0}  # the formula knows no air around it
    inflation = GAS.model_copy(update=still | {"amount": amount})
    scene = scene_of("neo_hookean", mesh, inflation, 0.0, frames_per_second=20000.0, substeps=4)
    simulator = Simulator(scene, device)
    stretched(simulator, 2.005)
    told = after_each(simulator, 250, lambda each: (volumes(each)[0], float(each.state.pressures.numpy()[0, 0])))
    seen, pressures = np.transpose(told)
    swing = seen - np.mean(seen)
    upward = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    crossings = upward - swing[upward] / (swing[upward + 1] - swing[upward])
    between = slice(upward[0], upward[-1])
    frequency = 20000.0 * (len(crossings) - 1) / (crossings[-1] - crossings[0])
    return float(np.mean(seen[between])), float(np.mean(pressures[between])), frequency


def same_volume(n: int) -> PolygonMesh:
    """Return a ball of 6 n^2 quads, of the volume of a sphere of 0.1 m."""
    mesh = quad_sphere(n, 0.1)
    scale = (4.0 / 3.0 * np.pi * 0.1**3 / signed_volume(mesh)) ** (1.0 / 3.0)
    return mesh_of(scale * mesh.points, mesh.face_vertex_indices.reshape(-1, 4).tolist())


def analytic_frequency(mesh: PolygonMesh, amount: float) -> float:
    """Return the frequency of a shell of rubber and gas about twice its size, with all mass at the radius."""
    h = 1e-4

    def outward(stretch: float) -> float:
        """Return 3 V l^2 (p_gas - p_rubber) [J], the force on the stretch."""
        volume = signed_volume(mesh) * stretch**3
        gas = amount * GAS_CONSTANT * KELVIN / volume - AIR
        return (
            3.0 * volume / stretch * (gas - float(sphere_pressure(ENERGIES["neo_hookean"], mesh, THICKNESS, stretch)))
        )

    stiffness = -(outward(2.0 + h) - outward(2.0 - h)) / (2.0 * h)
    mass = total_area(mesh) * THICKNESS * DENSITY + amount * Inflation(kind="gas").molar_mass
    inertia = mass * float((mesh.points**2).sum(axis=1).mean())
    return float(np.sqrt(stiffness / inertia) / (2.0 * np.pi))


def test_it_breathes_at_the_analytic_frequency_on_any_mesh(device: str):
    """A textbook's balloon of mu = 0.4 MPa, h = 0.25 mm, R = 0.1 m doubles at 984.375 Pa."""
    amount = float(amount_at(same_volume(9), 984.375, 2.0))
    coarse, fine = (breathing(same_volume(n), device, amount) for n in (9, 18))
    np.testing.assert_allclose(coarse, fine, rtol=0.01)
    assert coarse[2] == pytest.approx(analytic_frequency(same_volume(9), amount), rel=0.01)
    assert coarse[0] == pytest.approx(8.0 * signed_volume(same_volume(9)), rel=0.01)
    assert coarse[1] == pytest.approx(984.375, rel=0.01)


VISCOSITY, SHEET = 400.0, 1e-3
"""Of a sheet [Pa s], and its thickness [m]"""


def drag_of(
    size: tuple[float, float], stretches: tuple[float, float, float], velocities: NDArray, device: str
) -> float:
    """Return the force along x on the far corners of a stretched rectangle that move, less that at rest [N]."""
    length, width = size
    mesh = mesh_of([(0, 0, 0), (length, 0, 0), (length, width, 0), (0, width, 0)], [[0, 1, 2, 3]])
    material = made_of(thickness=SHEET, density=1000.0, viscosity=VISCOSITY)
    balloon = Balloon(mesh=mesh, material=material, inflation=Inflation(pressure=0.0), damping=0.0)
    vacuum = {"gravity": 0.0, "atmosphere": Atmosphere(density=0.0), "frames_per_second": 2000.0}
    simulator = Simulator(Scene(balloon=[balloon], **vacuum), device)
    forces, reader = [], ForceReader(simulator.model)
    for moving in (velocities, 0.0 * velocities):
        put(simulator, mesh.points * stretches, moving)
        reader.refresh(simulator.state)
        forces.append(reader.net_forces(simulator.state).numpy()[0, [1, 2], 0].astype(np.float64).sum())
    return forces[0] - forces[1]


def test_viscosity_damps_a_wrinkled_strip_as_kelvin_and_voigt_say(device: str):
    """A strip, one and a half times as long as at rest, whose end flies off: 3 eta l' / l over its section."""
    speed = 3.0
    moving = np.zeros((4, 3))
    moving[[1, 2], 0] = speed
    expected = -3.0 * VISCOSITY * (speed / 1.0 / 1.5) * (0.1 * SHEET / 1.5)
    assert drag_of((1.0, 0.1), (1.5, 0.5, 1.0), moving, device) == pytest.approx(expected, rel=1e-4)


def test_viscosity_of_what_is_taut_is_that_of_a_newtonian_sheet(device: str):
    """2 eta (d + tr d) = 6 eta l' / l, over the side, stretched, and the thickness, 1 / stretch^2 of that at rest."""
    stretch, rate = 1.4, 3.0
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    expected = -6.0 * VISCOSITY * (rate / stretch) * stretch * (SHEET / stretch**2)
    assert drag_of((1.0, 1.0), (stretch,) * 3, rate * corners, device) == pytest.approx(expected, rel=1e-4)

"""Symplectic and forward Euler: order of accuracy, and drift of the energy."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from conserved import energy, motion, put
from meshes import mesh_of, quad_sphere

from balloon_warp.errors import InputError
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

Solver = Literal["symplectic_euler", "forward_euler"]
SOLVERS: list[Solver] = ["symplectic_euler", "forward_euler"]
NO_INFLATION = Inflation(k_normal=0.0)
STIFFNESS, MASS = 50.0, 0.1
OMEGA = np.sqrt(2.0 * STIFFNESS / MASS)
"""of two particles on a spring [1/s]: each feels twice the change of length that it makes"""
STRETCH = 0.1
"""at the start [m], of a spring one meter long"""


def two_particles(solver: Solver, substeps: int, device: str) -> Simulator:
    """Return two particles on a stretched spring, let go: the length is 1 + STRETCH cos(OMEGA t)."""
    balloon = Balloon(
        mesh=mesh_of([[-0.5, 0, 0], [0.5, 0, 0]], [[0, 1]]),
        mass=2.0 * MASS,
        damping=0.0,
        stiffness=Stiffness(structural=STIFFNESS),
        inflation=NO_INFLATION,
    )
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, solver=solver, substeps=substeps), device)
    stretch(simulator, 1.0 + STRETCH)
    return simulator


def stretch(simulator: Simulator, factor: float) -> None:
    put(simulator, factor * motion(simulator)[0])


def energies(simulator: Simulator, frames: int) -> np.ndarray:
    found = [energy(simulator)]
    for _ in range(frames):
        simulator.step()
        found.append(energy(simulator))
    return np.array(found)


@pytest.mark.full
@pytest.mark.parametrize("solver", SOLVERS)
def test_the_spring_keeps_to_its_analytic_motion_at_first_order(solver: Solver, device: str):
    def error(substeps: int) -> float:
        simulator, worst = two_particles(solver, substeps, device), 0.0
        for frame in range(1, 25):  # two periods
            simulator.step()
            length = np.ptp(simulator.read_frame().points[0][:, 0])
            worst = max(worst, abs(length - 1.0 - STRETCH * np.cos(OMEGA * frame / 60.0)))
        return worst

    errors = [error(substeps) for substeps in (100, 200, 400)]
    assert errors[0] < 0.2 * STRETCH
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.15)  # the next term of the error is a tenth here


def test_forward_euler_gains_the_energy_that_it_must(device):
    """Forward Euler multiplies the energy of a linear spring by exactly 1 + (h omega)^2 a step."""
    h = 1.0 / 60.0 / 50
    found = energies(two_particles("forward_euler", 50, device), frames=24)
    expected = found[0] * (1.0 + (h * OMEGA) ** 2) ** (50 * np.arange(25))
    assert expected[-1] > 1.1 * found[0]
    # lengths near 1 m are rounded by 6e-8 m, of a stretch of 0.1 m: 1e-6, added up over some ten frames
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_symplectic_eulers_energy_swings_and_does_not_drift(device):
    """Symplectic Euler conserves the modified energy E - h/2 k x v exactly: E stays within h omega / 2 of it."""
    h = 1.0 / 60.0 / 50
    found = energies(two_particles("symplectic_euler", 50, device), frames=240)
    swing = found / found[0] - 1.0
    assert 0.5 * h * OMEGA / 2.0 < np.abs(swing).max() < 1.05 * h * OMEGA / 2.0
    assert abs(swing[-120:].mean() - swing[:120].mean()) < 0.1 * h * OMEGA / 2.0


@pytest.mark.full
def test_a_balloon_gains_energy_by_forward_euler_alone(device):
    """Only forward Euler gains energy on an undamped balloon, stretched by a tenth and let go, in half a second."""
    ends = {}
    for solver in SOLVERS:
        balloon = Balloon(mesh=quad_sphere(4), mass=0.5, damping=0.0, inflation=NO_INFLATION)
        simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, solver=solver, substeps=20), device)
        stretch(simulator, 1.1)
        found = energies(simulator, frames=30)
        ends[solver] = found / found[0]
    assert ends["forward_euler"][-1] > 2.0
    assert (np.diff(ends["forward_euler"]) > 0.0).all()
    assert np.abs(ends["symplectic_euler"] - 1.0).max() < 0.05  # it swings by about h omega / 2


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_stable_step_is_exact_for_two_particles_on_a_spring(solver: Solver, device: str):
    """Gershgorin's bound is exact for two particles on a spring: a step a hundredth longer gains energy, and one a
    hundredth shorter loses it: w^2 h^2 + 2 g h = 4, or h = g / w^2 by forward Euler."""
    rate = 0.2 * OMEGA
    limit = (np.hypot(rate, 2.0 * OMEGA) - rate) / OMEGA**2 if solver == "symplectic_euler" else rate / OMEGA**2
    scene = two_particles("symplectic_euler", 50, "cpu").model.scene
    damped = scene.balloon[0].model_copy(update={"damping": rate * 2.0 * MASS})
    auto = {"solver": solver, "balloon": [damped], "substeps": "auto", "frames_per_second": 1.0 / (100.2 * limit)}
    model = build_model(scene.model_copy(update=auto), device)
    assert model.substeps == 126  # the next number above 100.2 / 0.8
    for part, grows in ((1.01, True), (0.99, False)):
        simulator = Simulator.of_model(replace(model, frame_seconds=200.0 * part * limit, substeps=200))
        stretch(simulator, 1.0 + STRETCH)
        found = energies(simulator, frames=5)
        assert (found[-1] > found[0]) == grows


def test_auto_takes_the_step_at_which_damping_makes_up_for_forward_euler():
    balloon = Balloon(mesh=quad_sphere(3), damping=2.0)
    symplectic, forward = (
        Simulator(Scene(balloon=[balloon], solver=solver), "cpu").model.substeps for solver in SOLVERS
    )
    assert forward > 2 * symplectic
    with pytest.raises(InputError, match=r"^substeps: forward Euler without damping gains energy at every step"):
        Simulator(Scene(balloon=[balloon.model_copy(update={"damping": 0.0})], solver="forward_euler"), "cpu")


@pytest.mark.full
def test_forward_euler_with_autos_substeps_loses_energy(device):
    """The automatic step of forward Euler loses energy, and with a tenth of the substeps it gains energy, though
    damped: the bound is right within its margins."""
    for divisor, grows in ((1, False), (10, True)):
        balloon = Balloon(mesh=quad_sphere(3), damping=0.5, inflation=NO_INFLATION)
        scene = Scene(balloon=[balloon], gravity=0.0, solver="forward_euler")
        substeps = Simulator(scene, "cpu").model.substeps // divisor
        simulator = Simulator(scene.model_copy(update={"substeps": substeps}), device)
        noise = np.random.default_rng(3).normal(scale=1e-3, size=simulator.state.points.shape + (3,))
        put(simulator, motion(simulator)[0] + noise[0])
        found = energies(simulator, frames=6)
        assert (found[-1] > found[0]) == grows

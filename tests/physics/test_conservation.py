"""Conservation laws of a free balloon in vacuum and their exceptions, and the energy and accuracy of both Eulers."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from conserved import after_each, angular_momentum, energy, masses, momentum, motion, put
from meshes import mesh_of, quad_sphere
from numpy.typing import NDArray

from balloon_warp import Atmosphere, Balloon, Inflation, InputError, Scene, Simulator, Stiffness
from balloon_warp.model import build_model

NO_INFLATION = Inflation(k_normal=0.0)
BALLOONS = {
    "springs": {"inflation": NO_INFLATION, "stiffness": Stiffness(variation=0.3)},
    "rubber": {"inflation": NO_INFLATION, "stiffness": Stiffness(torsion=0.02, viscosity=1e-3)},
    "pressure": {"inflation": Inflation(kind="pressure", pressure=5.0)},
    "gas": {"inflation": Inflation(kind="gas", start_pressure=5.0)},
}
FRAMES, SUBSTEPS = 200, 50
"""10000 substeps, in frames that are soon recorded"""
EPSILON = float(np.finfo(np.float32).eps)


def thrown(device: str, balloon: dict | None = None, **fields) -> Simulator:
    """Return a balloon in vacuum that flies, spins, is stretched unevenly, and trembles; a step is a millisecond."""
    ball = Balloon(mesh=quad_sphere(3, radius=0.5), mass=0.5, damping=0.0, **(balloon or BALLOONS["springs"]))
    setting = {"gravity": 0.0, "atmosphere": Atmosphere(density=0.0), "frames_per_second": 20.0, "substeps": SUBSTEPS}
    simulator = Simulator(Scene(balloon=[ball], **setting | fields), device)
    points, _ = motion(simulator)
    random = np.random.default_rng(1)
    points = points * (1.1, 0.95, 1.0) + random.normal(scale=0.02, size=points.shape)
    spin = np.cross((0.5, 1.0, 2.0), points)
    put(simulator, points, spin + (0.2, -0.1, 0.1) + random.normal(scale=0.05, size=points.shape))
    return simulator


def drifts(simulator: Simulator, frames: int = FRAMES) -> tuple[NDArray, NDArray]:
    """Return the largest drifts of momentum and angular momentum, over the rounding of each: a substep rounds each
    velocity and place by up to half an epsilon of itself, to either side."""
    before = momentum(simulator), angular_momentum(simulator)
    worst, fastest, farthest = np.zeros(2), 0.0, 0.0
    for _ in range(frames):
        simulator.step()
        points, velocities = motion(simulator)
        fastest, farthest = max(fastest, np.abs(velocities).max()), max(farthest, np.abs(points).max())
        now = momentum(simulator), angular_momentum(simulator)
        worst = np.maximum(worst, [np.abs(a - b).max() for a, b in zip(now, before, strict=True)])
    rounding = EPSILON / 2.0 * np.sqrt(frames * simulator.model.substeps) * masses(simulator).sum() * fastest
    assert min(np.linalg.norm(before[0]), np.linalg.norm(before[1])) > 1e3 * rounding
    return worst, rounding * np.array([1.0, max(farthest, 1.0)])


@pytest.mark.parametrize("kind", BALLOONS)
def test_a_free_balloon_keeps_momentum_and_angular_momentum_for_10000_substeps(kind, device):
    """Springs, torsion and pressure on a closed surface have no net force and torque, and symplectic Euler keeps both
    momenta, since x x v is the same before and after x += h v."""
    drift, rounding = drifts(thrown(device, BALLOONS[kind]))
    assert (drift < rounding).all()


@pytest.mark.parametrize("normals", ["cached", "fresh"])
def test_the_papers_inflation_pushes_a_free_balloon_about(normals, device):
    """(A_p / A) n, with the nearest face's area and a mean of normals, has a net force over an imperfect sphere."""
    simulator = thrown(device, balloon={"inflation": Inflation(k_normal=0.2)}, normals=normals)
    drift, rounding = drifts(simulator, frames=20)
    assert (drift > 1e2 * rounding).all()


def test_forward_euler_keeps_momentum_and_not_angular_momentum(device):
    """Forward Euler gains h^2 v x F of angular momentum each step, as points move by the old velocities."""
    drift, rounding = drifts(thrown(device, solver="forward_euler", substeps=2 * SUBSTEPS), frames=20)
    assert drift[0] < rounding[0]
    assert drift[1] > 1e2 * rounding[1]


def test_projective_keeps_momentum_and_loses_angular_momentum_at_first_order(device):
    """Backward Euler loses h^2 v x F of angular momentum each step, so half with half the step; its linear system,
    solved in float32, leaves less than an epsilon of the momentum every substep."""
    lost = []
    for substeps in (40, 80, 160):  # a fiftieth of a second
        simulator = thrown(device, solver="projective", substeps=substeps, frames_per_second=50.0)
        drift, rounding = drifts(simulator, frames=1)
        assert drift[0] < substeps * EPSILON * np.linalg.norm(momentum(simulator))
        assert drift[1] > 10.0 * rounding[1]
        lost.append(drift[1])
    np.testing.assert_allclose(np.log2(np.array(lost[:-1]) / lost[1:]), 1.0, atol=0.1)  # the next term is a fiftieth


def energies(simulator: Simulator, frames: int) -> NDArray[np.float64]:
    """Return the energy at the start and after each frame [J]."""
    return np.array([energy(simulator), *after_each(simulator, frames, energy)])


def test_the_energy_of_a_free_balloon_swings_within_bounds_for_10000_substeps(device):
    """The motion is chaotic, and `scatter` sums in another order every time on a GPU: of 40 starts a micrometer apart
    the largest swings were 0.013 to 0.026."""
    found = energies(thrown(device), FRAMES)
    assert np.abs(found / found[0] - 1.0).max() < 0.04


Solver = Literal["symplectic_euler", "forward_euler"]
SOLVERS: list[Solver] = ["symplectic_euler", "forward_euler"]
STIFFNESS, MASS = 50.0, 0.1
OMEGA = np.sqrt(2.0 * STIFFNESS / MASS)
"""of two particles on a spring [1/s]: each feels twice the change of length that it makes"""
STRETCH = 0.1
"""at the start [m], of a spring one meter long"""


def two_particles(solver: Solver, substeps: int, device: str) -> Simulator:
    """Return two particles on a stretched spring, let go: the length is 1 + STRETCH cos(OMEGA t)."""
    pair, spring = mesh_of([[-0.5, 0, 0], [0.5, 0, 0]], [[0, 1]]), Stiffness(structural=STIFFNESS)
    balloon = Balloon(mesh=pair, mass=2.0 * MASS, damping=0.0, stiffness=spring, inflation=NO_INFLATION)
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, solver=solver, substeps=substeps), device)
    stretch(simulator, 1.0 + STRETCH)
    return simulator


def stretch(simulator: Simulator, factor: float) -> None:
    put(simulator, factor * motion(simulator)[0])


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_spring_keeps_to_its_analytic_motion_at_first_order(solver: Solver, device: str):
    def error(substeps: int) -> float:
        simulator, worst = two_particles(solver, substeps, device), 0.0
        for frame in range(1, 25):  # two periods
            length = np.ptp(simulator.step().points[0][:, 0])
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


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_stable_step_is_exact_for_two_particles_on_a_spring(solver: Solver, device: str):
    """Gershgorin's bound: w^2 h^2 + 2 g h = 4 where the spring is viscous, or h = g / w^2 by forward Euler, whose
    balloon is damped. A step a hundredth longer gains energy, and one a hundredth shorter loses it."""
    rate = 0.2 * OMEGA
    viscous = {"stiffness": Stiffness(structural=STIFFNESS, viscosity=rate / OMEGA**2)}
    slowed = viscous if solver == "symplectic_euler" else {"damping": rate * 2.0 * MASS}
    limit = (np.hypot(rate, 2.0 * OMEGA) - rate) / OMEGA**2 if solver == "symplectic_euler" else rate / OMEGA**2
    scene = two_particles("symplectic_euler", 50, "cpu").model.scene
    damped = scene.balloon[0].model_copy(update=slowed)
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
    symplectic, forward = (build_model(Scene(balloon=[balloon], solver=solver), "cpu").substeps for solver in SOLVERS)
    assert forward > 2 * symplectic
    with pytest.raises(InputError, match=r"^substeps: forward Euler without damping gains energy at every step"):
        Simulator(Scene(balloon=[balloon.model_copy(update={"damping": 0.0})], solver="forward_euler"), "cpu")

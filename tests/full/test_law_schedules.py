"""Laws in the list, alone in a world: the same motion in every schedule, at the time of each substep, and no net
momentum from forces between particles."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import warp as wp
from meshes import mesh_of, quad_sphere
from numpy.typing import NDArray
from own_laws import HARDENING, REPELLING, TESTED, model_of_all, particle_masses, shake

import balloon_warp as bw
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model, initial_state, lay_out, plan_model
from balloon_warp.scene import Balloon, Inflation, Scene
from balloon_warp.schedules import make_schedule

STEPS, STEP_SECONDS = 8, 0.02
ROUNDING = 1e-5
"""[m], and over the step [m/s]: a body 3 m away is rounded by up to 2e-7 each step, and its springs pass that on"""


@cache
def moved(schedule: str, device: str, correction: str) -> list[NDArray[np.float64]]:
    """Return points [m] and velocities [m/s] of all worlds with this correction, shaken, before and after some
    steps."""
    law = next(law for law in TESTED if scene_correction(law) == correction)
    model, _ = model_of_all(law, device, STEP_SECONDS, STEPS)
    state = initial_state(model)
    shake(state, points=0.1, velocities=1.0)
    found = [state.points.numpy().copy(), state.velocities.numpy().copy()]
    make_schedule(model, schedule).advance_frame(state)
    return [each.astype(np.float64) for each in (*found, state.points.numpy(), state.velocities.numpy())]


@cache
def scene_correction(law: Law) -> str:
    return model_of_all(law, "cpu")[0].scene.correction


def of_law(law: Law, schedule: str, device: str) -> list[NDArray[np.float64]]:
    """Return the same of the law's world."""
    world = model_of_all(law, "cpu")[1]
    return [each[world] for each in moved(schedule, device, scene_correction(law))]


@pytest.mark.parametrize("law", TESTED, ids=lambda law: law.name)
def test_a_law_moves_particles_alike_in_every_schedule(law: Law, schedule: str, device: str):
    _, _, points, velocities = of_law(law, schedule, device)
    start, speeds, expected_points, expected_velocities = of_law(law, "scatter", device)
    np.testing.assert_allclose(points, expected_points, atol=ROUNDING)
    np.testing.assert_allclose(velocities, expected_velocities, atol=ROUNDING / STEP_SECONDS)
    free = start + STEPS * STEP_SECONDS * speeds
    assert np.abs(expected_points - free).max() > 100 * ROUNDING  # there is something to compare


@pytest.mark.parametrize("law", [law for law in TESTED if law.kind in ("spring", "hinge")], ids=lambda law: law.name)
def test_what_acts_between_particles_gives_a_body_no_momentum(law: Law, device: str):
    """Forces between particles conserve momentum, up to 6e-8 of the velocities in each of eight substeps."""
    masses = particle_masses(model_of_all(law, "cpu")[0])
    _, before, _, velocities = of_law(law, "scatter", device)
    gained = masses @ (velocities - before)
    assert np.abs(masses[:, None] * (velocities - before)).max() > 1e-4
    np.testing.assert_allclose(gained, 0.0, atol=STEPS * 6e-8 * masses.sum() * np.abs(velocities).max())


def umbrella() -> Any:
    """Return seven triangles around an apex, and a tail: the others have fewer springs, so that tables have padding."""
    angles = 2.0 * np.pi * np.arange(7) / 7.0
    rim = np.stack([np.cos(angles), -0.4 + 0.1 * np.cos(2.0 * angles), np.sin(angles)], axis=1)
    points = [(0.0, 0.0, 0.0), *rim.tolist(), (1.9, -0.8, 0.5)]
    return mesh_of(points, [[0, 1 + (k + 1) % 7, 1 + k] for k in range(7)] + [[1, 2, 8]])


def of_umbrellas(law: Law, device: str) -> Model:
    """Return a model of two worlds of an umbrella with a law of springs."""
    balloon = Balloon(mesh=umbrella(), inflation=Inflation(kind="pressure", pressure=0.0))
    plan = plan_model(Scene(balloon=[balloon], substeps=STEPS), 2, laws=(law,))
    plan.parameters[law.parameters[0].name][:] = 0.3
    return lay_out(plan, device)


@pytest.mark.parametrize("law", [HARDENING, REPELLING], ids=lambda law: law.name)
def test_springs_that_fill_up_a_table_do_nothing(law: Law, schedule, device):
    """Padding of a spring table has no effect: it joins a particle to itself, where a law may have a pole."""
    ends = []
    for name in (schedule, "scatter"):
        model = of_umbrellas(law, device)
        state = initial_state(model)
        shake(state, points=0.1, velocities=1.0)
        make_schedule(model, name).advance_frame(state)
        ends.append(state.points.numpy())
    assert np.isfinite(ends[0]).all()
    np.testing.assert_allclose(ends[0], ends[1], atol=ROUNDING)


@wp.func
def sway(time: float, mass_share: float, swaying: float):
    """Return a force that oscillates at 30 Hz."""
    return swaying * mass_share * wp.vec3(wp.sin(188.5 * time), 0.0, 0.0)


SWAY = bw.Law("particle", sway, (bw.Parameter("swaying", "N", default=20.0),))


@pytest.mark.parametrize("kind", ["pressure", "gas"])
def test_a_law_reads_the_time_of_each_substep(kind: str, schedule: str, device: str):
    """A law reads each substep's time, for a sealed gas, too, whose amount is read once a frame."""
    inflation = {"kind": "gas", "start_pressure": 100.0} if kind == "gas" else {"pressure": 100.0}
    ball = bw.Balloon(mesh=quad_sphere(2), mass=0.5, inflation=inflation)
    scene = bw.Scene(balloon=[ball], frames=1, substeps=32, gravity=0.0)
    moved = bw.simulate(scene, device=device, schedule=schedule, laws=(SWAY,))
    step = 1.0 / 60.0 / 32.0
    if kind == "pressure":
        speed = sum(20.0 / 0.5 * step * np.sin(188.5 * step * number) for number in range(32))
        assert moved.velocities[0][-1].mean(axis=0)[0] == pytest.approx(speed, rel=0.02)
    told = bw.simulate(scene, device="cpu", schedule="gather", laws=(SWAY,))
    np.testing.assert_allclose(moved.points[0], told.points[0], atol=2e-6)

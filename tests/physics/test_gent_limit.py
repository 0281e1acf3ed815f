"""Gent rubber near its limiting stretch, and pumped beyond it."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from meshes import quad_sphere
from rubber_theory import sphere_pressure

from balloon_warp import Balloon, Inflation, Material, Scene, Simulator, animate, run_batch
from balloon_warp.kernels.laws.membrane import MEMBRANES
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.model.materials import numbers_of, slopes_by_stretches
from balloon_warp.model.plan import plan_model
from balloon_warp.reference.laws import gent
from balloon_warp.scene.overrides import override_scene

MU, LIMIT, THICKNESS, RADIUS = 3.9e5, 30.0, 2e-4, 0.05
LOCK = (0.5 * (LIMIT + 3.0)) ** 0.5
"""both ways, but for the fourth power of a quarter"""
MESH = quad_sphere(4, radius=RADIUS)
ENERGY = partial(gent, p=SimpleNamespace(shear_modulus=MU, gent_limit=LIMIT, most_stretch=1e3))
AIR, MOLAR = 101_325.0, 8.314462618 * 293.15
"""[Pa] and [J/mol], of the standard atmosphere at 20 degrees"""


def ball(**material) -> Scene:
    """Return a scene of a ball filled in 0.5 s."""
    made_of = Material(kind="gent", shear_modulus=MU, gent_limit=LIMIT, thickness=THICKNESS, **material)
    gas = Inflation(kind="gas", molar_mass=0.0, added_mass=0.0, moles=1e-3, fill_time=0.5)
    return Scene(balloon=[Balloon(mesh=MESH, damping=0.5, material=made_of, inflation=gas)], gravity=0.0, frames=45)


PARTS = (0.7, 0.9, 0.94, 0.955, 1.1, 1.3)
"""of the limit, for which there is gas"""


def moles(parts: tuple[float, ...]) -> np.ndarray:
    """Return the amounts that fill a ball to parts of its limit at 5 kPa, beside its gas at the start."""
    rest = signed_volume(MESH)
    return (AIR + 5000.0) / MOLAR * rest * (np.array(parts) * LOCK) ** 3 - AIR / MOLAR * rest


def filled(**material) -> tuple[Simulator, np.ndarray, np.ndarray]:
    """Return the simulator with a world for each of `PARTS`, their stretches and pressures [Pa]."""
    vary = {"balloon.inflation.moles": moles(PARTS)}
    simulator = Simulator(ball(**material), "cpu", len(PARTS), vary)
    for _ in range(45):
        simulator.advance()
    volumes = [signed_volume(replace(MESH, points=points)) for points in simulator.state.points.numpy().astype(float)]
    stretches = np.cbrt(np.array(volumes) / signed_volume(MESH))
    return simulator, stretches, simulator.state.pressures.numpy()[:, 0].astype(np.float64)


def test_the_pressure_is_gents_up_to_nearly_the_limit_and_rises_on():
    """Within 0.5%, as a ball of 98 particles is a little slack between its corners."""
    simulator, stretches, pressures = filled()
    near = stretches < 0.96 * LOCK
    assert near.tolist() == [True] * 4 + [False] * 2
    assert stretches[3] > 0.93 * LOCK
    expected = sphere_pressure(ENERGY, MESH, THICKNESS, stretches[near])
    np.testing.assert_allclose(pressures[near], expected, rtol=0.005)
    assert np.all(np.diff(pressures[1:]) > 300.0)
    assert np.isfinite(simulator.state.points.numpy()).all()
    assert stretches[5] < 1.2 * LOCK  # by gas for 1.3, against its law without a limit 1.28
    (sentence,) = simulator.warnings
    assert sentence.startswith("material.most_stretch: rubber exceeded a biaxial stretch of 3.9 in frame ")
    assert " of world 4; " in sentence
    assert sentence.endswith("(and 1 more world)")


@pytest.mark.always
def test_a_smaller_most_stretch_takes_longer_steps_and_is_told():
    short, _, _ = filled()
    long, stretches, pressures = filled(most_stretch=0.85 * LOCK)
    assert long.model.substeps < 0.4 * short.model.substeps
    assert "a biaxial stretch of 3.45 in frame " in long.warnings[0]
    assert " of world 1; " in long.warnings[0]
    assert np.all(np.diff(pressures[1:]) > 100.0)
    assert stretches[-1] > short.state.points.numpy().max()  # finite


@pytest.mark.always
@pytest.mark.parametrize("most", [2.0, 0.9 * LOCK, 0.96 * LOCK, 0.99 * LOCK])
def test_beyond_the_most_stretch_the_tension_goes_on_as_it_is_there(most: float):
    told = numbers_of(plan_model(ball(most_stretch=most)).parameters, 0)
    law = MEMBRANES["gent"]

    def tension(stretch: np.ndarray) -> np.ndarray:
        return slopes_by_stretches(law, told, stretch, stretch)[0][0]

    h = 1e-5
    below, above = tension(np.array([most - 2.0 * h, most - h])), tension(np.array([most + h, most + 2.0 * h]))
    slopes = np.array([np.diff(below)[0], np.diff(above)[0]]) / h
    assert above[0] - below[1] == pytest.approx(2.0 * h * slopes.mean(), rel=0.01)
    assert slopes[1] == pytest.approx(slopes[0], rel=0.01)
    stretches = np.linspace(1.0, 2.0 * LOCK, 2000)
    pressures = tension(stretches) / stretches**2
    beyond = stretches > most
    assert np.all(np.diff(tension(stretches)) > 0.0)
    if most > 0.85 * LOCK:  # short of that the pressure of any such rubber still falls
        assert np.all(np.diff(pressures[beyond & (stretches < 1.5 * LOCK)]) > 0.0)
    rise = np.diff(tension(stretches)) / np.diff(stretches)
    assert rise[beyond[1:]].max() <= slopes[0] * 1.01


def test_a_batch_and_a_run_tell_who_stretched_it(tmp_path: Path):
    told: list[str] = []
    scene = ball(most_stretch=1.5).model_copy(update={"frames": 30})
    vary = {"balloon.inflation.moles": [1e-4, 0.2, 0.3]}
    run_batch(scene, tmp_path, 3, vary, device="cpu", on_warning=told.append)
    full = override_scene(scene, [("balloon.inflation.moles", 0.2)])
    animate(full, tmp_path / "ball.usda", device="cpu", on_warning=told.append)
    of_batch, of_run = (each for each in told if each.startswith("material.most_stretch: rubber exceeded"))
    assert " of world 1;" in of_batch
    assert " of world 0;" in of_run

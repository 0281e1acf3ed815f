"""Limit points of balloons under more pressure than they bear, told of before and after; and Gent rubber near its
limiting stretch, and pumped beyond it."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conserved import advanced
from meshes import quad_sphere
from rubber_theory import sphere_pressure

from balloon_warp import Balloon, BlowUpError, Inflation, Material, Scene, Simulator, animate, run_batch
from balloon_warp.kernels.laws.membrane import MEMBRANES
from balloon_warp.lab.reference.laws import gent
from balloon_warp.mesh.topology import signed_volume, total_area
from balloon_warp.model import plan_model
from balloon_warp.model.materials import numbers_of, slopes_by_stretches
from balloon_warp.model.pressure import borne_pressures, passed_limit_point
from balloon_warp.scene.load import override_scene

MU, THICKNESS = 3.0e5, 2.0e-4
MESH = quad_sphere(4, radius=0.05)
RADIUS = np.sqrt(total_area(MESH) / (4.0 * np.pi))
NEO_HOOKEAN = Material(kind="neo_hookean", shear_modulus=MU, thickness=THICKNESS)
MOST = 2.0 * MU * THICKNESS / RADIUS * (7.0 ** (-1.0 / 6.0) - 7.0 ** (-7.0 / 6.0))
"""[Pa], at a stretch of 7^(1/6) = 1.383 (Gent 1958, and before)"""


def ball(material: Material, pressure: float, **fields) -> Scene:
    """Return a scene of a ball whose pressure rises in 0.2 s."""
    inflation = Inflation(kind="pressure", pressure=[(0.0, 0.0), (0.2, pressure)])
    return Scene(balloon=[Balloon(mesh=MESH, material=material, inflation=inflation)], gravity=0.0, **fields)


def blow_up(simulator: Simulator) -> str:
    """Return the report of the blow-up."""
    with pytest.raises(BlowUpError) as failure:
        advanced(simulator, 200)
    return str(failure.value)


@pytest.mark.always
def test_the_limit_points_are_those_of_the_laws():
    for material, stretch in ((NEO_HOOKEAN, 7.0 ** (1.0 / 6.0)), (Material(), 2.0)):
        plan = plan_model(ball(material, 1.0))
        stretches, pressures = borne_pressures(plan.scene, 0, plan.shapes[0], plan.parameters)
        assert stretches[pressures.argmax()] == pytest.approx(stretch, abs=0.01)
        if material is NEO_HOOKEAN:
            assert pressures.max() == pytest.approx(MOST, rel=0.01)  # quads of a ball are not flat


@pytest.mark.always("2.0")
@pytest.mark.parametrize("part", [1.1, 2.0])
def test_rubber_past_its_limit_point_is_told_of_before_and_after(part: float):
    simulator = Simulator(ball(NEO_HOOKEAN, part * MOST), "cpu")
    said = "Pa that a ball of neo-hookean rubber of its area bears at the limit point, a stretch of 1.38"
    (warning,) = simulator.warnings
    assert said in warning
    sentence = blow_up(simulator)
    assert said in sentence
    assert 'a gas (inflation.kind = "gas")' in sentence
    assert "substeps a frame" not in sentence  # which would not help


def test_springs_past_theirs_too():
    plan = plan_model(ball(Material(), 1.0))
    most = borne_pressures(plan.scene, 0, plan.shapes[0], plan.parameters)[1].max()
    simulator = Simulator(ball(Material(), 1.3 * most), "cpu")
    assert "that a ball of springs of its area bears at the limit point, a stretch of 2" in blow_up(simulator)


@pytest.mark.always
def test_what_holds_is_not_told_of():
    for material, pressure in ((NEO_HOOKEAN, 0.9 * MOST), (Material(kind="gent", thickness=THICKNESS), 1.5 * MOST)):
        assert plan_model(ball(material, pressure)).warnings == []
    plan = plan_model(ball(NEO_HOOKEAN, 0.9 * MOST))
    told = plan.scene, 0, plan.shapes[0], plan.parameters
    assert passed_limit_point(*told, 0.9 * MOST, MESH.points) is None
    assert passed_limit_point(*told, 0.9 * MOST, 1.9 * MESH.points)  # past the peak, and pressed more than it bears
    assert passed_limit_point(*told, 1.1 * MOST, MESH.points)


GENT_MU, LIMIT = 3.9e5, 30.0
LOCK = (0.5 * (LIMIT + 3.0)) ** 0.5
"""both ways, but for the fourth power of a quarter"""
ENERGY = partial(gent, p=SimpleNamespace(shear_modulus=GENT_MU, gent_limit=LIMIT, most_stretch=1e3))
AIR, MOLAR = 101_325.0, 8.314462618 * 293.15
"""[Pa] and [J/mol], of the standard atmosphere at 20 degrees"""


def gent_ball(**material) -> Scene:
    """Return a scene of a ball filled in 0.5 s."""
    made_of = Material(kind="gent", shear_modulus=GENT_MU, gent_limit=LIMIT, thickness=THICKNESS, **material)
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
    simulator = Simulator(gent_ball(**material), "cpu", len(PARTS), vary)
    advanced(simulator, 45)
    volumes = [signed_volume(replace(MESH, points=points)) for points in simulator.state.points.numpy().astype(float)]
    stretches = np.cbrt(np.array(volumes) / signed_volume(MESH))
    return simulator, stretches, simulator.state.pressures.numpy()[:, 0].astype(np.float64)


def test_the_pressure_is_gents_up_to_nearly_the_limit_and_rises_on():
    """Agreement is within 0.5%, as a ball of 98 particles is a little slack between its corners."""
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
    told = numbers_of(plan_model(gent_ball(most_stretch=most)).parameters, 0)
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
    scene = gent_ball(most_stretch=1.5).model_copy(update={"frames": 30})
    vary = {"balloon.inflation.moles": [1e-4, 0.2, 0.3]}
    run_batch(scene, tmp_path, 3, vary, device="cpu", on_warning=told.append)
    full = override_scene(scene, [("balloon.inflation.moles", 0.2)])
    animate(full, tmp_path / "ball.usda", device="cpu", on_warning=told.append)
    of_batch, of_run = (each for each in told if each.startswith("material.most_stretch: rubber exceeded"))
    assert " of world 1;" in of_batch
    assert " of world 0;" in of_run

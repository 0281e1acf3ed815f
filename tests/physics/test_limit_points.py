"""Limit points: balloons under more pressure than they bear, with the warning before and the report after."""

import numpy as np
import pytest
from meshes import quad_sphere

from balloon_warp import Balloon, BlowUpError, Inflation, Material, Scene, Simulator
from balloon_warp.mesh.geometry import total_area
from balloon_warp.model import plan_model
from balloon_warp.model.limit_points import borne_pressures, passed_limit_point

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

    def run() -> None:
        for _ in range(200):
            simulator.step()

    with pytest.raises(BlowUpError) as failure:
        run()
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


def test_another_blow_up_keeps_its_advice():
    scene = ball(Material(), 1.0)
    simulator = Simulator(scene, "cpu")
    simulator.set_parameters({"structural": [[1e6]]})
    sentence = blow_up(simulator)
    assert "limit point" not in sentence
    assert "substeps a frame" in sentence

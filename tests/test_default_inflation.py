"""Default inflation of a balloon: it swells by a quarter or so, and then stays where it is."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import cube, joined, mesh_of, open_cube, quad_sphere

from balloon_warp import InputError, Simulator
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import plan_model
from balloon_warp.scene import Balloon, Change, Inflation, Scene, Stiffness

STRETCH = 1.0 + Inflation().stretch


def pressure_of(balloon: Balloon, **fields) -> float:
    """Return the pressure that it rises to [Pa]."""
    return float(plan_model(Scene(balloon=[balloon], **fields)).parameters["keyframe_values"][0, 0, -1])


@pytest.mark.parametrize(
    ("given", "kind"),
    [
        ({}, "pressure"),
        ({"pressure": 3.0}, "pressure"),
        ({"k_normal": 3.0}, "normal_force"),
        ({"amount": 3.0}, "gas"),
        ({"start_pressure": 3.0}, "gas"),
        ({"pump": [(0.0, 1.0), (1.0, 0.0)]}, "gas"),
        ({"gamma": 1.4}, "gas"),
        ({"kind": "normal_force"}, "normal_force"),
    ],
)
def test_the_kind_of_inflation_is_that_of_what_is_given(given: dict, kind: str):
    assert Inflation(**given).kind == kind


def test_its_pressure_is_in_balance_with_a_round_balloon_stretched_by_a_quarter():
    """The pressure balances the virtual work of all springs, scaled alike: sum k L^2 (s - 1) s = 3 p V s^3."""
    mesh = quad_sphere(8, radius=0.3)
    stiffness = Stiffness(structural=30.0, shear=7.0, flexion=3.0)
    plan = plan_model(Scene(balloon=[Balloon(mesh=mesh, stiffness=stiffness)]))
    springs = plan.shapes[0].springs
    pull = np.array([30.0, 7.0, 3.0])[springs.kind] @ springs.rest_lengths**2
    expected = pull * (STRETCH - 1.0) / (3.0 * signed_volume(mesh) * STRETCH**2)
    # of a polyhedron as fine as this the volume is 1.2% less than that of the sphere of its area
    assert plan.parameters["keyframe_values"][0, 0].tolist() == [0.0, pytest.approx(expected, rel=0.02)]


def test_a_balloon_of_any_size_resolution_and_stiffness_swells_alike_and_keeps_still():
    """Each balloon's mean stretch after three seconds is as designed, at the same place and nearly at rest."""
    kinds = [(6, 1.0, 1.0), (2, 1.0, 1.0), (10, 1.0, 1.0)]  # cells, size, factor on the springs
    kinds += [(4, 0.02, 1.0), (4, 50.0, 1.0), (4, 1.0, 0.3), (4, 1.0, 3.0)]
    balloons = []
    for cells, size, factor in kinds:
        stiffness = Stiffness(structural=20.0 * factor, shear=10.0 * factor, flexion=2.0 * factor)
        balloons.append(Balloon(mesh=quad_sphere(cells, 0.5), scale=size, damping=1.0, stiffness=stiffness))
    simulator = Simulator(Scene(balloon=balloons, gravity=0.0, frames=180, touch=False), "cpu")
    *_, frame = simulator.run()
    for number, (_, size, _) in enumerate(kinds):
        shape = simulator.model.shapes[number]
        ends = frame.points[number].astype(np.float64)[shape.springs.pairs]
        stretch = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / shape.springs.rest_lengths
        assert stretch.mean() == pytest.approx(STRETCH, abs=0.04)  # 1.22 on 24 faces, which are hardly round
        assert np.linalg.norm(frame.velocities[number], axis=1).max() < 1e-3 * size
        off = frame.points[number].mean(axis=0) - shape.mesh.points.mean(axis=0)
        assert np.abs(off).max() < 1e-5 * size


def test_worlds_get_the_pressure_of_their_own_springs():
    """A pressure that is given stays, and a balloon that is not pinned gets none."""
    given = Balloon(mesh=cube(), inflation=Inflation(pressure=7.0))
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3)), given, Balloon(mesh=open_cube())])
    constants = {"structural": 9.0, "shear": 5.0, "flexion": 1.0}
    vary = {f"balloon.stiffness.{kind}": [k, 2.0 * k, 2.0 * k] for kind, k in constants.items()}
    vary["balloon.stiffness.structural"][2] = 9.0
    pressures = plan_model(scene, 3, vary).parameters["keyframe_values"][:, :, 1]
    alone = Balloon(mesh=quad_sphere(3), stiffness=Stiffness(**constants))
    assert pressures[:2, 0] == pytest.approx(pressure_of(alone) * np.array([1.0, 2.0]))
    assert pressures[0, 0] < pressures[2, 0] < pressures[1, 0]
    np.testing.assert_array_equal(pressures[:, 1:], [[7.0, 0.0]] * 3)


def test_an_open_balloon_is_inflated_where_its_border_is_held_and_else_says_that_it_is_not():
    """Held by one corner it would be driven around."""
    for fixed, inflates in (([], False), ([1], False), ([1, 3, 5, 7], True)):
        plan = plan_model(Scene(balloon=[Balloon(mesh=open_cube(), fixed=fixed)]))
        assert (plan.parameters["keyframe_values"][0, 0, -1] > 0.0) == inflates
        assert any("its border is not pinned" in warning for warning in plan.warnings) != inflates


def test_the_largest_part_says_how_much_all_are_inflated():
    ball, small = quad_sphere(4), quad_sphere(4, radius=0.3)
    both = joined(ball, replace(small, points=small.points + (3.0, 0.0, 0.0)))
    assert pressure_of(Balloon(mesh=both)) == pytest.approx(pressure_of(Balloon(mesh=ball)), rel=1e-6)


def test_without_springs_or_area_there_is_no_pressure():
    none = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
    assert pressure_of(Balloon(mesh=quad_sphere(3), stiffness=none)) == 0.0
    flat = mesh_of([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [[0, 1, 2]])
    assert pressure_of(Balloon(mesh=flat, fixed=[0])) == 0.0


def test_a_slow_frame_takes_the_default_too():
    """A default ramp may be shorter than a frame, where the scene's own keyframes must be a frame apart."""
    assert pressure_of(Balloon(mesh=cube()), frames_per_second=0.5) > 0.0


def test_a_pressure_cannot_be_left_to_us_later():
    late = [Change(time=1.0, set={"balloon.inflation.pressure": "auto"})]
    scene = Scene(balloon=[Balloon(mesh=cube(), inflation=Inflation(pressure=3.0))], change=late)
    with pytest.raises(InputError, match=r"change\.0\.set: balloon\.inflation\.pressure: must be a number or keyf"):
        plan_model(scene)

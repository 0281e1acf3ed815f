"""Refusals of gas: meshes that cannot hold it, and fields that do not fit it."""

from dataclasses import replace

import numpy as np
import pytest
from gas_balloons import gas_balloon
from meshes import cube, grid, mesh_of, moebius

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Inflation, Scene, Tube
from balloon_warp.scene.overrides import override_scene
from balloon_warp.simulator import Simulator


@pytest.mark.parametrize(
    ("mesh", "complaint"),
    [
        (grid(2, 2), "an open mesh cannot hold gas"),
        (moebius(8), "an open mesh cannot hold gas"),
        (replace(cube(), points=cube().points * [1.0, 1.0, 0.0]), "encloses no volume at the start"),
    ],
    ids=["open", "moebius", "flat"],
)
def test_a_mesh_that_cannot_hold_gas_is_refused(mesh: PolygonMesh, complaint: str):
    with pytest.raises(InputError, match=complaint):
        Simulator(Scene(balloon=[gas_balloon(mesh)]), "cpu")


def test_a_surface_with_one_side_is_refused():
    """A Klein bottle of n by n quads is refused: closed, with every edge on two faces, but of one side."""
    n = 5

    def corner(i: int, j: int) -> int:
        return (i % n) * n + ((-j if i >= n else j) % n)

    faces = [
        [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)] for i in range(n) for j in range(n)
    ]
    bottle = mesh_of(np.random.default_rng(0).uniform(-1.0, 1.0, (n * n, 3)), faces)
    with pytest.raises(
        InputError, match=r"not orientable cannot hold gas; the first edge of opposite winding goes from "
    ):
        Simulator(Scene(balloon=[gas_balloon(bottle)]), "cpu")


@pytest.mark.parametrize(
    ("overrides", "complaint"),
    [
        ([("balloon.inflation.k_normal", 3.0)], 'inflation.k_normal: needs kind = "normal_force" .got kind = "gas"'),
        ([("balloon.inflation.pressure", 3.0)], 'inflation.pressure: needs kind = "pressure"'),
        (
            [("balloon.inflation.kind", "steam")],
            "inflation.kind: must be 'pressure', 'gas' or 'normal_force' .got 'steam'",
        ),
        ([("balloon.helium", 3.0)], "balloon.0.helium: must be 0, since its gas lifts it .got 3"),
        ([("balloon.inflation.pump", [[0.0, 1.0], [0.0, 2.0]])], "pump: keyframe times must increase"),
        ([("tube.0.balloons", [0, 0])], "tube.0.balloons: must be two balloons below the number of balloons, 2"),
        ([("tube.0.balloons", [0, 2])], "tube.0.balloons: must be two balloons below the number of balloons, 2"),
        ([("balloon.1.inflation", {})], 'tube.0.balloons: both must have inflation.kind = "gas"'),
        ([("balloon.1.inflation.gamma", 1.4)], "both must have the same gamma and molar_mass"),
        ([("atmosphere.temperature", 0.0)], "atmosphere.temperature: must be greater than 0"),
    ],
)
def test_what_does_not_fit_gas_is_refused(overrides, complaint: str):
    balloons = [gas_balloon(cube()), gas_balloon(cube())]
    scene = Scene(balloon=balloons, tube=[Tube(balloons=(0, 1), conductance=1.0)])
    with pytest.raises(InputError, match=complaint):
        override_scene(scene, overrides)


def test_fields_of_another_kind_are_refused_from_python_too():
    with pytest.raises(InputError, match='amount: needs kind = "gas"'):
        Inflation(pressure=1.0, amount=1.0)

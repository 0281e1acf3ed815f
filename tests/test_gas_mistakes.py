"""Refusals of gas: meshes that cannot hold it, and fields that do not fit it."""

from dataclasses import replace

import pytest
from gas_balloons import gas_balloon
from meshes import cube, grid, moebius
from odd_meshes import klein

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
        (klein(5, 5), "not orientable cannot hold gas; the first edge of opposite winding goes from "),
    ],
    ids=["open", "moebius", "flat", "klein"],
)
def test_a_mesh_that_cannot_hold_gas_is_refused(mesh: PolygonMesh, complaint: str):
    with pytest.raises(InputError, match=complaint):
        Simulator(Scene(balloon=[gas_balloon(mesh)]), "cpu")


@pytest.mark.parametrize(
    ("path", "value", "complaint"),
    [
        ("balloon.inflation.k_normal", 3.0, 'inflation.k_normal: needs kind = "normal_force" .got kind = "gas"'),
        ("balloon.inflation.pressure", 3.0, 'inflation.pressure: needs kind = "pressure"'),
        ("balloon.inflation.kind", "steam", "kind: must be 'pressure', 'gas' or 'normal_force' .got 'steam'"),
        ("balloon.helium", 3.0, "balloon.0.helium: must be 0, since its gas lifts it .got 3"),
        ("balloon.inflation.pump", [[0.0, 1.0], [0.0, 2.0]], "pump: keyframe times must increase"),
        ("tube.0.balloons", [0, 0], "tube.0.balloons: must be two balloons below the number of balloons, 2"),
        ("tube.0.balloons", [0, 2], "tube.0.balloons: must be two balloons below the number of balloons, 2"),
        ("balloon.1.inflation", {}, 'tube.0.balloons: both must have inflation.kind = "gas"'),
        ("balloon.1.inflation.gamma", 1.4, "both must have the same gamma and molar_mass"),
        ("atmosphere.temperature", 0.0, "atmosphere.temperature: must be greater than 0"),
    ],
)
def test_what_does_not_fit_gas_is_refused(path: str, value: object, complaint: str):
    balloons = [gas_balloon(cube()), gas_balloon(cube())]
    scene = Scene(balloon=balloons, tube=[Tube(balloons=(0, 1), conductance=1.0)])
    with pytest.raises(InputError, match=complaint):
        override_scene(scene, [(path, value)])
    with pytest.raises(InputError, match='amount: needs kind = "gas"'):  # from Python, too
        Inflation(pressure=1.0, amount=1.0)

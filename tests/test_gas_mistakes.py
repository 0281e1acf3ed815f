"""Refusals of gas and air: meshes that cannot hold gas, and fields that do not fit it."""

import re
from dataclasses import replace
from typing import Any

import pytest
from gas_balloons import gas_balloon
from meshes import cube, grid, moebius, quad_sphere
from odd_meshes import klein

from balloon_warp import Atmosphere, Balloon, Inflation, InputError, Neck, PolygonMesh, Scene, Simulator, Tube
from balloon_warp.model import plan_model
from balloon_warp.scene.overrides import override_scene


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


SCENES = {
    "two": Scene(balloon=[gas_balloon(cube())] * 2, tube=[Tube(balloons=(0, 1), conductance=1.0)]),
    "neck": Scene(balloon=[gas_balloon(quad_sphere(4, 0.17), {"molar_mass": 0.029}, neck=Neck(opens=1.0))]),
    "wind": Scene(balloon=[Balloon(mesh=cube(), inflation=Inflation(pressure=0))], atmosphere=Atmosphere()),
}
GAS, ONE = "balloon.0.inflation", "; expected only one of them"


@pytest.mark.parametrize(
    ("name", "overrides", "complaint"),
    [
        ("two", {f"{GAS}.k_normal": 3.0}, 'inflation.k_normal: needs kind = "normal_force" (got kind = "gas"'),
        ("two", {f"{GAS}.pressure": 3.0}, 'inflation.pressure: needs kind = "pressure"'),
        ("two", {f"{GAS}.kind": "steam"}, "kind: must be 'pressure', 'gas' or 'normal_force' (got 'steam'"),
        ("two", {"balloon.0.helium": 3.0}, "balloon.0.helium: must be 0, since its gas lifts it (got 3"),
        ("two", {f"{GAS}.pump": [[0.0, 1.0], [0.0, 2.0]]}, "pump: keyframe times must increase"),
        ("two", {"tube.0.balloons": [0, 0]}, "tube.0.balloons: must be two balloons below the number of balloons, 2"),
        ("two", {"tube.0.balloons": [0, 2]}, "tube.0.balloons: must be two balloons below the number of balloons, 2"),
        ("two", {"balloon.1.inflation": {}}, 'tube.0.balloons: both must have inflation.kind = "gas"'),
        ("two", {"balloon.1.inflation.gamma": 1.4}, "both must have the same gamma and molar_mass"),
        ("two", {"atmosphere.temperature": 0.0}, "atmosphere.temperature: must be greater than 0"),
        ("two", {"atmosphere.lapse": 6.5}, "atmosphere.lapse: must be less than or equal to 0.1"),
        ("two", {"atmosphere.altitude": 80001.0}, "atmosphere.altitude: must be less than or equal to 80000"),
        ("two", {"atmosphere.altitude": -5001.0}, "atmosphere.altitude: must be greater than or equal to -5000"),
        ("two", {"atmosphere.altitude": "high"}, "atmosphere.altitude: must be a valid number"),
        ("two", {f"{GAS}.breaths": 1.0, f"{GAS}.litres": 2.0}, f"litres: gives the same quantity as breaths{ONE}"),
        ("two", {f"{GAS}.amount": 1.0, f"{GAS}.moles": 2.0}, f"moles: gives the same quantity as amount{ONE}"),
        ("two", {f"{GAS}.pump": 0.1, f"{GAS}.breaths": 2.0}, f"breaths: gives the same quantity as pump{ONE}"),
        ("two", {f"{GAS}.pump_curve": [(5.0, 1.0), (5.0, 0.0)]}, "pump_curve: pressures must increase (got [5.0, 5.0]"),
        ("two", {f"{GAS}.breaths": -1.0}, "breaths: must be"),
        ("two", {f"{GAS}.fill_time": 0.0}, "fill_time: must be"),
        ("two", {f"{GAS}.kind": "pressure", f"{GAS}.litres": 1.0}, 'litres: needs kind = "gas" (got kind = "pressure"'),
        ("neck", {"balloon.0.neck.at": 500}, "neck.at: mesh has particles 0 to 97 (got 500"),
        ("neck", {"balloon.0.neck.at": "spout"}, "neck.at: mesh has no group spout; it has none"),
        ("neck", {"balloon.0.neck.diameter": 1.0}, "balloon.0.neck.diameter: must be at most 0.3"),
        ("neck", {"balloon.0.neck.diameter": -1.0}, "neck.diameter: "),
        ("neck", {"balloon.0.neck.discharge": 1.5}, "neck.discharge: "),
        ("neck", {"balloon.0.neck.opens": -1.0}, "neck.opens: "),
        ("neck", {"balloon.0.neck.closes": 0.5}, "closes: must not come before it opens, at 1 s (got 0.5 s"),
        ("neck", {f"{GAS}.leak": 1.0}, "balloon.0.inflation.leak: must be at most"),
        ("neck", {f"{GAS}.molar_mass": 0.0}, "molar_mass: must be above 0 where gas leaves"),
        ("neck", {f"{GAS}.kind": "pressure"}, 'neck: needs inflation.kind = "gas" (got "pressure"'),
        (
            "wind",
            {"atmosphere.roughness": 0.1, "atmosphere.shear": 0.2},
            "roughness: gives another wind profile than shear",
        ),
        ("wind", {"atmosphere.roughness": 10.0}, "roughness: must be less than wind_height, 10 m (got 10)"),
        ("wind", {"atmosphere.gusts": -0.1}, "atmosphere.gusts: must be"),
        ("wind", {"atmosphere.gust_seed": 1.5}, "gust_seed"),
    ],
)
def test_what_does_not_fit_gas_or_air_is_refused(name: str, overrides: dict[str, Any], complaint: str):
    with pytest.raises(InputError, match=re.escape(complaint)):
        Simulator(override_scene(SCENES[name], list(overrides.items())), "cpu")


def test_it_is_refused_from_python_and_in_any_world_too():
    with pytest.raises(InputError, match='amount: needs kind = "gas"'):
        Inflation(pressure=1.0, amount=1.0)
    rough = override_scene(SCENES["wind"], [("atmosphere.roughness", 0.1)])
    with pytest.raises(InputError, match=r"less than wind_height, 0.05 m \(got 0.1\)"):
        plan_model(rough, 2, {"atmosphere.wind_height": [10.0, 0.05]})

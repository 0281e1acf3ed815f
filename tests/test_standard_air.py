"""Air by its altitude: the standard's table, and its use in scenes, overrides, batches, files. Refusals of gas and air:
meshes that cannot hold gas, and fields that do not fit it."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gas_balloons import gas_balloon
from meshes import cube, grid, moebius, quad_sphere
from odd_meshes import klein

from balloon_warp import Atmosphere, Balloon, Inflation, InputError, PolygonMesh, Scene, Simulator, load_scene
from balloon_warp.batch.recorder import units_of
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import plan_model
from balloon_warp.scene.load import override_scene
from balloon_warp.scene.presets import standard_air
from balloon_warp.scene.write import scene_toml

TABLE = {
    -1000.0: (294.651, 1.1393e5, 1.3470),
    0.0: (288.150, 1.01325e5, 1.2250),
    1000.0: (281.651, 8.9876e4, 1.1117),
    5000.0: (255.676, 5.4048e4, 7.3643e-1),
    10000.0: (223.252, 2.6499e4, 4.1351e-1),
    20000.0: (216.650, 5.5293e3, 8.8910e-2),
    30000.0: (226.509, 1.1970e3, 1.8410e-2),
    40000.0: (250.350, 2.8714e2, 3.9957e-3),
    50000.0: (270.650, 7.9779e1, 1.0269e-3),
    60000.0: (247.021, 2.1958e1, 3.0968e-4),
    70000.0: (219.585, 5.2209, 8.2829e-5),
}
"""Temperature [K], pressure [Pa] and density [kg/m^3] by altitude, from table I of the U.S. Standard Atmosphere 1976"""


def parameters(scene: Scene, worlds: int = 1, vary: dict[str, Any] | None = None) -> dict[str, list[float]]:
    plan = plan_model(scene, worlds, vary or {})
    names = ("air_pressure", "air_temperature", "air_density", "air_lapse")
    return {name: np.ravel(plan.parameters[name]).tolist() for name in names}


@pytest.mark.parametrize("altitude", list(TABLE))
def test_it_is_the_standards_table(altitude: float):
    temperature, pressure, density = TABLE[altitude]
    air = standard_air(altitude)
    assert air["temperature"] == pytest.approx(temperature, abs=6e-4)
    assert air["pressure"] == pytest.approx(pressure, rel=4e-5)
    assert 0.0289644 * air["pressure"] / (8.31432 * air["temperature"]) == pytest.approx(density, rel=4e-5)


@pytest.mark.parametrize("altitude", [2000.0, 15000.0, 25000.0, 40000.0, 60000.0, 75000.0])
def test_its_lapse_is_the_slope_of_its_temperature(altitude: float):
    low, high = (standard_air(altitude + step)["temperature"] for step in (-1.0, 1.0))
    assert standard_air(altitude)["lapse"] == pytest.approx(0.5 * (low - high), abs=1e-9)


def test_gas_begins_at_the_pressure_of_the_air_that_thins_out():
    """p = p_0 (1 - L h / T_0)^(rho_0 g T_0 / (p_0 L)), T = T_0 - L h: a sealed gas begins as p V / (R T)."""
    air, height = {"pressure": 101325.0, "temperature": 288.15, "density": 1.225, "lapse": 0.0065}, 3000.0
    ball = Balloon(mesh=quad_sphere(3, 0.5), position=(0.0, height, 0.0), inflation=Inflation(kind="gas"))
    plan = plan_model(Scene(balloon=[ball], atmosphere=Atmosphere(**air)))
    temperature = air["temperature"] - air["lapse"] * height
    power = air["density"] * 9.81 * air["temperature"] / (air["pressure"] * air["lapse"])
    pressure = air["pressure"] * (temperature / air["temperature"]) ** power
    amount = pressure * signed_volume(plan.shapes[0].mesh) / (8.31446 * temperature)
    assert plan.parameters["initial_gas_amounts"][0, 0] == pytest.approx(amount, rel=1e-4)


def test_without_a_lapse_gas_begins_alike_at_every_height():
    balls = [Balloon(mesh=cube(), position=(0.0, y, 0.0), inflation=Inflation(kind="gas")) for y in (0.0, 3000.0)]
    low, high = plan_model(Scene(balloon=balls)).parameters["initial_gas_amounts"][0]
    assert high == pytest.approx(low, rel=1e-6)


def test_a_scene_at_an_altitude_has_its_air():
    scene = Scene(balloon=[Balloon(mesh=cube())], atmosphere=Atmosphere(altitude=30000.0))
    air = standard_air(30000.0)
    assert {name: getattr(scene.atmosphere, name) for name in air} == air
    assert air["lapse"] < 0.0  # warmer above
    found = parameters(scene)
    assert found["air_pressure"] == [air["pressure"]]
    assert found["air_lapse"] == [air["lapse"]]
    given = Atmosphere(altitude=30000.0, temperature=240.0, lapse=None)
    assert (given.pressure, given.temperature, given.lapse) == (air["pressure"], 240.0, None)


def test_what_follows_from_the_altitude_follows_anew_and_what_is_given_stays(tmp_path: Path):
    scene = Scene(balloon=[Balloon(mesh=cube())], atmosphere=Atmosphere(altitude=30000.0, temperature=240.0))
    for raised in (
        override_scene(scene, [("atmosphere.altitude", 20000.0)]),
        override_scene(override_scene(scene, [("gravity", 9.7)]), [("atmosphere.altitude", 20000.0)]),
    ):
        air = raised.atmosphere
        assert (air.pressure, air.temperature) == (standard_air(20000.0)["pressure"], 240.0)
    assert override_scene(scene, [("atmosphere.pressure", 5.0)]).atmosphere.pressure == 5.0
    (tmp_path / "it.toml").write_text(scene_toml(load_scene("helium_rise", {"atmosphere.altitude": 3e4}), tmp_path))
    text = (tmp_path / "it.toml").read_text()
    assert "altitude = 30000.0" in text
    assert "pressure = 11" not in text
    assert load_scene(tmp_path / "it.toml", {"atmosphere.altitude": 0.0}).atmosphere.pressure == 101325.0
    assert Atmosphere(**scene.atmosphere.model_dump()) == scene.atmosphere


def test_altitudes_may_differ_between_worlds():
    altitudes = [0.0, 11000.0, 30000.0]
    scene = Scene(balloon=[Balloon(mesh=cube())], atmosphere=Atmosphere(temperature=250.0))
    found = parameters(scene, 3, {"atmosphere.altitude": altitudes})
    airs = [standard_air(altitude) for altitude in altitudes]
    assert found["air_pressure"] == [air["pressure"] for air in airs]
    assert found["air_lapse"] == [air["lapse"] for air in airs]
    assert set(found["air_temperature"]) == {250.0}  # is given
    assert units_of(scene, ["atmosphere.altitude"], ()) == {"atmosphere.altitude": "m"}


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
    "two": Scene(balloon=[gas_balloon(cube())] * 2, tube=[{"balloons": (0, 1), "conductance": 1.0}]),
    "neck": Scene(balloon=[gas_balloon(quad_sphere(4, 0.17), {"molar_mass": 0.029}, neck={"opens": 1.0})]),
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

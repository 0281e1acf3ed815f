"""Air by its altitude: the standard's table, and what of it follows in scenes, overrides, batches and files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import cube

from balloon_warp import Atmosphere, Balloon, Scene, load_scene
from balloon_warp.model import plan_model
from balloon_warp.scene.overrides import override_scene
from balloon_warp.scene.standard_air import standard_air
from balloon_warp.scene.write import scene_toml
from balloon_warp.sweep.columns import units_of

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

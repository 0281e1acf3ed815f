"""Fills that vary between worlds, where nothing else gives the kind of inflation."""

import sys
from pathlib import Path

import numpy as np
import pytest
from gas_balloons import AIR_PRESSURE, GAS_CONSTANT, TEMPERATURE
from meshes import quad_sphere

from balloon_warp import Balloon, Inflation, InputError, Scene, Simulator, load_scene
from balloon_warp.cli import main
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import plan_model
from balloon_warp.model.varied_scene import scene_to_vary
from balloon_warp.model.vary import VaryError

OF_A_LITRE = AIR_PRESSURE * 1e-3 / (GAS_CONSTANT * TEMPERATURE)
"""[mol]"""
SCENE = Scene(balloon=[Balloon(mesh=quad_sphere(3)), Balloon(mesh=quad_sphere(3), position=(4, 0, 0))], frames=4)
"""in which nobody said what fills the balloons"""


@pytest.mark.parametrize(
    ("field", "row"),
    [
        *(("litres", "fill_litres"), ("breaths", "fill_breaths"), ("moles", "fill_moles")),
        *(("fill_to_pressure", "fill_to_pressure"), ("leak", "leak"), ("amount", "initial_gas_amounts")),
    ],
)
def test_a_mesh_by_itself_is_filled_by_what_differs(field: str, row: str):
    vary = {f"balloon.inflation.{field}": [1e-3, 2e-3]}
    scene = scene_to_vary(quad_sphere(3), vary, {"frames": 2})
    assert scene.balloon[0].inflation.kind == "gas"
    np.testing.assert_allclose(plan_model(scene, 2, vary).parameters[row][:, 0], [1e-3, 2e-3], rtol=1e-12)


def test_a_command_fills_a_mesh_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A command varies the litres of a mesh by itself, filled within two frames."""
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    words = "batch ball.obj --device cpu --worlds 2 --frames 3 --vary balloon.inflation.litres=50,100 -o out"
    monkeypatch.setattr(sys, "argv", ["balloon-warp", *words.split(), "--set", "balloon.inflation.fill_time=0.03"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    table = np.load(tmp_path / "out" / "table.npz")
    moles = table["moles"].reshape(4, 2)
    np.testing.assert_allclose(moles[3] - moles[0], np.array([50.0, 100.0]) * OF_A_LITRE, rtol=1e-5)


def test_a_scene_that_leaves_the_kind_open_is_filled_by_what_differs():
    simulator = Simulator(SCENE, "cpu", 2, {"balloon.1.inflation.moles": [1.0, 2.0]})
    assert [balloon.inflation.kind for balloon in simulator.model.scene.balloon] == ["pressure", "gas"]
    later = scene_to_vary(load_scene(SCENE, {"frames": 2}), {"balloon.inflation.pressure": [1.0, 2.0]})
    assert [balloon.inflation.kind for balloon in later.balloon] == ["pressure"] * 2
    assert load_scene(SCENE, {"balloon.inflation.k_normal": 2.0}).balloon[0].inflation == Inflation(k_normal=2.0)


@pytest.mark.parametrize(
    ("overrides", "litres", "said"),
    [
        ({"balloon.inflation.kind": "pressure"}, [1.0, 3.0], r'inflation\.litres: needs kind = "gas"'),
        ({"balloon.inflation.pump": 0.1}, [1.0, 3.0], r"inflation\.litres: gives the same quantity as pump"),
        ({}, [-1.0, -3.0], r"inflation\.litres: must be greater than or equal to 0"),
        ({}, ["a", "b"], r"inflation\.litres: "),
    ],
)
def test_what_cannot_be_is_said_of_what_differs(overrides: dict, litres: list, said: str):
    vary = {"balloon.inflation.litres": litres}
    with pytest.raises(VaryError, match=said) as caught:
        plan_model(scene_to_vary(quad_sphere(3), vary, overrides), 2, vary)
    assert caught.value.path == "balloon.inflation.litres"


def test_a_kind_that_is_named_stays():
    named = load_scene(SCENE, {"balloon.inflation.kind": "normal_force"})
    with pytest.raises(InputError, match=r'needs kind = "gas" \(got kind = "normal_force"\)'):
        Simulator(named, "cpu", 2, {"balloon.inflation.moles": [1.0, 2.0]})

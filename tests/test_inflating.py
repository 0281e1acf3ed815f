"""Inflation slider of the page for balloons that something else fills."""

import pytest
from meshes import quad_sphere

from balloon_warp.errors import InputError
from balloon_warp.model.setting import plan_setting
from balloon_warp.scene import Balloon, Inflation, Scene, load_scene
from balloon_warp.viewer import playground as module
from balloon_warp.viewer.by_hand import inflating
from balloon_warp.viewer.playground import Playground


def filled(*inflations: dict) -> Scene:
    return Scene(balloon=[Balloon(mesh=quad_sphere(4, 0.5), inflation=Inflation(**fields)) for fields in inflations])


def test_what_is_blown_in_gives_way_to_the_slider():
    scene = filled({"pump": 0.5}, {"litres": 2.0}, {"breaths": 3.0}, {"moles": 1.0}, {"k_normal": 0.2})
    assert inflating(scene, 0.25) == [
        ("balloon.0.inflation.pump", 0.25),
        ("balloon.1.inflation.litres", 0.0),
        ("balloon.1.inflation.pump", 0.25),
        ("balloon.2.inflation.breaths", 0.0),
        ("balloon.2.inflation.pump", 0.25),
        ("balloon.3.inflation.moles", 0.0),
        ("balloon.3.inflation.pump", 0.25),
    ]


def test_a_pump_s_curve_stays():
    with pytest.raises(InputError, match=r"balloon\.1\.inflation\.pump_curve: gives the same quantity as pump"):
        inflating(filled({"pump": 0.5}, {"pump_curve": [(0.0, 1.0), (100.0, 0.0)]}), 0.25)


def test_many_balloons_are_inflated_at_once(monkeypatch: pytest.MonkeyPatch):
    """A hundred balloons are inflated by one plan: one by one the page stood still."""
    playground = Playground(load_scene("helium_rise"), "cpu")
    playground.set("gravity", 9.0)  # what the scene had planned is over now
    plans = []
    monkeypatch.setattr(module, "plan_setting", lambda *args, **kw: plans.append(1) or plan_setting(*args, **kw))
    playground.inflate(0.5 * playground.inflation)
    assert len(plans) == 1
    assert len({balloon.inflation.keyframes[0][1] for balloon in playground.live.balloon}) == 1

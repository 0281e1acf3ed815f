"""Change of the kind of inflation by overrides."""

import itertools
from pathlib import Path

import pytest

from balloon_warp import InputError, load_scene
from balloon_warp.scene import Balloon, Inflation, Scene
from balloon_warp.scene.overrides import OverrideError, override_scene

KEYFRAMED = Scene(
    balloon=[Balloon(mesh="a.obj", inflation=Inflation(k_normal=[(0, 1), (1, 2)])), Balloon(mesh="b.obj")]
)
GAS = [("balloon.inflation.kind", "gas"), ("balloon.inflation.amount", 2.0), ("gravity", 3.0)]


def scene_file(folder: Path, *inflations: str) -> Path:
    path = folder / "scene.toml"
    path.write_text("".join(f"[[balloon]]\nmesh = 'a.obj'\n[balloon.inflation]\n{each}\n" for each in inflations))
    return path


@pytest.mark.parametrize("kind", ["", "kind = 'normal_force'\n"])
@pytest.mark.parametrize("overrides", list(itertools.permutations(GAS)))
def test_the_old_kinds_fields_go_in_any_order(tmp_path: Path, kind: str, overrides: list):
    scene = load_scene(scene_file(tmp_path, f"{kind}k_normal = [[0, 1], [1, 2]]"), overrides)
    assert scene.balloon[0].inflation == Inflation(kind="gas", amount=2.0)
    assert scene.gravity == 3.0


def test_only_the_balloon_that_is_named_changes(tmp_path: Path):
    path = scene_file(tmp_path, "k_normal = 3", "k_normal = 3")
    changed = load_scene(path, {"balloon.1.inflation.pressure": 9.0, "balloon.1.inflation.kind": "pressure"})
    assert changed.balloon[0] == load_scene(path).balloon[0]
    assert changed.balloon[1].inflation == Inflation(kind="pressure", pressure=9.0)


def test_what_is_set_beside_another_kind_is_refused_and_named(tmp_path: Path):
    path = scene_file(tmp_path, "k_normal = 3")
    overrides = [
        ("gravity", 1.0),
        ("balloon.inflation.k_normal", 2.0),
        ("balloon.inflation.kind", "gas"),
        ("frames", 9),
    ]
    with pytest.raises(OverrideError, match=r'inflation\.k_normal: needs kind = "normal_force"') as caught:
        load_scene(path, overrides)
    assert caught.value.number == 2
    with pytest.raises(InputError, match="kind: must be 'pressure', 'gas' or 'normal_force'"):
        load_scene(path, {"balloon.inflation.kind": "helium"})


def test_a_field_of_one_kind_asks_for_it_where_the_file_names_none(tmp_path: Path):
    scene = load_scene(scene_file(tmp_path, "k_normal = 3"), {"balloon.inflation.pressure": 9.0})
    assert scene.balloon[0].inflation == Inflation(kind="pressure", pressure=9.0)
    with pytest.raises(InputError, match='pressure: needs kind = "pressure"'):
        load_scene(scene_file(tmp_path, "kind = 'gas'\namount = 3"), {"balloon.inflation.pressure": 9.0})


def test_so_it_is_of_a_scene_that_is_loaded():
    """Overrides of a loaded scene may change the kind, as `compare` does; a change during a run may not."""
    changed = override_scene(KEYFRAMED, [("balloon.inflation.kind", "pressure"), ("balloon.inflation.pressure", 4.0)])
    assert [each.inflation for each in changed.balloon] == [Inflation(kind="pressure", pressure=4.0)] * 2
    with pytest.raises(InputError, match='needs kind = "pressure"'):
        override_scene(KEYFRAMED, [("balloon.inflation.pressure", 4.0)])

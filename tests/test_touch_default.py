"""Contact of balloons by default, unless a scene disables it."""

from pathlib import Path

import pytest

from balloon_warp import InputError, load_scene
from balloon_warp.model import plan_model
from balloon_warp.scene.overrides import override_scene
from balloon_warp.scene.write import write_scene


@pytest.mark.parametrize(("said", "touches"), [(None, True), (True, True), (False, False), ({"friction": 0.1}, True)])
def test_balloons_touch_unless_the_scene_says_not(said, touches):
    assert load_scene("two_balloons", {} if said is None else {"touch": said}).touches is touches


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("pop", {}),
        ("two_balloons", {"solver": "projective"}),
        ("two_balloons", {"change": [{"time": 0.1, "set": {"solver": "projective"}}]}),
    ],
)
def test_balloons_that_cannot_touch_do_not_by_default(name, overrides):
    """Contact is off by default for balloons that may burst, and for a solver without contact between them."""
    scene = load_scene(name, overrides)
    assert len(scene.balloon) > 1
    assert not scene.touches


@pytest.mark.parametrize(("name", "itself"), [("foil_letters", True), ("letter_slot", False), ("two_balloons", False)])
def test_foil_touches_itself_by_default(name: str, itself: bool):
    """Foil folds anywhere, so it touches itself; what resists bending does not, nor do balls."""
    assert plan_model(load_scene(name)).scene.touches_itself is itself


def test_touch_is_a_table_or_yes_or_no():
    with pytest.raises(InputError, match=r"^touch: must be a table or false \(got 'no'\)$"):
        load_scene("two_balloons", {"touch": "no"})


def test_a_field_of_touch_asks_for_it():
    """A field of `touch` enables contact over `touch = false`, and without a table of it."""
    apart = load_scene("two_balloons", {"touch": False})
    assert override_scene(apart, [("touch.friction", 0.1)]).touches
    varied = plan_model(load_scene("two_balloons"), 2, {"touch.friction": [0.1, 0.5]})
    assert varied.parameters["touch_friction"].ravel().tolist() == [0.1, 0.5]
    with pytest.raises(InputError, match="touch"):
        plan_model(apart, 2, {"touch.friction": [0.1, 0.5]})


def test_touch_false_is_written_and_read(tmp_path: Path):
    write_scene(load_scene("two_balloons", {"touch": False}), tmp_path / "apart.toml")
    assert load_scene(tmp_path / "apart.toml").touch is False


def test_touch_by_default_hardly_shortens_the_step():
    """Default contact uses the margin of "auto" before it shortens the step."""
    scene = load_scene("two_balloons")
    apart, touching = (plan_model(scene.model_copy(update={"touch": said})).substeps for said in (False, None))
    assert apart <= touching <= 1.15 * apart

"""Contact of balloons by default, unless a scene disables it."""

from pathlib import Path

import numpy as np
import pytest
from meshes import quad_sphere

from balloon_warp import InputError, PolygonMesh, Scene, load_scene
from balloon_warp.model import plan_model
from balloon_warp.model.folded import bends_freely
from balloon_warp.scene import Balloon, Stiffness
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


@pytest.mark.parametrize("cells", [4, 12])
def test_a_ball_of_limp_triangles_is_no_foil(cells: int):
    """Triangles have detours between neighbors, coarse ones long ones, but lie on no others."""
    quads = quad_sphere(cells)
    corners = quads.face_vertex_indices.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]]
    mesh = PolygonMesh(
        points=quads.points, face_vertex_counts=np.full(2 * len(corners), 3), face_vertex_indices=corners.ravel()
    )
    assert bends_freely(balloon := Balloon(mesh=mesh, stiffness=Stiffness(structural=10.0, shear=5.0, flexion=0.0)))
    assert not plan_model(Scene(balloon=[balloon])).scene.touches_itself


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

"""Scene files, overrides, and the sentences that a bad one gets."""

import os
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, quad_sphere

from balloon_warp import InputError, bundled_scenes, load_scene
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Scene, Stiffness, String
from balloon_warp.scene.load import scene_name
from balloon_warp.scene.overrides import parse_override
from balloon_warp.scene.schema.fields import missed_between_frames

SCENE = """
description = "a box and two balls"
frames = 10
[[balloon]]
mesh = "box.obj"
[[balloon]]
mesh = "box.obj"
position = [3, 0, 0]
[[sphere]]
position = [0, 2, 0]
[[sphere]]
position = [1, 2, 0]
mass = 7
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    write_obj(tmp_path / "box.obj", cube())
    path = tmp_path / "boxes.toml"
    path.write_text(SCENE)
    return path


def load_with(path: Path, *overrides: str) -> Scene:
    return load_scene(path, [parse_override(text) for text in overrides])


def test_a_scene_file_is_read_with_its_meshes_beside_it(scene_file: Path):
    scene = load_scene(scene_file)
    assert (scene.frames, len(scene.balloon), scene.sphere[1].mass) == (10, 2, 7.0)
    assert scene.balloon[0].mesh == scene_file.parent / "box.obj"
    assert build_model(scene, "cpu").particle_count == 16


def test_an_override_reaches_all_or_one(scene_file: Path):
    every = load_with(scene_file, "balloon.inflation.k_normal=3", "sphere.mass=100")
    assert [balloon.inflation.k_normal for balloon in every.balloon] == [3.0, 3.0]
    assert [sphere.mass for sphere in every.sphere] == [100.0, 100.0]
    one = load_with(scene_file, "balloon.1.inflation.k_normal=[[0, 1], [2, 0.5]]", "sphere.0.mass=100")
    assert one.balloon[1].inflation.keyframes == [(0.0, 1.0), (2.0, 0.5)]
    assert one.balloon[0].inflation == Balloon(mesh="x").inflation
    assert [sphere.mass for sphere in one.sphere] == [100.0, 7.0]


def test_an_override_makes_tables_that_are_not_there(scene_file: Path):
    scene = load_with(scene_file, "ground.height=-1", "up_axis=Z")
    assert scene.ground is not None
    assert (scene.ground.height, scene.up_axis) == (-1.0, "Z")


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("sphere.0.mass=-1", r"sphere\.0\.mass: must be greater than 0 \(got -1\)"),
        ("sphere.0.mass=1e-46", r"sphere\.0\.mass: must be at least 1e-12 \(got 1e-46\)"),
        ("balloon.inflation.k_norml=3", r"balloon\.0\.inflation\.k_norml: unknown field; did you mean k_normal\?"),
        ("k_normal=3", r"k_normal: unknown field; did you mean balloon\.inflation\.k_normal\?$"),
        ("mass=3", r"mass: unknown field; did you mean balloon\.mass, sphere\.mass or body\.mass\?$"),
        ("balloon.shear=3", r"balloon\.0\.shear: unknown field; did you mean balloon\.stiffness\.shear\?$"),
        ("balloon.penalty=3", r"balloon\.0\.penalty: unknown field; did you mean sphere\.penalty\?$"),
        ("balloon.color=red", r"balloon\.0\.color: must be numbers in brackets \(got 'red'\)"),
        (
            "colour=1",
            r"colour: unknown field; did you mean balloon\.color, sphere\.color, obstacle\.color or body\.color\?$",
        ),
        ("k_norml=1", r"k_norml: unknown field; did you mean balloon\.inflation\.k_normal\?$"),
        ("xyzzy=1", r"xyzzy: unknown field; known here are description, up_axis, gravity, .*"),
        ("baloon.mass=1", r"baloon: unknown table; did you mean balloon\?$"),
        ("balloon.inflation.k_normal=much", r"k_normal: must be a valid number or a valid list \(got 'much'\)"),
        (
            "balloon.inflation.k_normal=[[0, 1], [0, 2]]",
            r"k_normal: keyframe times must increase \(got \[0\.0, 0\.0\]\)",
        ),
        ("balloon.position=[1, 2]", r"balloon\.0\.position\.2: is missing"),
        ("balloon.stiffness=3", r"balloon\.0\.stiffness: must be a table \(got 3\)"),
        ("balloon.mesh=3", r"balloon\.0\.mesh: must be a path or a PolygonMesh \(got 3\)"),
        ("balloon=[]", r"balloon: must be a list of at least one item \(got \[\]\)"),
        ("up_axis=X", r"up_axis: must be 'Y' or 'Z' \(got 'X'\)"),
        ("gravity=nan", r"gravity: must be .* \(got nan\)"),
        ("frames=2.5", r"frames: must be a valid integer.* \(got 2\.5\)"),
        ("frames=0", r"frames: must be greater than or equal to 1 \(got 0\)"),
        ("substeps=fast", r"substeps: must be a valid integer or 'auto' \(got 'fast'\)"),
        ("balloon.inflation.k_normal=[[0, 1], [0.01, 2]]", r"keyframes must be at least a frame apart, 0\.0166667 s"),
        ("string=[{}]", r"string\.0\.anchor: is missing"),
        ("string=[{anchor=[0, 0, 0], balloon=2}]", r"string\.0\.balloon: must be below .* balloons, 2 \(got 2\)"),
        ("sphere.2.mass=1", r"^sphere\.2\.mass: no sphere 2, the scene has 2, counted from 0$"),
        ("balloon.1.position.3=1", r"^balloon\.1\.position\.3: no balloon\.1\.position 3, the scene has 3, "),
        ("string.stiffness=1", r"^string\.stiffness: cannot be set, the scene has no string$"),
        ("string.0.stiffness=1", r"^string\.0\.stiffness: cannot be set, the scene has no string$"),
        ("frames.x=1", r"^frames\.x: cannot be set, since a plain value has no field 'x'$"),
        ("frames", r"^--set frames: expected PATH=VALUE"),
        ("a..b=1", r"^--set a\.\.b=1: expected PATH=VALUE"),
    ],
)
def test_a_wrong_value_gets_one_sentence(scene_file: Path, override: str, sentence: str):
    with pytest.raises(InputError, match=sentence) as caught:
        load_with(scene_file, override)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"frames = ", r"is not valid TOML"),
        (b"\xff\xfe", r"cannot be read as a scene file"),
        (b"", r"balloon: is missing"),
        (b"[[baloon]]\nmesh = 'a.obj'", r"baloon: unknown table; did you mean balloon\?$"),
        (b"[[balloon]]\nmsh = 'a.obj'", r"balloon\.0\.msh: unknown field; did you mean mesh\?$"),
        (
            b"[balloon]\nmesh = 'a.obj'",
            r"balloon: is one table, \[balloon\]; expected a list .* \[\[balloon\]\]$",
        ),
        (b"[[balloons]]\nmesh = 'a.obj'", r"balloons: unknown table; did you mean balloon\?$"),
        (b"[[balloon]]\nmesh = a.obj", r"Invalid value \(at line 2, column 8\); text needs quotes$"),
        (b"balloon = 3", r"balloon: must be a valid list \(got 3\)"),
        (b"[[balloon]]", r"balloon\.0\.mesh: is missing"),
        (b"[[balloon]]\nmesh = 'a'\n'b.c.d' = 1", r"balloon\.0\.b\.c\.d: unknown field; known here are mesh, .*"),
        (b"[[balloon]]\nmesh = 'a'\n" + 9999 * b"x" + b" = 1", r"balloon\.0\.x{57}\.\.\.: unknown field; .*"),
        (b"# " + 2**24 * b"x", r"has 16,777,218 bytes; expected at most 16,777,216"),
    ],
)
def test_a_broken_scene_file_gets_one_sentence(tmp_path: Path, content: bytes, sentence: str):
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"broken\.toml: .*{sentence}") as caught:
        load_scene(path)
    assert "\n" not in str(caught.value)


def test_a_pipe_is_refused_unread_and_a_byte_order_mark_is_no_matter(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(InputError, match=r"pipe\.toml: is not a regular file"):
        load_scene(tmp_path / "pipe.toml")
    (tmp_path / "marked.toml").write_bytes(b"\xef\xbb\xbfframes = 7\n[[balloon]]\nmesh = 'a.obj'\n")
    assert load_scene(tmp_path / "marked.toml").frames == 7


def test_overrides_are_a_mapping_or_pairs(scene_file: Path):
    values = {"balloon.mass": 3.0, "frames": 7}
    assert load_scene(scene_file, values) == load_scene(scene_file, list(values.items()))
    assert load_scene(scene_file, values).frames == 7


def test_an_unknown_scene_lists_the_bundled_ones():
    with pytest.raises(InputError, match=r"^zebra: no such scene or file; bundled scenes are .*squirrel_tether"):
        load_scene("zebra")


def test_a_file_that_is_missing_is_said_to_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A missing file is named as such, without a list of scenes where none has a similar name."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as refused:
        load_scene("zebra.obj")
    assert str(refused.value) == f"zebra.obj: no such file in {tmp_path}"
    with pytest.raises(InputError) as refused:
        load_scene(tmp_path / "zebra.toml")
    assert str(refused.value) == f"{tmp_path / 'zebra.toml'}: no such file"


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("squirel_tether", r"^squirel_tether: no such scene or file; did you mean squirrel_tether\?$"),
        ("boxs.toml", r"^boxs\.toml: no such scene or file; did you mean boxes\.toml\?$"),
        ("BOX.OBJ", r"^BOX\.OBJ: no such scene or file; did you mean box\.obj\?$"),
        ("./bx.obj", r"^\./bx\.obj: no such scene or file; did you mean box\.obj\?$"),
        ("nowhere/box.obj", r"^nowhere/box\.obj: no such scene or file; no folder nowhere$"),
    ],
)
def test_what_is_not_there_asks_for_what_is_like_it(
    scene_file: Path, monkeypatch: pytest.MonkeyPatch, source: str, sentence: str
):
    monkeypatch.chdir(scene_file.parent)
    with pytest.raises(InputError, match=sentence):
        load_scene(source)


def test_a_mesh_that_is_not_there_asks_for_one_like_it(scene_file: Path):
    with pytest.raises(InputError, match=r"/bux\.obj: no such file; did you mean .*/box\.obj\?$"):
        build_model(load_scene(scene_file, {"balloon.mesh": "bux.obj"}), "cpu")


def test_every_bundled_scene_loads_and_describes_itself_in_a_line():
    assert len(bundled_scenes()) >= 8
    for name in bundled_scenes():
        scene = load_scene(name)
        assert 10 < len(scene.description) < 60  # beside the name, in a terminal of 80 columns
        assert scene_name(name) == name


def test_bundled_scene_files_name_no_default_that_they_do_not_change():
    """Values in a bundled scene file differ from the schema's defaults."""
    for name, path in bundled_scenes().items():
        table = tomllib.loads(path.read_text())
        scene = load_scene(name)
        said = {key: getattr(scene, key) for key in table if key not in ("balloon", "sphere", "string", "ground")}
        defaults = {key: Scene.model_fields[key].default for key in said}
        assert {key for key in said if said[key] == defaults[key]} == set(), name


def test_an_override_seeks_a_mesh_in_the_current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_obj(tmp_path / "box.obj", cube())
    monkeypatch.chdir(tmp_path)
    scene = load_scene("squirrel_inflate", [("balloon.mesh", "box.obj")])
    assert build_model(scene, "cpu").particle_count == 8


@pytest.mark.parametrize(
    ("scale", "position", "sentence"),
    [
        (1e11, (0.0, 0.0, 0.0), r"is 1e\+11 m across; expected 1e-06 to 1e\+09 m"),
        (1e-9, (0.0, 0.0, 0.0), r"is 1e-09 m across; expected"),
        (1.0, (1e7, 0.0, 0.0), r"is 1 m across and 1e\+07 m from the origin, too far for 32-bit floats"),
    ],
)
def test_what_float32_cannot_hold_is_refused(scale: float, position: tuple[float, float, float], sentence: str):
    balloon = Balloon(mesh=replace(cube(), name="box"), scale=scale, position=position)
    with pytest.raises(InputError, match=f"box: {sentence}"):
        build_model(Scene(balloon=[balloon]), "cpu")


def test_absurd_steps_are_refused_and_heavy_balloons_still_get_one_substep():
    stiff = Balloon(mesh=cube(), stiffness=Stiffness(structural=1e11), mass=1e-6)
    with pytest.raises(InputError, match="needs more than 100,000 in a frame"):
        build_model(Scene(balloon=[stiff]), "cpu")
    soft = Balloon(mesh=cube(), stiffness=Stiffness(structural=0.0, shear=0.0, flexion=0.0), damping=0.0)
    assert build_model(Scene(balloon=[soft]), "cpu").substeps == 1


def test_strings_find_the_highest_and_lowest_particle():
    mesh = quad_sphere(3)
    strings = [String(anchor=(0, 0, 0), particle="highest"), String(anchor=(0, 0, 0), particle="lowest")]
    model = build_model(Scene(balloon=[Balloon(mesh=mesh)], string=strings), "cpu")
    heights = mesh.points[model.string_particle.numpy(), 1]
    np.testing.assert_array_equal(heights, [mesh.points[:, 1].max(), mesh.points[:, 1].min()])
    np.testing.assert_allclose(model.parameters["string_length"].numpy(), [[1.0, 1.0]], rtol=1e-6)


@pytest.mark.parametrize("field", ["string", "fixed"])
def test_a_particle_past_the_end_is_refused(field: str):
    balloon = Balloon(mesh=cube(), name="box", fixed=[8] if field == "fixed" else [])
    string = [String(anchor=(0, 0, 0), particle=8)] if field == "string" else []
    with pytest.raises(InputError, match=r"box has particles 0 to 7 \(got 8\)"):
        build_model(Scene(balloon=[balloon], string=string), "cpu")


def test_a_mesh_is_placed_by_scale_rotation_and_position():
    """A mesh is scaled, turned about y (z goes to x), then moved; a Z-up mesh is turned upright first."""
    mesh = cube()
    turned = Balloon(mesh=mesh, scale=2.0, rotation=(0, 90, 0), position=(10, 0, 0))
    points = build_model(Scene(balloon=[turned]), "cpu").initial_points.numpy()
    expected = np.stack([10 + 2 * mesh.points[:, 2], 2 * mesh.points[:, 1], -2 * mesh.points[:, 0]], axis=1)
    np.testing.assert_allclose(points, expected, atol=1e-5)

    z_up = replace(mesh, up_axis="Z", meters_per_unit=0.01)
    points = build_model(Scene(balloon=[Balloon(mesh=z_up)]), "cpu").initial_points.numpy()
    np.testing.assert_allclose(points[:, 1], 0.01 * mesh.points[:, 2], atol=1e-6)
    np.testing.assert_allclose(points[:, 2], -0.01 * mesh.points[:, 1], atol=1e-6)


@pytest.mark.parametrize("name", bundled_scenes())
def test_every_bundled_scene_takes_the_rate_that_blender_plays(name: str):
    assert load_scene(name, {"frames_per_second": 24.0}).frames_per_second == 24.0


def test_keyframes_closer_than_a_frame_are_taken_where_little_is_missed():
    """A pump that stops within a frame is accepted with a stated error, as a frame is linear from its start to its end.
    A puff between two frames would be missed and is refused."""
    assert missed_between_frames([(0.0, 3.3), (0.06, 3.3), (0.065, 0.0)], 1.0 / 24.0) < 0.01
    assert missed_between_frames([(0.0, 1.0), (1.0, 2.0)], 0.5) == pytest.approx(0.0)
    assert missed_between_frames([(0.51, 0.0), (0.52, 1.0), (0.53, 0.0)], 0.5) == pytest.approx(1.0)
    assert missed_between_frames([(0.0, 0.0), (0.01, 0.0)], 0.5) == 0.0

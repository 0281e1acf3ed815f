"""Scene files, overrides, the default scene of a mesh, obstacles in files, and the sentences that a bad one gets."""

import os
import re
import shutil
import tomllib
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from commands import status_of
from meshes import cube, grid, quad_sphere
from pxr import Usd, UsdGeom
from trajectories import stepped

from balloon_warp import InputError, PolygonMesh, Simulator
from balloon_warp.cli.app import app
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import Model, build_model, plan_model
from balloon_warp.model.obstacles import shape_obstacle
from balloon_warp.run.report import describe_scene, hash_files, without_folders
from balloon_warp.scene import Balloon, Obstacle, Scene, Sphere, Stiffness, String, load_scene
from balloon_warp.scene.fields import first_line, missed_between_frames
from balloon_warp.scene.load import bundled_scenes, override_scene, parse_override, scene_name, scene_toml, write_scene
from balloon_warp.scene.reference import as_markdown, tables, unsaid

SCENE = 'description = "a box and two balls"\nframes = 10\n[[balloon]]\nmesh = "box.obj"\n'
SCENE += '[[balloon]]\nmesh = "box.obj"\nposition = [3, 0, 0]\n'
SCENE += "[[sphere]]\nposition = [0, 2, 0]\n[[sphere]]\nposition = [1, 2, 0]\nmass = 7\n"


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    write_obj(tmp_path / "box.obj", cube())
    path = tmp_path / "boxes.toml"
    path.write_text(SCENE)
    return path


def load_with(path: Path, *overrides: str) -> Scene:
    return load_scene(path, [parse_override(text) for text in overrides])


def scene_of(folder: Path, mesh: PolygonMesh, *overrides: str, factor: float = 1.0) -> Scene:
    """Return the scene of a file with the mesh, so many times as large."""
    write_obj(folder / "ball.obj", replace(mesh, points=factor * mesh.points))
    return load_with(folder / "ball.obj", *overrides)


def model_of(*balloons: Balloon, **fields: object) -> Model:
    return build_model(Scene(balloon=list(balloons), **fields), "cpu")


def test_a_scene_file_is_read_with_its_meshes_beside_it(scene_file: Path, monkeypatch: pytest.MonkeyPatch):
    scene = load_scene(scene_file)
    assert (scene.frames, len(scene.balloon), scene.sphere[1].mass) == (10, 2, 7.0)
    assert scene.balloon[0].mesh == scene_file.parent / "box.obj"
    assert build_model(scene, "cpu").particle_count == 16
    monkeypatch.chdir(scene_file.parent)  # where an override seeks a mesh
    other = load_scene("squirrel_inflate", [("balloon.mesh", "box.obj")])
    assert build_model(other, "cpu").particle_count == 8


def test_an_override_reaches_all_or_one_and_makes_tables_that_are_not_there(scene_file: Path):
    every = load_with(scene_file, "balloon.inflation.k_normal=3", "sphere.mass=100")
    assert [balloon.inflation.k_normal for balloon in every.balloon] == [3.0, 3.0]
    assert [sphere.mass for sphere in every.sphere] == [100.0, 100.0]
    one = load_with(scene_file, "balloon.1.inflation.k_normal=[[0, 1], [2, 0.5]]", "sphere.0.mass=100")
    assert one.balloon[1].inflation.keyframes == [(0.0, 1.0), (2.0, 0.5)]
    assert one.balloon[0].inflation == Balloon(mesh="x").inflation
    assert [sphere.mass for sphere in one.sphere] == [100.0, 7.0]
    scene = load_with(scene_file, "ground.height=-1", "up_axis=Z")
    assert scene.ground is not None
    assert (scene.ground.height, scene.up_axis) == (-1.0, "Z")
    values = {"balloon.mass": 3.0, "frames": 7}  # a mapping or pairs
    assert load_scene(scene_file, values) == load_scene(scene_file, list(values.items()))
    assert load_scene(scene_file, values).frames == 7


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("sphere.0.mass=-1", r"sphere\.0\.mass: must be greater than 0 \(got -1\)"),
        ("sphere.0.mass=1e-46", r"sphere\.0\.mass: must be at least 1e-12 \(got 1e-46\)"),
        ("balloon.inflation.k_norml=3", r"balloon\.0\.inflation\.k_norml: unknown field; did you mean k_normal\?"),
        ("k_normal=3", r"k_normal: unknown field; did you mean balloon\.inflation\.k_normal\?$"),
        ("balloon.shear=3", r"balloon\.0\.shear: unknown field; did you mean balloon\.stiffness\.shear\?$"),
        ("balloon.color=redd", r"balloon\.0\.color: must be a color such as \"red\" or \"#ff8000\", or three numbers"),
        ("balloon.material.kind=latex", r"kind: \"latex\" is a preset; expected preset = \"latex\"$"),
        ("balloon.parts=closed", r"balloon\.0\.parts: \"closed\" is a value of taken; expected taken = \"closed\"$"),
        ("balloon.material=rubber", r"balloon\.0\.material\.preset: must be 'latex', .* \(got 'rubber'\)"),
        ("fps=24", r"^fps: unknown field; did you mean frames_per_second\?$"),
        ("colour=1", r"colour: unknown field; did you mean balloon\.color, sphere\.color, .* or body\.color\?$"),
        ("xyzzy=1", r"xyzzy: unknown field; known here are description, up_axis, gravity, .*"),
        ("baloon.mass=1", r"baloon: unknown table; did you mean balloon\?$"),
        ("balloon.inflation.k_normal=much", r"k_normal: must be a valid number or a valid list \(got 'much'\)"),
        ("balloon.inflation.k_normal=[[0, 1], [0, 2]]", r"k_normal: keyframe times must increase \(got \[0\.0, "),
        ("balloon=[]", r"balloon: must be a list of at least one item \(got \[\]\)"),
        ("up_axis=X", r"up_axis: must be 'Y' or 'Z' \(got 'X'\)"),
        ("gravity=nan", r"gravity: must be .* \(got nan\)"),
        ("balloon.inflation.k_normal=[[0, 1], [0.01, 2]]", r"keyframes must be at least a frame apart, 0\.0166667 s"),
        ("string=[{anchor=[0, 0, 0], balloon=2}]", r"string\.0\.balloon: must be below .* balloons, 2 \(got 2\)"),
        ("string.stiffness=1", r"^string\.stiffness: cannot be set, the scene has no string$"),
        ("frames.x=1", r"^frames\.x: cannot be set, since a plain value has no field 'x'$"),
        ("frames", r"^--set frames: expected PATH=VALUE"),
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
        (b"[balloon]\nmesh = 'a.obj'", r"balloon: is one table, \[balloon\]; expected a list .* \[\[balloon\]\]$"),
        (b"[[balloon]]\nmesh = a.obj", r"Invalid value \(at line 2, column 8\); text needs quotes$"),
        (b"balloon = 3", r"balloon: must be a valid list \(got 3\)"),
        (b"[[balloon]]\nmesh = 'a'\n'b.c.d' = 1", r"balloon\.0\.b\.c\.d: unknown field; known here are mesh, .*"),
        (b"[[balloon]]\nmesh = 'a'\n" + 9999 * b"x" + b" = 1", r"balloon\.0\.x{57}\.\.\.: unknown field; .*"),
        (b"frames = " + 4301 * b"9", r"is not valid TOML: Exceeds the limit \(4300 digits\) .* has 4301 digits$"),
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


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("zebra", r"^zebra: no such scene or file; bundled scenes are .*squirrel_tether"),
        # without a list of scenes where none has a similar name
        ("elephants_and_mice.obj", r"^elephants_and_mice\.obj: no such file in HERE$"),
        ("HERE/empty/zebra.toml", r"^HERE/empty/zebra\.toml: no such file$"),
        ("boxs.toml", r"^boxs\.toml: no such scene or file; did you mean boxes\.toml\?$"),
        ("BOX.OBJ", r"^BOX\.OBJ: no such scene or file; did you mean box\.obj\?$"),
        ("nowhere/box.obj", r"^nowhere/box\.obj: no such scene or file; no folder nowhere$"),
    ],
)
def test_what_is_not_there_asks_for_what_is_like_it(scene_file: Path, monkeypatch, source: str, sentence: str):
    here = scene_file.parent
    (here / "empty").mkdir()
    monkeypatch.chdir(here)
    with pytest.raises(InputError, match=sentence.replace("HERE", re.escape(str(here)))):
        load_scene(Path(source.replace("HERE", str(here))) if "HERE" in source else source)
    with pytest.raises(InputError, match=r"/bux\.obj: no such file; did you mean .*/box\.obj\?$"):
        build_model(load_scene(scene_file, {"balloon.mesh": "bux.obj"}), "cpu")


@pytest.mark.parametrize("name", bundled_scenes())
def test_a_bundled_scene_describes_itself_in_a_line_and_names_no_default(name: str):
    assert len(bundled_scenes()) >= 8
    scene = load_scene(name)
    assert 10 < len(scene.description) < 60  # beside the name, in a terminal of 80 columns
    assert scene_name(name) == name
    assert load_scene(name, {"frames_per_second": 24.0}).frames_per_second == 24.0  # which Blender plays
    table = tomllib.loads(bundled_scenes()[name].read_text())
    said = {key: getattr(scene, key) for key in table if key not in ("balloon", "sphere", "string", "ground")}
    assert [key for key in said if said[key] == Scene.model_fields[key].default] == []


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"scale": 1e11}, r"box: is 1e\+11 m across; expected 1e-06 to 1e\+09 m"),
        ({"position": (1e7, 0.0, 0.0)}, r"box: is 1 m across and 1e\+07 m from the origin, too far for 32-bit floats"),
        ({"stiffness": Stiffness(structural=1e11), "mass": 1e-6}, "needs more than 100,000 in a frame"),
        ({"fixed": [8]}, r"box has particles 0 to 7 \(got 8\)"),
    ],
)
def test_what_a_model_cannot_hold_is_refused(fields: dict, sentence: str):
    box = replace(cube(), name="box")
    with pytest.raises(InputError, match=sentence):
        model_of(Balloon(mesh=box, **fields))
    with pytest.raises(InputError, match=r"box has particles 0 to 7 \(got 8\)"):
        model_of(Balloon(mesh=box), string=[String(anchor=(0, 0, 0), particle=8)])


def test_a_mesh_with_z_up_is_turned_upright_in_meters():
    _, y, z = cube().points.T
    z_up = replace(cube(), up_axis="Z", meters_per_unit=0.01)
    points = model_of(Balloon(mesh=z_up)).initial_points.numpy()
    np.testing.assert_allclose(points[:, 1:], np.stack([0.01 * z, -0.01 * y], axis=1), atol=1e-6)


def test_keyframes_closer_than_a_frame_are_taken_where_little_is_missed():
    """A pump that stops within a frame is accepted with a stated error, as a frame is linear from its start to its end.
    A puff between two frames would be missed and is refused."""
    assert missed_between_frames([(0.0, 3.3), (0.06, 3.3), (0.065, 0.0)], 1.0 / 24.0) < 0.01
    assert missed_between_frames([(0.0, 1.0), (1.0, 2.0)], 0.5) == pytest.approx(0.0)
    assert missed_between_frames([(0.51, 0.0), (0.52, 1.0), (0.53, 0.0)], 0.5) == pytest.approx(1.0)
    assert missed_between_frames([(0.0, 0.0), (0.01, 0.0)], 0.5) == 0.0


Y_IS_UP = ". The file names no up axis, so Y is up; --up Z turns it"


@pytest.mark.parametrize("kind", ["normal_force", "pressure"])
@pytest.mark.parametrize("scale", [0.01, 200.0])
def test_a_mesh_gets_a_scene_of_the_same_motion_scaled_to_its_size(tmp_path: Path, scale: float, kind: str):
    def motion(factor: float) -> np.ndarray:
        scene = scene_of(tmp_path, quad_sphere(3), f"balloon.inflation.kind={kind}", factor=factor)
        points = stepped(Simulator(scene, "cpu"), 60).read_frame().points[0]
        assert np.ptp(points[:, 0]) > 1.02 * factor * np.ptp(quad_sphere(3).points[:, 0])  # it has begun to grow
        assert scene.ground is not None
        assert points[:, 1].min() == pytest.approx(scene.ground.height)  # it has fallen to the floor below it
        return points / factor

    np.testing.assert_allclose(motion(scale), motion(1.0), atol=1e-3)


@pytest.mark.parametrize("kind", ["normal_force", "pressure", "gas"])
@pytest.mark.parametrize("scale", [1e-6, 1e8])
def test_a_mesh_of_any_size_gets_a_scene(tmp_path: Path, scale: float, kind: str):
    scene = scene_of(tmp_path, quad_sphere(2), f"balloon.inflation.kind={kind}", factor=scale)
    assert scene.balloon[0].inflation.kind == kind


def test_the_numbers_of_its_scene_are_short_and_the_floor_is_below_it_anywhere(tmp_path: Path):
    for shift in (0.0, 123.45678):
        mesh = quad_sphere(3)
        mesh.points[:] = 0.123456789 * mesh.points + np.array([0.0, shift, 0.0])
        scene = scene_of(tmp_path, mesh)
        ball = scene.balloon[0]
        for value in (scene.gravity, ball.mass, ball.helium, ball.damping):
            assert len(repr(value).replace(".", "").lstrip("0")) <= 6
        size, low = np.ptp(mesh.points, axis=0).max(), mesh.points[:, 1].min()
        assert scene.ground is not None
        assert scene.ground.height == pytest.approx(low - 0.05 * size, abs=1e-5 * size)
        assert len(repr(scene.ground.height)) <= 12
    # An open mesh is held at its border, unless that is all of it: at its first face.
    assert set(scene_of(tmp_path, grid(3, 3)).balloon[0].fixed) == set(range(16)) - {5, 6, 9, 10}
    assert len(scene_of(tmp_path, grid(3, 1)).balloon[0].fixed) == 4


@pytest.mark.full
def test_a_mesh_by_itself_gets_half_as_much_gas_again_unless_it_is_said_how_much(tmp_path: Path):
    def amounts(*overrides: str) -> list[float]:
        scene = scene_of(tmp_path, quad_sphere(3), "balloon.inflation.kind=gas", "frames=95", *overrides)
        return [float(frame.gas_amounts[0]) for frame in Simulator(scene, "cpu").run()]

    pumped = amounts()
    assert pumped[95] / pumped[0] == pytest.approx(1.5, rel=1e-3)  # the ramp is pumped in steps
    assert np.ptp(amounts("balloon.inflation.start_pressure=100")) == 0.0
    assert np.ptp(amounts("balloon.inflation.amount=160")) == 0.0


@pytest.mark.parametrize(
    "said", ["litres=200", "breaths=3", "moles=5", "pump_curve=[[0, 1], [500, 0]]", "fill_to_pressure=50", "pump=0.5"]
)
def test_a_mesh_by_itself_takes_gas_as_one_says_it_with_or_without_the_kind(tmp_path: Path, said: str):
    for kind in ([], ["balloon.inflation.kind=gas"]):
        scene = scene_of(tmp_path, quad_sphere(3), f"balloon.inflation.{said}", *kind)
        inflation = scene.balloon[0].inflation
        assert (inflation.kind, inflation.pump) == ("gas", 0.5 if said == "pump=0.5" else 0.0)
        plan_model(scene)


def test_a_mesh_scene_follows_how_its_mesh_is_placed(tmp_path: Path):
    assert scene_of(tmp_path, cube(), "balloon.scale=0.01").gravity == pytest.approx(0.0981)
    turned = scene_of(tmp_path, cube(), "balloon.rotation=[45, 0, 0]")
    assert turned.ground is not None
    assert turned.ground.height < build_model(turned, "cpu").initial_points.numpy()[:, 1].min()


@pytest.mark.parametrize("kind", ["normal_force", "gas"])
@pytest.mark.parametrize(("unit", "size"), [("cm", 0.5), ("in", 1.27), ("m", 50.0)])
def test_a_known_unit_gives_true_size_and_gravity(tmp_path: Path, unit: str, size: float, kind: str):
    said = f"balloon.unit={unit}", f"balloon.inflation.kind={kind}"
    scene = scene_of(tmp_path, quad_sphere(3), *said, factor=50.0 / np.ptp(quad_sphere(3).points[:, 1]))
    (balloon,) = scene.balloon
    assert scene.gravity == pytest.approx(9.81)
    weight = balloon.mass * (scene.gravity - balloon.helium)
    assert weight == pytest.approx(2.0 * 1.81 * size, rel=1e-5)  # six digits
    assert np.ptp(build_model(scene, "cpu").shapes[0].mesh.points[:, 1]) == pytest.approx(size)
    begins = f"ball.obj, {size:.3g} m across, inflates above a floor"
    assert scene.description == f"{begins}{Y_IS_UP}. Its unit is {unit}, as given"


def test_gravity_that_is_scaled_to_a_mesh_is_said_with_what_to_do(tmp_path: Path):
    said = scene_of(tmp_path, cube(), factor=171.8)
    assert said.gravity == 1685.36
    assert said.description == (
        "ball.obj inflates above a floor. Unit unknown: gravity scaled to 1685 m/s2, so that it moves like an "
        "object of 1 m. --unit m, cm, mm, km, in or ft gives it true size and gravity" + Y_IS_UP
    )
    assert scene_of(tmp_path, cube(), "gravity=0").description == "ball.obj inflates above a floor" + Y_IS_UP


@pytest.mark.parametrize(("said", "gravity"), [(True, 9.81), (False, 0.0981)])
def test_the_unit_of_a_stage_is_known_where_it_says_one(tmp_path: Path, said: bool, gravity: float):
    """The unit of a stage is known where it is authored: USD's default is centimeters."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "box.usda"))
    if said:
        UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    prim, mesh = UsdGeom.Mesh.Define(stage, "/box"), cube()
    prim.CreatePointsAttr(mesh.points)
    prim.CreateFaceVertexCountsAttr(mesh.face_vertex_counts)
    prim.CreateFaceVertexIndicesAttr(mesh.face_vertex_indices)
    stage.Save()
    assert load_scene(tmp_path / "box.usda").gravity == pytest.approx(gravity)


def test_the_command_says_it_first_and_takes_a_unit(tmp_path: Path, capsys):
    write_obj(tmp_path / "box.obj", cube())
    run = f"run {tmp_path}/box.obj --set frames=1 --device cpu -o {tmp_path}/out.usdc".split()
    unknown = "note: box.obj inflates above a floor. Unit unknown: gravity scaled to 9.81 m/s2, so that it "
    for more, first, status in (
        ([], unknown, 0),
        (["--unit", "ft"], "note: box.obj, 0.305 m across, inflates above a floor", 0),
        (["--unit", "furlong"], "error: --unit furlong: expected m, cm, mm, km, in, ft", 2),
    ):
        assert status_of(*run, *more) == status
        assert capsys.readouterr().err.startswith(first)


def test_the_axis_of_a_file_that_points_up_can_be_told(tmp_path: Path):
    cone = trimesh.creation.cone(radius=0.3, height=1.2)
    cone.export(tmp_path / "cone.obj")
    for world, up_axis in (("Y", 1), ("Z", 2)):
        for told, height in ((["balloon.up=Z"], 1.2), ([], 0.6)):
            scene = load_with(tmp_path / "cone.obj", f"up_axis={world}", *told)
            points = plan_model(scene).shapes[0].mesh.points
            assert np.ptp(points[:, up_axis]) == pytest.approx(height, rel=0.02)  # of 32 corners
            up = "Z is up, as given" if told else "The file names no up axis, so Y is up; --up Z turns it"
            turned = f". It is turned to the scene's {world}" if (world == "Z") != bool(told) else ""
            assert scene.description.endswith(f". {up}{turned}")
            asked = [warning for warning in plan_model(scene).warnings if "names no up axis" in warning]
            assert len(asked) == (world == "Z" and not told)
            obstacle = Obstacle(mesh=tmp_path / "cone.obj", up="Z" if told else None)
            shape = shape_obstacle(0, obstacle, scene)
            assert shape.mesh
            assert np.ptp(shape.mesh.points[:, up_axis]) == pytest.approx(height, rel=0.02)
    trimesh.Scene(cone).export(tmp_path / "cone.glb")
    assert load_scene(tmp_path / "cone.glb").description == (
        "cone.glb, 1.2 m across, inflates above a floor. Y is up, as its file says. Its unit is m, as its file says"
    )


PAGE = Path(__file__).parent.parent / "docs" / "SCENE.md"


@pytest.mark.full
@pytest.mark.parametrize("name", bundled_scenes())
def test_a_bundled_scene_is_written_with_its_meshes_and_can_be_moved(tmp_path: Path, name: str):
    (tmp_path / "here").mkdir()
    scene = load_scene(name)
    written = write_scene(scene, tmp_path / "here" / "mine.toml")
    assert sorted(written) == sorted((tmp_path / "here").iterdir())
    moved = load_scene(shutil.move(tmp_path / "here", tmp_path / "there") / "mine.toml")
    names, names_there = (without_folders({"scene": describe_scene(each)}) for each in (scene, moved))
    assert names_there == names
    assert hash_files(moved) == hash_files(scene)
    assert str(tmp_path / "here") not in str(moved)
    printed = tmp_path / "printed.toml"
    printed.write_text(scene_toml(scene, tmp_path))
    assert load_scene(printed) == scene


def test_a_copy_of_the_mesh_stays_and_another_file_is_not_replaced(tmp_path: Path):
    path = tmp_path / "mine.toml"
    assert write_scene(load_scene("two_balloons"), path) == [path, tmp_path / "ball.obj"]
    assert write_scene(load_scene("two_balloons"), path) == [path]
    before = path.read_bytes()
    (tmp_path / "ball.obj").write_text("of my own")
    mine = r"/ball\.obj: already exists and differs from the scene's file of that name; "
    with pytest.raises(InputError, match=mine):
        write_scene(load_scene("two_balloons"), path)
    assert (path.read_bytes(), (tmp_path / "ball.obj").read_text()) == (before, "of my own")


def test_a_mesh_of_ones_own_is_named_from_the_file(tmp_path: Path):
    for folder in ("meshes", "scenes/real"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "scenes" / "real")
    write_obj(tmp_path / "meshes" / "ball.obj", quad_sphere(2))
    path = tmp_path / "link" / "mine.toml"
    write_scene(load_scene(tmp_path / "meshes" / "ball.obj"), path)
    assert tomllib.loads(path.read_text())["balloon"][0]["mesh"] == "../../meshes/ball.obj"
    assert Path(str(load_scene(path).balloon[0].mesh)).exists()


def test_each_value_has_its_unit_and_default_beside_it():
    scene = Scene(
        substeps=20,
        solver="forward_euler",
        balloon=[Balloon(mesh="a.obj", mass=0.2, law={"magnet": {"strength": 5.0}})],
        sphere=[Sphere(position=(0.0, 1.0, 0.0), mass=3.0)],
    )
    text = scene_toml(scene, Path())
    lines = [re.sub(" +# ", "  # ", line) for line in text.splitlines()]
    assert "mass = 0.2  # Mass of the whole balloon, shared equally by its particles [kg]; default 0.1" in lines
    assert "position = [0.0, 1.0, 0.0]  # Position of the center at the start [m]" in lines
    assert "mass = 3.0                  # Mass [kg]; default 1.0\n" in text  # beneath the other comment
    assert "[[sphere]]  # A rigid sphere that collides with balloons, spheres, obstacles and the ground." in lines
    above = lines[: lines.index('solver = "forward_euler"')]
    assert above[-1].endswith('"symplectic_euler"')  # too long to stand beside it
    assert above[-3].startswith("# Time integrator: ")
    assert "law = { magnet = { strength = 5.0 } }" in text


def test_the_tables_in_the_docs_are_what_the_schema_says():
    """Every field has a description, also below it, for editors; that of a table fits into a row and a scene file."""
    (found,) = re.findall(r"<!-- fields -->\n\n(.*?)\n\n<!-- end -->", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert found == as_markdown(), "python -m balloon_warp.scene.reference makes them anew"
    rows = [line.strip("| ").split(" | ") for line in found.splitlines() if line.startswith("| `")]
    assert len(rows) > 150
    assert [row[0] for row in rows if len(row) < 4 or not row[1].strip()] == []
    assert [heading for heading, table in tables() if table.__doc__ and not first_line(table).endswith(".")] == []
    assert [f"{table.__name__}.{field}: {meaning}" for table, field, meaning in unsaid()] == []


def asked(size: float, **said: object) -> list[str]:
    """Return the questions about a ball of that size."""
    ball = quad_sphere(4, 0.5)
    overrides = {f"balloon.{name.replace('__', '.')}": value for name, value in said.items()}
    scene = load_scene(replace(ball, points=size / np.ptp(ball.points[:, 0]) * ball.points), overrides)
    return [warning for warning in plan_model(scene).warnings if "?" in warning]


@pytest.mark.parametrize("size", [0.03, 0.2, 1.0, 20.0])
@pytest.mark.parametrize("said", [{}, {"material__preset": "latex"}, {"inflation__kind": "gas"}])
def test_nothing_is_asked_about_ordinary_ones(size: float, said: dict) -> None:
    assert asked(size, **said) == []


@pytest.mark.full
@pytest.mark.parametrize("name", bundled_scenes())
def test_nothing_is_asked_about_bundled_scenes(name: str) -> None:
    assert not [warning for warning in plan_model(load_scene(name)).warnings if "?" in warning]


def test_a_size_a_wall_and_a_mass_are_asked_about() -> None:
    assert "100 m? --unit cm?" in asked(100.0)[0]
    assert "2e+03 m? --unit cm?" in asked(2000.0)[0]
    assert "0.0002 m? balloon.scale = 1" in asked(0.0002)[0]
    assert asked(100.0, unit="m") == []
    assert "0.0002 m? --unit mm?" in asked(0.2, unit="mm")[0]
    wall = asked(0.3, material__kind="neo_hookean", material__thickness=0.2)
    assert "a wall 0.2 m thick, for a balloon of 0.3 m?" in wall[0]
    assert "a mass of 500 kg, for a balloon of 1 m?" in asked(1.0, mass=500.0)[0]
    assert plan_model(load_scene(cube())).warnings == []


def test_inspect_asks_too(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    ball = quad_sphere(4, 0.5)
    write_obj(tmp_path / "ball.obj", replace(ball, points=500.0 * ball.points))
    (tmp_path / "big.toml").write_text('up_axis = "Z"\n[[balloon]]\nmesh = "ball.obj"\nmass = 2.0\n')
    for source in ("ball.obj", "big.toml"):
        app(["inspect", str(tmp_path / source)], standalone_mode=False)
        said = capsys.readouterr().out
        assert "m? --unit cm?" in said
        assert "names no up axis" in " ".join(said.split())


@pytest.mark.full
@pytest.mark.parametrize("command", ["run", "batch --worlds 2", "inspect"])
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("source", ["ball.obj", "ball.toml"])
def test_the_axis_is_said_once(source: str, up_axis: str, command: str, tmp_path: Path, capfd) -> None:
    write_obj(tmp_path / "ball.obj", quad_sphere(3, 0.5))
    (tmp_path / "ball.toml").write_text('[[balloon]]\nmesh = "ball.obj"\n')
    name, *options = command.split()
    if name != "inspect":
        options += ["--set", "frames=1", "--device", "cpu", "-o", str(tmp_path / ("out" + ".usdc" * (name == "run")))]
    app([name, str(tmp_path / source), "--set", f"up_axis={up_axis}", *options], standalone_mode=False)
    said = " ".join("".join(capfd.readouterr()).split())
    assert said.count("file names no up axis") == (source == "ball.obj" or up_axis == "Z")


MOTION = [(0.0, (0.0, 0.0, 0.0)), (0.5, (0.0, -1.0, 0.0), (0.0, 90.0, 0.0))]
INSIDE = r"^balloon\.0\.position: ball starts 0\.0\d+ m deep inside obstacle 0, a {}; expected it outside$"


def scene(folder: Path) -> Scene:
    """Return a file that names two mesh files beside it."""
    write_obj(folder / "ball.obj", quad_sphere(2))
    write_obj(folder / "tile.obj", cube())
    path = folder / "scene.toml"
    path.write_text(
        """
        [[balloon]]
        mesh = "ball.obj"
        [[obstacle]]
        mesh = "tile.obj"
        scale = 2.0
        position = [0.0, -4.0, 0.0]
        motion = [[0.0, [0.0, 0.0, 0.0]], [0.5, [0.0, -1.0, 0.0], [0.0, 90.0, 0.0]]]
        [[obstacle]]
        radius = 0.2
        position = [3.0, 0.0, 0.0]
        """
    )
    return load_scene(path)


def test_obstacles_are_as_their_fields_say_and_stay_so_in_a_written_scene(tmp_path: Path):
    before = scene(tmp_path)
    tile, capsule = before.obstacle
    assert (tile.shape, tile.mesh, tile.motion) == ("mesh", tmp_path / "tile.obj", MOTION)
    assert (capsule.shape, capsule.length) == ("capsule", 1.0)
    (tmp_path / "elsewhere").mkdir()
    (written,) = write_scene(before, tmp_path / "elsewhere" / "mine.toml")
    after = load_scene(written)
    assert Path(str(after.obstacle[0].mesh)).resolve() == before.obstacle[0].mesh
    there = [obstacle.model_copy(update={"mesh": None}) for obstacle in after.obstacle]
    assert there == [obstacle.model_copy(update={"mesh": None}) for obstacle in before.obstacle]


def test_overrides_keep_a_mesh_that_came_from_python():
    made = Scene(balloon=[Balloon(mesh=quad_sphere(2))], obstacle=[Obstacle(mesh=grid(2, 2), position=(0, -3, 0))])
    changed = override_scene(made, {"obstacle.0.friction": 0.1, "obstacle.position": (0.0, -2.0, 0.0)}.items())
    assert isinstance(changed.obstacle[0].mesh, PolygonMesh)
    np.testing.assert_array_equal(changed.obstacle[0].mesh.points, grid(2, 2).points)
    assert (changed.obstacle[0].friction, changed.obstacle[0].position) == (0.1, (0.0, -2.0, 0.0))


NO_FACES = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
MISTAKES = {
    'mesh = "none.obj"': r"none\.obj: has no faces \(no line begins with f\)$",
    'mesh = "nan.obj"': r"nan\.obj, line 2: coordinates must be finite and fit in 32-bit floats \(got nan 0\.0 0\.0\)$",
    'mesh = "point.obj"': r"point\.obj: all vertices coincide; expected a mesh with an extent$",
    'shape = "mesh"': r'obstacle\.0\.mesh: is missing; shape = "mesh" needs a mesh file$',
    "size = [1, 1, 1]\nradius = 0.2": r'obstacle\.0\.radius: needs shape = "capsule" \(got shape = "box"\)$',
    'shape = "plane"\nscale = 2.0': r'obstacle\.0\.scale: needs shape = "mesh" \(got shape = "plane"\)$',
    "motion = [[0.0, [0, 0, 0]], [1e9, [0, 1, 0]]]": r"motion: ends after 1e\+09 s; expected 16666\.7 s at most$",
    "motion = [[0.0, [0, 0, 0]], [0.1, [0, 0, 0], [0, 3600, 0]]]": (
        r"obstacle\.0\.motion: turns by 600 degrees in a frame; expected at most 90$"
    ),
}


@pytest.mark.parametrize("said", MISTAKES)
def test_a_mistake_gets_a_sentence(said: str, tmp_path: Path):
    scene(tmp_path)
    (tmp_path / "none.obj").write_text(NO_FACES)
    (tmp_path / "nan.obj").write_text(NO_FACES.replace("1", "nan") + "f 1 2 3\n")
    (tmp_path / "point.obj").write_text(NO_FACES.replace("1", "0") + "f 1 2 3\n")
    path = tmp_path / "wrong.toml"
    path.write_text(f'[[balloon]]\nmesh = "ball.obj"\n[[obstacle]]\nposition = [0, -9, 0]\n{said}\n')
    with pytest.raises(InputError, match=MISTAKES[said]):
        plan_model(load_scene(path))


def starts(obstacle: Obstacle, **fields) -> None:
    """Plan a ball of radius 0.5 at the origin beside an obstacle."""
    balloon = Balloon(mesh=quad_sphere(6, 0.5), name="ball")
    plan_model(Scene(**{"balloon": [balloon], "obstacle": [obstacle], **fields}))


@pytest.mark.full
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize(
    ("fields", "touching", "direction", "kind"),
    [
        ({"size": (2.0, 0.4, 2.0)}, 0.7, (0.0, -1.0, 0.0), "box"),
        ({"size": (2.0, 0.4, 2.0), "rotation": (0.0, 0.0, 90.0)}, 0.7, (-1.0, 0.0, 0.0), "box"),
        ({"radius": 0.2}, 0.7, (1.0, 0.0, 0.0), "capsule"),
        ({"radius": 0.2, "length": 0.0}, 0.7, (0.0, 0.6, 0.8), "capsule"),
        ({"mesh": quad_sphere(12, 0.4)}, 0.9, (0.0, -1.0, 0.0), "mesh"),
        ({"radius": 0.2, "motion": [(0.0, (0.0, 5.0, 0.0))]}, 0.7, (0.0, -1.0, 0.0), None),
    ],
)
def test_a_balloon_that_starts_inside_an_obstacle_is_refused(fields, touching, direction, kind, up_axis: str):
    for gap, refused in ((0.0, False), (-0.05, kind is not None)):
        place = tuple((touching + gap) * np.array(direction))
        with pytest.raises(InputError, match=INSIDE.format(kind)) if refused else nullcontext():
            starts(Obstacle(position=place, **fields), up_axis=up_axis)


@pytest.mark.parametrize(("up_axis", "place"), [("Y", (7.0, -0.4, 3.0)), ("Z", (7.0, 3.0, -0.4))])
def test_a_balloon_that_starts_below_a_plane_is_refused(up_axis: str, place):
    with pytest.raises(InputError, match=r"ball starts 0\.1 m deep inside obstacle 0, floor; expected it outside"):
        starts(Obstacle(shape="plane", position=place, name="floor"), up_axis=up_axis)
    starts(Obstacle(shape="plane", position=tuple(1.25 * np.array(place))), up_axis=up_axis)


def test_sheets_and_fixed_particles_have_nothing_inside():
    starts(Obstacle(mesh=grid(2, 2), position=(-0.5, 0.0, 0.0)))
    held = Balloon(mesh=quad_sphere(3, 0.5), fixed=list(range(quad_sphere(3).vertex_count)))
    starts(Obstacle(), balloon=[held])


@pytest.mark.full
def test_a_mesh_that_winds_inward_is_a_room_and_holds_a_ball(device: str):
    walls = cube()
    room = replace(walls, points=4.0 * (walls.points - 0.5), face_vertex_indices=walls.face_vertex_indices[::-1].copy())
    ball = Balloon(mesh=quad_sphere(2, 0.3), velocity=(4.0, 1.0, 2.0), damping=0.0)
    simulator = Simulator(Scene(balloon=[ball], obstacle=[Obstacle(mesh=room)], frames=90), device)
    frames = list(simulator.run())
    assert max(np.abs(frame.points[0]).max() for frame in frames) < 2.0
    assert np.ptp(frames[-1].points[0], axis=0).max() > 0.3
    solid = replace(room, face_vertex_indices=walls.face_vertex_indices)
    with pytest.raises(InputError, match=r"starts .* deep inside obstacle 0"):
        plan_model(Scene(balloon=[ball], obstacle=[Obstacle(mesh=solid)]))


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_a_start_is_refused_as_deep_as_its_deepest_particle(size: float):
    """Boxes smaller and larger than the ball, at any place, may have a hundredth of the smaller extent of it within."""
    ball, half, rng = quad_sphere(3, 0.5), 0.5 * np.array([1.0, 0.8, 1.2]) * size, np.random.default_rng(4)
    verdicts = []
    for place in rng.uniform(-1.0, 1.0, (40, 3)) * (half + 0.55):
        within = (half - np.abs(ball.points - place)).min(axis=1)
        box = Obstacle(size=tuple(2.0 * half), position=tuple(place))
        allowed = 0.01 * min(float(np.ptp(ball.points, axis=0).max()), float(np.linalg.norm(half)))
        verdicts.append(within.max() > allowed)
        with pytest.raises(InputError, match=f" {within.max():.3g} m deep") if verdicts[-1] else nullcontext():
            plan_model(Scene(balloon=[Balloon(mesh=ball)], obstacle=[box], substeps=64))
    assert 5 < sum(verdicts) < 36


def test_every_world_is_looked_at():
    made = Scene(balloon=[Balloon(mesh=quad_sphere(3, 0.5), name="ball")], obstacle=[Obstacle(position=(0, -1, 0))])
    plan_model(made, 3, {"balloon.position.1": [0.1, 0.2, 0.3], "obstacle.position.1": [-1.0, -2.0, -0.8]})
    with pytest.raises(InputError, match=r"ball starts in world 2 0\.3\d* m deep inside obstacle 0, a box; expected"):
        plan_model(made, 3, {"obstacle.position.1": [-1.0, -2.0, -0.6]})

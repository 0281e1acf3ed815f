"""Extension of Blender, in Blender's own Python module: what its panel bakes, and what becomes of it."""

import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from balloon_warp import Balloon, Ground, Inflation, PolygonMesh, Scene, Stiffness, simulate
from balloon_warp.blender.extension import write_extension
from balloon_warp.blender.request import read_request

bpy = pytest.importorskip("bpy", reason="needs Blender's module: pip install bpy, for its Python")

from balloon_warp.blender import addon  # noqa: E402 (from here on Blender is there)
from balloon_warp.blender.addon import baking, modifier, panel, preview  # noqa: E402

FRAMES = 24
PATIENCE = 300.0
"""Longest time of a bake, with the compiling of its kernels [s]"""
NEAR = 1e-5
"""Rounding of float32 places of some meters, there and back between axes [m]"""


@pytest.fixture(scope="module", autouse=True)
def registered() -> Iterator[None]:
    bpy.ops.wm.read_factory_settings()
    addon.register()
    yield
    addon.unregister()


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Any]:
    """Return the scene of a new file beside which it bakes: Blender's own, with a cube."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.context.scene.frame_end = 1 + FRAMES
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "film.blend"))
    yield bpy.context.scene
    baking.stop()


def select(*things: Any) -> None:
    for each in bpy.context.view_layer.objects:
        each.select_set(each in things)
    bpy.context.view_layer.objects.active = things[0]


def inflate(thing: Any, **settings: Any) -> Any:
    """Press Inflate, and set properties."""
    select(thing)
    assert bpy.ops.balloon.inflate() == {"FINISHED"}
    for name, value in settings.items():
        setattr(thing.balloon_warp, name, value)
    return thing


def subdivide(thing: Any, levels: int) -> None:
    made = thing.modifiers.new("Subdivision", "SUBSURF")
    made.levels = made.render_levels = levels


def wait(until: Any = lambda bake: False) -> str:
    """Follow the bake as Blender's timer does, to its end or until then; return what the panel says."""
    end = time.monotonic() + PATIENCE
    while (bake := baking.running) and baking.watch() is not None and not until(bake):
        assert time.monotonic() < end
        time.sleep(0.02)
    return bpy.context.scene.balloon_warp.message


def bake() -> None:
    """Press Bake, and wait for all frames."""
    scene = bpy.context.scene
    assert bpy.ops.balloon.bake() == {"FINISHED"}
    assert wait() == f"Baked {scene.frame_end - scene.frame_start} frames"


def shown(thing: Any, frame: int) -> np.ndarray:
    """Return the points of an object in a frame after the start as Blender evaluates it, in the world."""
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + frame)
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    evaluated.to_mesh_clear()
    place = np.array(evaluated.matrix_world)
    return points.reshape(-1, 3) @ place[:3, :3].T + place[:3, 3]


def assert_simulated(scene: Any, things: list[Any]) -> None:
    """Assert that Blender shows what `simulate` makes of the scene."""
    moved = simulate(read_request(baking.folder_of(scene)).scene, device="cpu")
    for thing, points in zip(things, moved.points, strict=True):
        for frame in (0, 1, FRAMES):
            assert np.abs(shown(thing, frame) - points[frame]).max() < NEAR


def test_a_cube_is_baked_as_python_simulates_it(scene: Any):
    cube = bpy.data.objects["Cube"]
    cube.location = (0.5, 0.0, 1.2)
    subdivide(cube, 3)
    start = shown(cube, 0)
    inflate(cube, mass=0.2)
    scene.balloon_warp.ground = True
    bake()
    evaluated = cube.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    faces = [list(face.vertices) for face in mesh.polygons]
    evaluated.to_mesh_clear()
    # The same scene, said in Python.
    skin = PolygonMesh(start.astype(float), np.full(len(faces), 4, np.int32), np.array(faces, np.int32).ravel())
    balloon = Balloon(
        mesh=skin,
        up="Z",
        mass=0.2,
        helium=9.0,
        damping=0.1,
        friction=0.5,
        stiffness=Stiffness(structural=80.0, shear=40.0, flexion=16.0, even=True, thin="tied"),
        inflation=Inflation(stretch=2.0 ** (1 / 3) - 1),
    )
    said = Scene(
        up_axis="Z", frames=FRAMES, frames_per_second=24.0, balloon=[balloon], ground=Ground(height=0.0), gravity=9.81
    )
    moved = simulate(said, device="cpu")
    assert np.abs(moved.points[0][FRAMES] - start).max() > 0.1
    for frame in (0, 1, FRAMES):
        assert np.abs(shown(cube, frame) - moved.points[0][frame]).max() < NEAR
    assert np.array_equal(shown(cube, -1), shown(cube, 0))  # before the start, and after the end, it rests
    assert np.array_equal(shown(cube, FRAMES + 5), shown(cube, FRAMES))


def test_suzanne_under_a_pressure_that_is_animated(scene: Any):
    bpy.ops.mesh.primitive_monkey_add(location=(0.0, 0.0, 2.0), rotation=(0.4, 0.0, 0.3))
    suzanne = inflate(bpy.context.object, inflate="PRESSURE", lift=9.81)
    group = suzanne.vertex_groups.new(name="Neck")
    lowest = np.argsort([vertex.co.z for vertex in suzanne.data.vertices])[:20].tolist()
    group.add(lowest, 1.0, "REPLACE")
    suzanne.balloon_warp.pinned = "Neck"
    for frame, pressure in ((1, 0.0), (13, 20.0), (25, 5.0)):
        suzanne.balloon_warp.pressure = pressure
        suzanne.balloon_warp.keyframe_insert("pressure", frame=frame)
    bake()
    assert_simulated(scene, [suzanne])
    keyed = read_request(baking.folder_of(scene)).scene.balloon[0].inflation.pressure
    assert [keyed[frame][1] for frame in (0, 12, 24)] == pytest.approx([0.0, 20.0, 5.0])
    assert np.abs(shown(suzanne, FRAMES) - shown(suzanne, 0))[lowest].max() < NEAR
    assert np.abs(shown(suzanne, 12) - shown(suzanne, 0)).max() > 0.01


def test_two_balloons_and_an_animated_obstacle(scene: Any):
    # One is mirrored and of uneven scale, the other hangs in a parent; a plank sweeps into both.
    one = bpy.data.objects["Cube"]
    one.location, one.scale, one.rotation_euler = (0.0, 0.0, 1.5), (-0.5, 0.6, 0.7), (0.2, 0.1, 0.5)
    subdivide(one, 2)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8, radius=0.5, location=(1.1, 0.0, 0.0))
    other = bpy.context.object
    other.parent = bpy.data.objects.new("Stand", None)
    scene.collection.objects.link(other.parent)
    other.parent.location.z = 1.5
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(-2.0, 0.0, 1.5), scale=(0.2, 2.0, 2.0))
    plank = bpy.context.object
    plank.balloon_warp.role = "OBSTACLE"
    for frame, x, turn in ((1, -1.0, 0.0), (25, 0.2, math.pi / 6)):
        plank.location.x, plank.rotation_euler.z = x, turn
        plank.keyframe_insert("location", frame=frame)
        plank.keyframe_insert("rotation_euler", frame=frame)
    for each in (one, other):
        inflate(each, inflate="VOLUME", volume=1.3, lift=9.81)
    bake()
    assert_simulated(scene, [one, other])
    pushed = shown(one, FRAMES).mean(axis=0) - shown(one, 0).mean(axis=0)
    assert pushed[0] > 0.2
    # The obstacle of the scene goes where Blender's goes.
    (obstacle,) = read_request(baking.folder_of(scene)).scene.obstacle
    _, shift, *turn = (obstacle.motion or [])[12]
    shown(plank, 12)
    place = plank.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world
    assert np.allclose(np.array(obstacle.position) + shift, place.translation, atol=1e-6)
    assert turn[0] == pytest.approx([0.0, 0.0, math.degrees(place.to_euler().z)], abs=1e-3)


def test_the_add_on_goes_and_comes_back_with_what_the_file_keeps(scene: Any):
    cube = inflate(bpy.data.objects["Cube"], mass=3.0)
    addon.unregister()
    assert not hasattr(cube, "balloon_warp")
    assert "inflate" not in dir(bpy.ops.balloon)
    addon.register()
    assert cube.balloon_warp.mass == 3.0


def test_properties_outlast_saving(scene: Any, tmp_path: Path):
    cube = inflate(bpy.data.objects["Cube"], material="LATEX", inflate="LITRES", litres=3.0, pinned="")
    cube.balloon_warp.string = bpy.data.objects.new("Hook", None)
    scene.balloon_warp.ground_height = -2.0
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "film.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "film.blend"))
    kept = bpy.data.objects["Cube"].balloon_warp
    assert (kept.role, kept.material, kept.inflate, kept.litres) == ("BALLOON", "LATEX", "LITRES", 3.0)
    assert kept.string == bpy.data.objects["Hook"]
    assert bpy.context.scene.balloon_warp.ground_height == -2.0
    assert modifier.find(bpy.data.objects["Cube"])


def test_undo_takes_inflate_and_bake_back(scene: Any):
    scene.frame_end = 3
    bpy.ops.ed.undo_push(message="before")
    select(bpy.data.objects["Cube"])
    bpy.ops.balloon.inflate()
    bpy.ops.ed.undo_push(message="Inflate")
    bpy.ops.balloon.bake()
    bpy.ops.ed.undo_push(message="Bake")
    bpy.ops.ed.undo()
    assert not modifier.caches_of(bpy.context.scene)  # while the process still works
    wait()
    bpy.ops.ed.undo()
    cube = bpy.data.objects["Cube"]
    assert cube.balloon_warp.role == "NONE"
    assert not cube.modifiers
    bpy.ops.ed.redo()
    bpy.ops.ed.redo()
    assert modifier.caches_of(bpy.context.scene)


def test_a_duplicate_plays_the_bake_until_its_own(scene: Any):
    scene.frame_end = 5
    cube = inflate(bpy.data.objects["Cube"])
    bake()
    select(cube)
    bpy.ops.object.duplicate()
    other = bpy.context.object
    assert other.balloon_warp.role == "BALLOON"
    assert np.array_equal(shown(other, 4), shown(cube, 4))
    other.location.x += 5.0
    bake()
    assert len(set(modifier.caches_of(scene).values())) == 2
    assert np.abs(shown(other, 4) - shown(cube, 4) - (5.0, 0.0, 0.0)).max() < 1e-3


def test_deleting_a_bake_brings_the_object_back(scene: Any, tmp_path: Path):
    scene.frame_end = 3
    cube = bpy.data.objects["Cube"]
    before = shown(cube, 2)
    inflate(cube)
    bake()
    assert np.abs(shown(cube, 2) - before).max() > 1e-4
    assert bpy.ops.balloon.delete() == {"FINISHED"}
    assert np.array_equal(shown(cube, 2), before)
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["film.blend"]
    select(cube)
    bpy.ops.balloon.remove()
    assert not cube.modifiers


def test_a_cache_of_somebody_elses_stays(scene: Any, tmp_path: Path):
    """A modifier of the same name may play it: its folder is not a bake's."""
    cube, theirs = bpy.data.objects["Cube"], tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "cube.pc2").write_bytes(b"theirs")
    modifier.play(modifier.add(cube), theirs / "cube.pc2", 1)
    assert bpy.ops.balloon.delete() == {"FINISHED"}
    assert (theirs / "cube.pc2").read_bytes() == b"theirs"


def file_of(thing: Any) -> Path:
    path = modifier.cache_of(thing)
    assert path
    return path


def test_a_bake_goes_on_where_it_was_cancelled_or_killed(scene: Any):
    scene.frame_end = 61
    cube = bpy.data.objects["Cube"]
    subdivide(cube, 4)
    inflate(cube)
    bake()
    frames = file_of(cube).read_bytes()

    assert bpy.ops.balloon.bake() == {"FINISHED"}
    wait(until=lambda bake: bake.frame > 3)
    bpy.ops.balloon.cancel()
    assert wait().startswith("Cancelled at frame")
    assert not scene.balloon_warp.is_error
    assert bpy.ops.balloon.resume() == {"FINISHED"}
    wait(until=lambda bake: bake.frame > 12)
    assert baking.running
    baking.running.process.kill()
    assert wait().endswith("Continue goes on")
    assert scene.balloon_warp.is_error
    assert np.isfinite(shown(cube, 60)).all()
    assert bpy.ops.balloon.resume() == {"FINISHED"}
    assert wait() == "Baked 60 frames"
    assert file_of(cube).read_bytes() == frames
    assert not baking.can_continue(scene)


def test_a_preview_follows_what_is_dragged(scene: Any):
    cube = inflate(bpy.data.objects["Cube"], inflate="PRESSURE", pressure=0.0, lift=9.81)
    start = shown(cube, 0)
    assert bpy.ops.balloon.preview() == {"FINISHED"}
    live(until=lambda: modifier.cache_of(cube))
    assert np.abs(shown(cube, 0) - start).max() < 0.01  # nothing acts yet
    cube.balloon_warp.pressure = 100.0
    live(until=lambda: np.ptp(shown(cube, 0), axis=0).min() > 2.05)
    assert bpy.ops.balloon.preview() == {"FINISHED"}
    assert preview.running is None
    assert np.array_equal(shown(cube, 0), start)
    assert not modifier.cache_of(cube)


def live(until: Any) -> None:
    """Follow the preview as Blender's timer does, until then."""
    end = time.monotonic() + PATIENCE
    while not until():
        assert preview.watch(), bpy.context.scene.balloon_warp.message
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_preview_of_many_vertices_is_refused(scene: Any):
    cube = bpy.data.objects["Cube"]
    subdivide(cube, 5)
    inflate(cube)
    with pytest.raises(RuntimeError, match="6146 vertices; expected 3000 at most"):
        bpy.ops.balloon.preview()


def test_a_file_and_its_bake_move_together(scene: Any, tmp_path: Path):
    scene.frame_end = 5
    cube = inflate(bpy.data.objects["Cube"])
    bake()
    before = shown(cube, 4)
    bpy.ops.wm.save_mainfile()
    (tmp_path / "elsewhere").mkdir()
    for name in ("film.blend", "balloon_warp"):
        (tmp_path / name).rename(tmp_path / "elsewhere" / name)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "elsewhere" / "film.blend"))
    assert np.array_equal(shown(bpy.data.objects["Cube"], 4), before)


def test_a_bake_of_a_file_that_was_not_saved_goes_along_when_it_is(scene: Any, tmp_path: Path):
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.context.scene.frame_end = 5
    cube = inflate(bpy.data.objects["Cube"])
    bake()
    before = shown(cube, 4)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "later.blend"))
    assert file_of(cube).is_relative_to(tmp_path)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "later.blend"))
    assert np.array_equal(shown(bpy.data.objects["Cube"], 4), before)


def test_uvs_materials_and_modifiers_below_stay(scene: Any):
    scene.frame_end = 3
    cube = bpy.data.objects["Cube"]
    cube.data.polygons[0].material_index = 0
    inflate(cube)
    below = cube.modifiers.new("Below", "SUBSURF")
    below.levels = 2
    bake()
    assert modifier.cache_of(cube)
    assert below.show_viewport
    assert len(shown(cube, 2)) == 98
    evaluated = cube.evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert evaluated.data.uv_layers
    assert evaluated.data.materials
    assert len(read_request(baking.folder_of(scene)).scene.balloon[0].mesh.points) == 8


def test_ngons_and_loose_vertices_keep_their_numbers(scene: Any):
    scene.frame_end = 4
    bpy.ops.mesh.primitive_cylinder_add(vertices=12, radius=0.5, depth=1.0, location=(0.0, 0.0, 2.0))
    drum = bpy.context.object
    drum.data.vertices.add(1)
    drum.data.vertices[-1].co = (3.0, 0.0, 0.0)
    inflate(drum)
    bake()
    moved = simulate(read_request(baking.folder_of(scene)).scene, device="cpu")
    assert np.abs(shown(drum, 3) - moved.points[0][3]).max() < NEAR


def test_what_is_hidden_takes_part_as_in_blenders_physics(scene: Any):
    scene.frame_end = 3
    inflate(bpy.data.objects["Cube"])
    names = {}
    for name, x in (("Eye", 4.0), ("Monitor", 8.0)):
        bpy.ops.mesh.primitive_cube_add(location=(x, 0.0, 0.0))
        names[name] = bpy.context.object
        names[name].name = name
        names[name].balloon_warp.role = "OBSTACLE"
    names["Eye"].hide_set(True)
    names["Monitor"].hide_viewport = True
    bake()
    assert [each.name for each in read_request(baking.folder_of(scene)).scene.obstacle] == ["Eye"]


def test_a_body_is_carried_by_its_cache(scene: Any):
    scene.use_gravity = True
    bpy.ops.mesh.primitive_cube_add(size=0.5, location=(5.0, 0.0, 3.0), rotation=(0.3, 0.2, 0.0))
    brick = bpy.context.object
    brick.balloon_warp.role = "BODY"
    inflate(bpy.data.objects["Cube"])
    scene.frame_end = 13
    bake()
    fallen = shown(brick, 0) - shown(brick, 12)
    assert fallen.mean(axis=0) == pytest.approx([0.0, 0.0, 0.5 * 9.81 * 0.25], abs=0.02)  # half a second, by steps
    assert np.ptp(fallen, axis=0).max() < 1e-4
    assert set(modifier.caches_of(scene)) == {bpy.data.objects["Cube"], brick}


def test_wind_and_a_string_from_an_empty(scene: Any):
    hook = bpy.data.objects.new("Hook", None)
    hook.location = (0.0, 0.0, -1.0)
    scene.collection.objects.link(hook)
    bpy.ops.object.effector_add(type="WIND", rotation=(0.0, math.pi / 2, 0.0))
    bpy.context.object.field.strength = 5.0
    cube = inflate(bpy.data.objects["Cube"], lift=15.0, string=hook)
    bake()
    read = read_request(baking.folder_of(scene)).scene
    assert read.atmosphere.wind == pytest.approx((5.0, 0.0, 0.0), abs=1e-5)
    assert read.string[0].anchor == (0.0, 0.0, -1.0)
    assert (shown(cube, FRAMES) - shown(cube, 0)).mean(axis=0)[0] > 0.1
    assert_simulated(scene, [cube])


MISTAKES = {
    "no balloon": (lambda cube: setattr(cube.balloon_warp, "role", "NONE"), "has no balloon"),
    "no faces": (lambda cube: cube.data.clear_geometry(), "Cube: has no faces"),
    "no scale": (lambda cube: setattr(cube, "scale", (1.0, 0.0, 1.0)), "Cube: has a scale of 0"),
    "no group": (lambda cube: setattr(cube.balloon_warp, "pinned", "Neck"), "Cube: has no vertex group Neck"),
    "gravity": (lambda cube: setattr(bpy.context.scene, "gravity", (1.0, 0.0, 0.0)), "gravity has a part along X"),
    "frames": (lambda cube: setattr(bpy.context.scene, "frame_end", 1), "frame range ends"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence_and_changes_nothing(scene: Any, mistake: str):
    cube = inflate(bpy.data.objects["Cube"])
    act, said = MISTAKES[mistake]
    act(cube)
    frame = scene.frame_current
    with pytest.raises(RuntimeError, match=said):  # what the window shows as a report
        bpy.ops.balloon.bake()
    assert said in scene.balloon_warp.message
    assert scene.balloon_warp.is_error
    assert scene.frame_current == frame
    assert not modifier.caches_of(scene)
    assert baking.running is None


def test_a_mistake_of_the_scene_names_the_object(scene: Any):
    inflate(bpy.data.objects["Cube"], inflate="PRESSURE", pressure=1e9)
    scene.frame_end = 4
    bpy.ops.balloon.bake()
    assert "Cube" in wait()
    assert scene.balloon_warp.is_error


def test_an_object_of_another_file_is_refused_as_a_balloon(scene: Any, tmp_path: Path):
    inflate(bpy.data.objects["Cube"]).name = "Linked"
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {bpy.data.objects["Linked"]})
    bpy.data.objects.remove(bpy.data.objects["Linked"])
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, taken):
        taken.objects = ["Linked"]
    scene.collection.objects.link(bpy.data.objects["Linked"])
    with pytest.raises(RuntimeError, match="Linked: is linked from another file"):
        bpy.ops.balloon.bake()


def test_an_armature_pushes_by_points(scene: Any):
    """A rod that a bone bends hits a balloon."""
    cube = bpy.data.objects["Cube"]
    subdivide(cube, 2)
    inflate(cube, lift=9.81, mass=0.05)
    bpy.ops.mesh.primitive_cylinder_add(vertices=8, radius=0.2, depth=4.0, location=(-1.6, 0.0, 0.0))
    rod = bpy.context.object
    rod.balloon_warp.role = "OBSTACLE"
    cut(rod, 4)
    bend = rod.modifiers.new("Bend", "SIMPLE_DEFORM")
    bend.deform_method, bend.deform_axis = "BEND", "Y"
    for frame, angle in ((1, 0.0), (25, -2.0)):
        bend.angle = angle
        bend.keyframe_insert("angle", frame=frame)
    start = [shown(each, 0) for each in (cube, rod)]
    bake()
    assert_simulated(scene, [cube, rod])
    assert np.abs(shown(rod, FRAMES) - start[1]).max() > 0.5
    assert (shown(cube, FRAMES) - start[0]).mean(axis=0)[0] > 0.1
    assert not modifier.find(rod)  # which Blender moves


def test_a_volume_follows_its_keyframes(scene: Any):
    cube = bpy.data.objects["Cube"]
    subdivide(cube, 2)
    inflate(cube, lift=9.81)
    for frame, volume in ((1, 1.0), (25, 2.0)):
        cube.balloon_warp.volume = volume
        cube.balloon_warp.keyframe_insert("volume", frame=frame)
    bake()
    pressures = np.array(read_request(baking.folder_of(scene)).scene.balloon[0].inflation.pressure)[:, 1]
    assert pressures[0] == 0.0
    assert (np.diff(pressures) > 0.0).all()
    assert_simulated(scene, [cube])


def test_the_panel_draws_each_role(scene: Any):
    class Drawn:
        """Layout that notes what is drawn."""

        def __init__(self) -> None:
            self.names: list[str] = []

        def __getattr__(self, kind: str) -> Any:
            def draw(*args: Any, **_: Any) -> "Drawn":
                self.names += [each for each in args if isinstance(each, str)]
                return self

            return draw

    cube = bpy.data.objects["Cube"]
    for role in ("NONE", "BALLOON", "OBSTACLE", "BODY"):
        for kind in ("VOLUME", "PRESSURE", "LITRES"):
            cube.balloon_warp.role, cube.balloon_warp.inflate = role, kind
            drawn = Drawn()
            panel.draw_object(drawn, cube)
            properties = {name for name in drawn.names if not name.startswith(("balloon.", "vertex_"))}
            assert all(hasattr(cube.balloon_warp, name) for name in properties)
            assert ("friction" in properties) == (role != "NONE")
            assert ("litres" in properties) == (role == "BALLOON" and kind == "LITRES")


def test_the_ten_steps_of_the_page(tmp_path: Path):
    """The walk installs the zip as Blender does, in a process of its own, and Blender's validator passes it."""
    environment = dict(os.environ, BLENDER_USER_RESOURCES=str(tmp_path / "user"))
    command = [sys.executable, "-m", "balloon_warp.benchmarks.blender_walk", str(tmp_path), "--small"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    start, end = (np.asarray(Image.open(tmp_path / f"blender_{name}.jpg"), float) for name in ("start", "end"))
    assert start.shape == (54, 96, 3)
    assert np.abs(start - end).max() > 50.0
    write_extension(tmp_path / "small.zip", wheels=False)
    validator = Path(bpy.utils.system_resource("SCRIPTS"), "addons_core", "bl_pkg", "cli", "blender_ext.py")
    command = [sys.executable, str(validator), "validate", str(tmp_path / "small.zip")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr

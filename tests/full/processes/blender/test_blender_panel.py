"""The panel of Blender: what its file keeps, its sentences, and the ten steps of the page."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blender_scenes import bake, bpy, cube, inflate, shown, subdivide, wait
from PIL import Image

from balloon_warp.blender import addon
from balloon_warp.blender.addon import baking, modifiers, panel, properties
from balloon_warp.blender.extension import write_extension


def test_the_add_on_goes_and_comes_back_with_what_the_file_keeps(scene: Any):
    inflate(cube(), mass=3.0)
    addon.unregister()
    assert not hasattr(cube(), "balloon_warp")
    assert "inflate" not in dir(bpy.ops.balloon)
    addon.register()
    assert cube().balloon_warp.mass == 3.0


def test_properties_outlast_saving(scene: Any, tmp_path: Path):
    inflate(cube(), material="LATEX", inflate="LITRES", litres=3.0, pinned="", burst="NEEDLE", burst_frame=7)
    cube().balloon_warp.string = bpy.data.objects.new("Hook", None)
    scene.balloon_warp.ground_height = -2.0
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "film.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "film.blend"))
    kept = cube().balloon_warp
    assert (kept.role, kept.material, kept.inflate, kept.litres) == ("BALLOON", "LATEX", "LITRES", 3.0)
    assert (kept.burst, kept.burst_frame) == ("NEEDLE", 7)
    assert kept.string == bpy.data.objects["Hook"]
    assert bpy.context.scene.balloon_warp.ground_height == -2.0
    assert modifiers.find(cube())


def of_library(tmp_path: Path, scene: Any) -> Any:
    """Return the collection of a library with the cube, linked into a new file."""
    parts = bpy.data.collections.new("Parts")
    cube().users_collection[0].objects.unlink(cube())
    parts.objects.link(cube())
    cube().name = "Linked"
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {parts})
    bpy.data.collections.remove(parts)
    bpy.data.objects.remove(bpy.data.objects["Linked"])
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, taken):
        taken.collections = ["Parts"]
    scene.collection.children.link(bpy.data.collections["Parts"])
    return bpy.data.collections["Parts"]


def test_an_override_of_a_linked_object_is_a_balloon(scene: Any, tmp_path: Path):
    """The object itself, which has the same name, is refused."""
    parts = of_library(tmp_path, scene)
    with pytest.raises(RuntimeError, match="Linked: is linked from another file; expected a library override"):
        inflate(parts.objects[0])
    parts.override_hierarchy_create(scene, bpy.context.view_layer)
    inflate(override(), mass=3.0, volume=1.5)
    scene.frame_end = 5
    bake()
    moved = shown(override(), 4)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    assert (override().balloon_warp.role, override().balloon_warp.mass) == ("BALLOON", 3.0)
    assert np.array_equal(shown(override(), 4), moved)
    assert np.abs(moved - shown(override(), 0)).max() > 1e-3


def override() -> Any:
    return next(each for each in bpy.data.objects if each.override_library)


MISTAKES = {
    "no balloon": (lambda: setattr(cube().balloon_warp, "role", "NONE"), "has no balloon"),
    "no faces": (lambda: cube().data.clear_geometry(), "Cube: has no faces"),
    "no scale": (lambda: setattr(cube(), "scale", (1.0, 0.0, 1.0)), "Cube: has a scale of 0"),
    "no scale later": (lambda: keyed(cube(), "scale", (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)), "Cube: has a scale of 0"),
    "no group": (lambda: setattr(cube().balloon_warp, "pinned", "Neck"), "Cube: has no vertex group Neck"),
    "gravity": (lambda: setattr(bpy.context.scene, "gravity", (1.0, 0.0, 0.0)), "gravity has a part along X"),
    "frames": (lambda: setattr(bpy.context.scene, "frame_end", 1), "frame range ends"),
    "levels": (lambda: cube().modifiers.move(add_levels(), 0), "Cube: its modifier Subdivision, above Balloon"),
    "no touch": (lambda: (setattr(bpy.context.scene.balloon_warp, "touch", False), bend()), "Plane: bends, and"),
    "burst": (lambda: (setattr(cube().balloon_warp, "material", "FOIL"), burst(), bend()), "Cube: may burst, and"),
    "instance": (lambda: instance(), "Bag: is an instance alone"),
    "faces come": (lambda: (bend(), keyed(add_array(), "count", 2, 3)), "Plane: has 12 vertices in a later frame"),
}


def keyed(owner: Any, name: str, first: Any, last: Any) -> None:
    for frame, value in ((1, first), (25, last)):
        setattr(owner, name, value)
        owner.keyframe_insert(name, frame=frame)


def add_levels() -> int:
    cube().modifiers.new("Subdivision", "SUBSURF").render_levels = 3
    return len(cube().modifiers) - 1


def add_array() -> Any:
    return bpy.data.objects["Plane"].modifiers.new("Array", "ARRAY")


def burst() -> None:
    cube().balloon_warp.burst = "STRESS"


def bend() -> None:
    """Add a sheet that bends."""
    bpy.ops.mesh.primitive_plane_add(location=(0.0, 0.0, -3.0))
    sheet = bpy.context.object
    sheet.balloon_warp.role = "OBSTACLE"
    sheet.shape_key_add(name="Basis")
    bent = sheet.shape_key_add(name="Bent")
    bent.data[0].co.z = 0.5
    keyed(bent, "value", 0.0, 1.0)


def instance() -> None:
    """Add an instance of a balloon that is not in the scene."""
    bags = bpy.data.collections.new("Bags")
    bag = bpy.data.objects.new("Bag", cube().data)
    bag.balloon_warp.role = "BALLOON"
    bags.objects.link(bag)
    stand = bpy.data.objects.new("Stand", None)
    stand.instance_type, stand.instance_collection = "COLLECTION", bags
    bpy.context.scene.collection.objects.link(stand)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence_and_changes_nothing(scene: Any, mistake: str):
    inflate(cube())
    act, said = MISTAKES[mistake]
    act()
    frame, shown_before = scene.frame_current, [each.show_viewport for each in cube().modifiers]
    with pytest.raises(RuntimeError, match=said):  # what the window shows as a report
        bpy.ops.balloon.bake()
    assert said in scene.balloon_warp.message
    assert scene.balloon_warp.is_error
    assert scene.frame_current == frame
    assert [each.show_viewport for each in cube().modifiers] == shown_before
    assert not modifiers.caches_of(scene)
    assert baking.running is None


def test_places_that_cannot_be_are_one_sentence(scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    inflate(cube())
    for python, said in (("/nowhere/python", "cannot be started: No such file"), (str(tmp_path), "cannot be started")):
        monkeypatch.setattr(properties, "python", lambda python=python: python)
        with pytest.raises(RuntimeError, match=f"{python}: {said}"):
            bpy.ops.balloon.bake()
    monkeypatch.setattr(properties, "python", lambda: "/bin/false")
    scene.frame_end = 3
    bpy.ops.balloon.bake()
    assert wait().startswith("The bake ended at frame 0")
    bpy.ops.balloon.delete()
    (tmp_path / "balloon_warp").touch()
    with pytest.raises(RuntimeError, match="film_Scene: cannot be written: Not a directory"):
        bpy.ops.balloon.bake()


def test_a_mistake_of_the_scene_names_the_object(scene: Any):
    inflate(cube(), inflate="PRESSURE", pressure=1e9)
    scene.frame_end = 4
    bpy.ops.balloon.bake()
    assert "Cube" in wait()
    assert scene.balloon_warp.is_error


def test_a_preview_of_many_vertices_is_refused(scene: Any):
    subdivide(cube(), 5)
    inflate(cube())
    with pytest.raises(RuntimeError, match="6146 vertices; expected 3000 at most"):
        bpy.ops.balloon.preview()


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

    settings = cube().balloon_warp
    for role in ("NONE", "BALLOON", "OBSTACLE", "BODY"):
        for kind, material in (("VOLUME", "SPRINGS"), ("PRESSURE", "LATEX"), ("LITRES", "FOIL")):
            settings.role, settings.inflate, settings.material, settings.burst = role, kind, material, "NEEDLE"
            drawn = Drawn()
            panel.draw_object(drawn, cube())
            names = {name for name in drawn.names if not name.startswith(("balloon.", "vertex_"))}
            assert all(hasattr(settings, name) for name in names)
            assert ("friction" in names) == (role != "NONE")
            assert ("litres" in names) == (role == "BALLOON" and kind == "LITRES")
            assert ("burst_frame" in names) == (role == "BALLOON" and material != "SPRINGS")


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

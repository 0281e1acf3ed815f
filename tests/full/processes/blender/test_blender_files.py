"""Files of a bake: it goes on after any stop, moves with its .blend, and is nobody else's."""

import os
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blender_scenes import PATIENCE, bake, bpy, cube, faces_shown, file_of, inflate, select, shown, subdivide, wait

from balloon_warp.blender.addon import baking, modifiers
from balloon_warp.blender.addon.request import tears_of


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a .blend with a cube that was baked for 60 frames."""
    folder = tmp_path_factory.mktemp("film")
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.context.scene.frame_end = 61
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "film.blend"))
    subdivide(cube(), 4)
    inflate(cube())
    bake()
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_mainfile()
    return folder


@pytest.fixture
def baked(film: Path, tmp_path: Path) -> Any:
    """Return the cube of a copy of that file in another folder."""
    shutil.copytree(film, tmp_path, dirs_exist_ok=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "film.blend"))
    yield cube()
    baking.stop()


def test_a_file_and_its_bake_move_together(baked: Any, film: Path, tmp_path: Path):
    assert file_of(baked).is_relative_to(tmp_path)
    moved = shown(baked, 60)
    assert np.abs(moved - shown(baked, 0)).max() > 0.1
    bpy.ops.wm.open_mainfile(filepath=str(film / "film.blend"))
    assert np.array_equal(shown(cube(), 60), moved)


def test_a_bake_goes_on_where_it_was_cancelled_or_killed(baked: Any):
    scene, frames = bpy.context.scene, file_of(baked).read_bytes()
    assert bpy.ops.balloon.bake() == {"FINISHED"}
    wait(until=lambda bake: bake.frame > 3)
    bpy.ops.balloon.cancel()
    assert wait().startswith("Cancelled at frame")
    assert not scene.balloon_warp.is_error
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)  # as after a crash of Blender, whose file knows of no Cancel
    scene = bpy.context.scene
    modifiers.rest(cube())
    assert bpy.ops.balloon.resume() == {"FINISHED"}
    wait(until=lambda bake: bake.frame > 12)
    assert baking.running
    baking.running.process.kill()
    assert wait().endswith("Continue goes on")
    assert scene.balloon_warp.is_error
    assert np.isfinite(shown(cube(), 60)).all()
    assert bpy.ops.balloon.resume() == {"FINISHED"}
    assert wait() == "Baked 60 frames"
    assert file_of(cube()).read_bytes() == frames
    assert not baking.can_continue(scene)


def test_deleting_a_bake_brings_the_object_back(baked: Any, tmp_path: Path):
    player = modifiers.find(baked)
    assert player
    player.show_viewport = False
    before = shown(baked, 60)
    player.show_viewport = True
    assert np.abs(shown(baked, 60) - before).max() > 1e-4
    assert bpy.ops.balloon.delete() == {"FINISHED"}
    assert np.array_equal(shown(baked, 60), before)
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["film.blend"]
    select(baked)
    bpy.ops.balloon.remove()
    assert [each.type for each in baked.modifiers] == ["SUBSURF"]


def test_a_file_of_another_name_leaves_the_bake_alone(baked: Any, tmp_path: Path):
    theirs = file_of(baked)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "second.blend"))
    assert file_of(cube()) == theirs  # which it plays until its own
    frames = theirs.read_bytes()
    bpy.context.scene.frame_end = 3
    bake()
    assert file_of(cube()).parent.name == "second_Scene"
    bpy.ops.balloon.delete()
    assert not modifiers.cache_of(cube())
    assert theirs.read_bytes() == frames


def test_a_duplicate_plays_the_bake_until_its_own(baked: Any):
    select(baked)
    bpy.ops.object.duplicate()
    other = bpy.context.object
    assert other.balloon_warp.role == "BALLOON"
    assert np.array_equal(shown(other, 4), shown(baked, 4))
    other.location.x += 5.0
    bpy.context.scene.frame_end = 5
    bake()
    assert len(set(modifiers.caches_of(bpy.context.scene).values())) == 2
    assert np.abs(shown(other, 4) - shown(baked, 4) - (5.0, 0.0, 0.0)).max() < 1e-3
    baked.balloon_warp.role = "NONE"
    bake()
    assert set(modifiers.caches_of(bpy.context.scene)) == {other}


def test_undo_takes_inflate_and_bake_back(scene: Any):
    scene.frame_end = 3
    bpy.ops.ed.undo_push(message="before")
    select(cube())
    bpy.ops.balloon.inflate()
    bpy.ops.ed.undo_push(message="Inflate")
    bpy.ops.balloon.bake()
    bpy.ops.ed.undo_push(message="Bake")
    bpy.ops.ed.undo()
    assert not modifiers.caches_of(bpy.context.scene)  # while the process still works
    wait()
    bpy.ops.ed.undo()
    assert cube().balloon_warp.role == "NONE"
    assert not cube().modifiers
    bpy.ops.ed.redo()
    bpy.ops.ed.redo()
    assert modifiers.caches_of(bpy.context.scene)


@pytest.mark.parametrize("copy", [False, True])
def test_a_bake_of_a_file_that_was_not_saved_goes_along_when_it_is(tmp_path: Path, copy: bool):
    """Bakes go along while they run, too, and both files play them if one is a copy."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.context.scene.frame_end = 41
    subdivide(cube(), 4)
    inflate(cube())
    assert bpy.ops.balloon.bake() == {"FINISHED"}
    wait(until=lambda bake: bake.frame > 3)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "later.blend"), copy=copy)
    assert wait() == "Baked 40 frames"
    moved = shown(cube(), 40)
    assert file_of(cube()).is_relative_to(tmp_path)
    assert np.abs(moved - shown(cube(), 0)).max() > 0.1
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "later.blend"))
    assert np.array_equal(shown(cube(), 40), moved)


def test_the_bake_ends_with_blender(baked: Any):
    assert bpy.ops.balloon.bake() == {"FINISHED"}
    wait(until=lambda bake: bake.frame > 3)
    assert baking.running
    process = baking.running.process
    assert process.stdin
    os.close(os.dup2(os.open(os.devnull, os.O_RDONLY), process.stdin.fileno()))  # the system closes a pipe so
    process.wait(PATIENCE)
    assert "stopped" in (baking.folder_of(bpy.context.scene) / "progress.jsonl").read_text()
    wait()
    assert baking.can_continue(bpy.context.scene)


def test_a_cache_of_somebody_elses_stays(scene: Any, tmp_path: Path):
    """A modifier of the same name may play it: its folder is not a bake's."""
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "cube.pc2").write_bytes(b"theirs")
    modifiers.play(cube(), theirs / "cube.pc2", 1)
    assert bpy.ops.balloon.delete() == {"FINISHED"}
    assert (theirs / "cube.pc2").read_bytes() == b"theirs"


def test_undo_keeps_tears(scene: Any):
    """Undo brings an older state back than the bake's file has, which counts."""
    inflate(cube())
    cache = baking.folder_of(scene) / "000_Cube.pc2"
    cache.parent.mkdir(parents=True)
    cache.touch()
    modifiers.play(cube(), cache, scene.frame_start)
    modifiers.add_tears(cube(), 6)
    bpy.ops.ed.undo_push(message="Bake")
    np.array([2.0, *[1e9] * 5], "<f4").tofile(tears_of(cache))
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert [faces_shown(cube(), frame) for frame in (1, 2, 3)] == [6, 5, 5]


def test_a_preview_follows_what_is_dragged(scene: Any):
    inflate(cube(), inflate="PRESSURE", pressure=0.0, lift=9.81)
    start = shown(cube(), 0)
    assert bpy.ops.balloon.preview() == {"FINISHED"}
    live(until=lambda: modifiers.cache_of(cube()))
    assert np.abs(shown(cube(), 0) - start).max() < 0.01  # nothing acts yet
    cube().balloon_warp.pressure = 100.0
    live(until=lambda: np.ptp(shown(cube(), 0), axis=0).min() > 2.05)
    thing = cube()
    thing.name = "Renamed"
    assert bpy.ops.balloon.preview() == {"FINISHED"}
    assert baking.previewing is None
    assert np.array_equal(shown(thing, 0), start)
    assert not modifiers.cache_of(thing)


def live(until: Any) -> None:
    """Follow the preview as Blender's timer does, until then."""
    end = time.monotonic() + PATIENCE
    while not until():
        assert baking.watch_preview(), bpy.context.scene.balloon_warp.message
        assert time.monotonic() < end
        time.sleep(0.02)

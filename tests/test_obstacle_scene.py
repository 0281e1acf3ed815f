"""Obstacles in scene files: that they come back as they were written, and what is said of those that are wrong."""

from pathlib import Path

import numpy as np
import pytest
from meshes import cube, grid, quad_sphere

from balloon_warp import InputError, Obstacle, Scene, load_scene, run_batch
from balloon_warp.mesh.obj import write_obj
from balloon_warp.provenance import describe_simulation, hash_of_file, without_folders
from balloon_warp.scene import Balloon
from balloon_warp.scene.overrides import override_scene
from balloon_warp.scene.write import write_scene
from balloon_warp.sweep.repeat import repeat_batch

MOTION = [(0.0, (0.0, 0.0, 0.0)), (0.5, (0.0, -1.0, 0.0), (0.0, 90.0, 0.0))]


def scene(folder: Path) -> Scene:
    """A file that names two mesh files beside it."""
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


def test_the_shape_is_that_of_the_fields(tmp_path: Path):
    tile, capsule = scene(tmp_path).obstacle
    assert (tile.shape, tile.mesh, tile.motion) == ("mesh", tmp_path / "tile.obj", MOTION)
    assert (capsule.shape, capsule.length) == ("capsule", 1.0)
    assert Obstacle().shape == "box"


def test_a_written_scene_has_the_same_obstacles(tmp_path: Path):
    before = scene(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    (written,) = write_scene(before, tmp_path / "elsewhere" / "mine.toml")
    after = load_scene(written)
    assert after.obstacle[0].mesh.resolve() == before.obstacle[0].mesh
    there = [obstacle.model_copy(update={"mesh": None}) for obstacle in after.obstacle]
    assert there == [obstacle.model_copy(update={"mesh": None}) for obstacle in before.obstacle]


def test_overrides_keep_a_mesh_that_came_from_python():
    made = Scene(balloon=[Balloon(mesh=quad_sphere(2))], obstacle=[Obstacle(mesh=grid(2, 2), position=(0, -3, 0))])
    changed = override_scene(made, {"obstacle.0.friction": 0.1, "obstacle.position": (0.0, -2.0, 0.0)}.items())
    np.testing.assert_array_equal(changed.obstacle[0].mesh.points, grid(2, 2).points)
    assert (changed.obstacle[0].friction, changed.obstacle[0].position) == (0.1, (0.0, -2.0, 0.0))


def test_what_is_said_of_a_run_and_a_batch_has_the_hashes_of_their_meshes(tmp_path: Path):
    made = scene(tmp_path)
    described = without_folders(describe_simulation(made, (), 10))
    assert described["meshes"]["obstacle.0.mesh"] == hash_of_file(tmp_path / "tile.obj")
    assert described["scene"]["obstacle"][0]["mesh"] == "tile.obj"
    short = made.model_copy(update={"frames": 1})
    run_batch(short, tmp_path / "out", 2, {"obstacle.1.friction": [0.1, 0.2]}, device="cpu", schedule="gather")
    write_obj(tmp_path / "tile.obj", grid(2, 2))
    with pytest.raises(InputError, match=r"tile\.obj: has changed since the batch"):
        repeat_batch(tmp_path / "out" / "manifest.json", tmp_path / "again")

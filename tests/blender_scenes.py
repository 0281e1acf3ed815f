"""Blender's own Python module in tests: scenes, hands that press the panel's buttons, and what Blender shows.

Importing it skips a module of tests where `bpy` is not installed.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from balloon_warp import Frame, Simulator, simulate
from balloon_warp.blender.bake import led_frames
from balloon_warp.blender.request import Request, read_request

bpy = pytest.importorskip("bpy", reason="needs Blender's module: pip install bpy, for its Python")

from balloon_warp.blender.addon import baking, modifiers  # noqa: E402 (from here on Blender is there)

FRAMES = 24
PATIENCE = 300.0
"""Longest time of a bake, with the compiling of its kernels [s]"""
PICTURE = (64, 36)
"""Width and height of renders"""
NEAR = 1e-5
"""Rounding of float32 places of some meters, there and back between axes [m]"""


def cube() -> Any:
    return bpy.data.objects["Cube"]


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


def requested() -> Request:
    """Return what was asked of the process that bakes."""
    return read_request(baking.folder_of(bpy.context.scene))


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


def faces_shown(thing: Any, frame: int) -> int:
    """Return the number of faces of an object in a frame after the start."""
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + frame)
    return len(thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons)


def assert_simulated(things: list[Any]) -> None:
    """Assert that Blender shows what `simulate` makes of the scene."""
    moved = simulate(requested().scene, device="cpu")
    for thing, points in zip(things, moved.points, strict=True):
        for frame in (0, 1, len(points) - 1):
            assert np.abs(shown(thing, frame) - points[frame]).max() < NEAR


def led() -> list[Frame]:
    """Return the frames of what was asked for, where an animation leads points, without the process that bakes."""
    request = requested()
    return list(led_frames(Simulator(request.scene, "cpu"), request))


def assert_rendered(first: int, last: int) -> None:
    """Assert that Cycles shows another picture in the last frame than in the first."""
    scene = bpy.context.scene
    render = scene.render
    render.engine, scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CYCLES", "CPU", 2, 0
    (render.resolution_x, render.resolution_y), render.image_settings.file_format = PICTURE, "PNG"
    start, end = (_picture(scene, frame) for frame in (first, last))
    assert (np.abs(start - end).max(axis=2) > 0.1).mean() > 0.01


def _picture(scene: Any, frame: int) -> np.ndarray:
    scene.frame_set(scene.frame_start + frame)
    scene.render.filepath = str(Path(bpy.data.filepath).with_suffix(f".{frame}.png"))
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.array(image.pixels[:]).reshape(scene.render.resolution_y, scene.render.resolution_x, 4)
    bpy.data.images.remove(image)
    return pixels[..., :3]


def file_of(thing: Any) -> Path:
    path = modifiers.cache_of(thing)
    assert path
    return path

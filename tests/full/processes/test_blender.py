"""Extension of Blender, in Blender's own Python module: what its panel bakes, and what becomes of it."""

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from balloon_warp import Balloon, Ground, Inflation, PolygonMesh, Scene, Stiffness, simulate
from balloon_warp.blender.request import read_request

bpy = pytest.importorskip("bpy", reason="needs Blender's module: pip install bpy, for its Python")

from balloon_warp.blender import addon  # noqa: E402 (from here on Blender is there)
from balloon_warp.blender.addon import baking, modifier, panel  # noqa: E402

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
    thing.modifiers.new("Subdivision", "SUBSURF").levels = levels


def wait(until: Any = lambda bake: False) -> str:
    """Follow the bake as Blender's timer does, to its end or until then; return what the panel says."""
    end = time.monotonic() + PATIENCE
    while (bake := baking.running) and baking.watch() is not None and not until(bake):
        assert time.monotonic() < end
        time.sleep(0.02)
    return bpy.context.scene.balloon_warp.message


def bake() -> None:
    assert bpy.ops.balloon.bake() == {"FINISHED"}
    assert wait() == f"Baked {FRAMES} frames"


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
    scene_read = read_request(baking.folder_of(scene)).scene
    (motion,) = [each.motion for each in scene_read.obstacle]
    shown(plank, 12)
    place = plank.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world
    assert np.allclose(np.array(scene_read.obstacle[0].position) + motion[12][1], place.translation, atol=1e-6)
    assert motion[12][2] == pytest.approx([0.0, 0.0, math.degrees(place.to_euler().z)], abs=1e-3)

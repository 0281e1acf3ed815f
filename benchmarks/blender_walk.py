"""The ten steps of BLENDER.md, from install to render, by Blender's Python module in place of hands.

`python -m balloon_warp.benchmarks.blender_walk docs/pictures` makes the page's pictures. It installs the extension for
the user that runs it, as a person does; BLENDER_USER_RESOURCES names another folder for that.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from balloon_warp.blender.extension import write_extension
from balloon_warp.errors import MissingExtraError

MODULE = "bl_ext.user_default.balloon_warp"
FRAMES = 36
SIZE = (480, 270)
SAMPLES = 24


def walk(folder: Path, frames: int = FRAMES, size: tuple[int, int] = SIZE, samples: int = SAMPLES) -> list[Path]:
    """Go through the steps on the page, and their results, and return the pictures.

    Raises:
        MissingExtraError: Blender's module is not installed.
    """
    try:
        import bpy
    except ModuleNotFoundError:
        raise MissingExtraError("the walk needs bpy, Blender as a Python module: pip install bpy") from None
    with TemporaryDirectory() as scratch:
        bpy.ops.wm.read_homefile(use_factory_startup=True)
        _install(bpy, write_extension(Path(scratch) / "balloon_warp.zip", wheels=False))
        camera = Camera(bpy, folder, size, samples)
        _model(bpy, Path(scratch), frames)
        _bake(bpy)
        _render(bpy, camera)
        _push(bpy, camera, frames)
        _burst(bpy, camera)
        bpy.ops.preferences.addon_disable(module=MODULE)
    return camera.taken


class Camera:
    """Blender's camera and light, which take pictures.

    Args:
        bpy: Blender's module.
        folder: of the pictures.
        size: Width and height in pixels.
        samples: Rays per pixel.
    """

    def __init__(self, bpy: Any, folder: Path, size: tuple[int, int], samples: int):
        self._bpy, self._folder, self._size, self._samples = bpy, folder, size, samples
        self.taken: list[Path] = []

    def take(self, name: str, frame: int, at: Sequence[float], to: Sequence[float]) -> None:
        """Take a picture of a frame from one place to another."""
        from mathutils import Vector  # Blender's

        scene = self._bpy.context.scene
        sun = self._bpy.data.objects["Light"].data
        sun.type = "SUN"
        sun = self._bpy.data.objects["Light"].data  # of that type
        sun.energy, sun.angle = 2.6, 0.4
        sky = scene.world.node_tree.nodes["Background"]
        sky.inputs["Color"].default_value, sky.inputs["Strength"].default_value = (0.8, 0.8, 0.82, 1.0), 0.4
        scene.view_settings.view_transform = "Khronos PBR Neutral"
        camera = self._bpy.data.objects["Camera"]
        camera.location = at
        camera.rotation_euler = (Vector(to) - camera.location).to_track_quat("-Z", "Y").to_euler()
        scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", self._samples
        scene.render.resolution_x, scene.render.resolution_y = self._size
        scene.render.image_settings.file_format = "JPEG"
        scene.frame_set(frame)
        scene.render.filepath = str(self._folder / f"blender_{name}.jpg")
        self._bpy.ops.render.render(write_still=True)
        self.taken.append(Path(scene.render.filepath))


def _install(bpy: Any, path: Path) -> None:
    """Install the zip, and name the Python that bakes, since this zip has no wheels: steps 1 and 2."""
    bpy.ops.extensions.package_install_files(filepath=str(path), repo="user_default", enable_on_install=True)
    bpy.context.preferences.addons[MODULE].preferences.python = sys.executable


def _model(bpy: Any, folder: Path, frames: int) -> None:
    """Make a mesh, press Inflate, key its pressure, and bring a plate that presses on it: steps 3 to 7."""
    scene = bpy.context.scene
    scene.frame_end = frames + 1
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "film.blend"))
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    bpy.ops.mesh.primitive_monkey_add(location=(0.0, 0.0, 1.1), rotation=(-0.3, 0.0, 0.5))
    suzanne = bpy.context.object
    bpy.ops.balloon.inflate()
    balloon = suzanne.balloon_warp
    balloon.inflate, balloon.lift, balloon.mass = "PRESSURE", 9.0, 0.3
    for frame, pressure in ((1, 0.0), (frames // 2, 120.0), (frames + 1, 120.0)):
        balloon.pressure = pressure
        balloon.keyframe_insert("pressure", frame=frame)
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(-2.6, 0.0, 1.2), scale=(0.2, 3.0, 2.4))
    plate = bpy.context.object
    plate.balloon_warp.role = "OBSTACLE"
    for frame, x in ((1, -2.6), (frames + 1, -0.7)):
        plate.location.x = x
        plate.keyframe_insert("location", frame=frame)
    scene.balloon_warp.ground = True
    bpy.ops.mesh.primitive_plane_add(size=400.0)


def _bake(bpy: Any) -> None:
    """Bake, and refine the result: steps 8 and 9."""
    wait_for_bake(bpy)
    suzanne = bpy.data.objects["Suzanne"]
    suzanne.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    paint(bpy, suzanne, (0.75, 0.02, 0.04, 1.0))


def wait_for_bake(bpy: Any) -> None:
    """Press Bake, and follow it to its end."""
    from bl_ext.user_default.balloon_warp import baking  # as Blender installed it

    bpy.ops.balloon.bake()
    while baking.watch() is not None:  # in a window Blender's timer does this
        time.sleep(0.1)
    said = bpy.context.scene.balloon_warp
    if said.is_error:
        raise RuntimeError(said.message)


def paint(bpy: Any, thing: Any, color: tuple[float, float, float, float]) -> None:
    """Give a thing a smooth, glossy skin of a color."""
    for polygon in thing.data.polygons:
        polygon.use_smooth = True
    skin = bpy.data.materials.new("Skin")
    shader = skin.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value, shader.inputs["Roughness"].default_value = color, 0.2
    thing.data.materials.append(skin)


def _render(bpy: Any, camera: Camera) -> None:
    """Render the first frame and the last: step 10."""
    scene = bpy.context.scene
    for name, frame in (("start", scene.frame_start), ("end", scene.frame_end)):
        camera.take(name, frame, at=(6.4, -7.2, 5.2), to=(0.7, 0.0, 0.9))


def _push(bpy: Any, camera: Camera, frames: int) -> None:
    """Let a finger, which two bones bend, push a balloon."""
    scene = _begin(bpy, frames)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=16, radius=0.8, location=(0.9, 0.0, 1.2))
    ball = bpy.context.object
    bpy.ops.balloon.inflate()
    ball.balloon_warp.volume, ball.balloon_warp.lift, ball.balloon_warp.mass = 1.3, 9.81, 0.02
    paint(bpy, ball, (0.02, 0.2, 0.75, 1.0))
    bpy.ops.mesh.primitive_cylinder_add(vertices=16, radius=0.25, depth=3.0, location=(-0.8, 0.0, 1.5))
    finger = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide(number_cuts=7)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.object.shade_auto_smooth()
    finger.balloon_warp.role = "OBSTACLE"
    paint(bpy, finger, (0.8, 0.5, 0.3, 1.0))
    bpy.ops.object.armature_add(location=(-0.8, 0.0, 0.0))
    bones = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    bones.data.edit_bones[0].tail = (0.0, 0.0, 1.0)
    tip = bones.data.edit_bones.new("Tip")
    tip.head, tip.tail, tip.parent = (0.0, 0.0, 1.0), (0.0, 0.0, 3.0), bones.data.edit_bones[0]
    bpy.ops.object.mode_set(mode="OBJECT")
    finger.select_set(True)
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    pose = bones.pose.bones["Tip"]
    pose.rotation_mode = "XYZ"
    for frame, angle in ((1, 0.0), (frames + 1, -1.2)):
        pose.rotation_euler.z = angle
        pose.keyframe_insert("rotation_euler", frame=frame)
    wait_for_bake(bpy)
    camera.take("push", scene.frame_end, at=(4.4, -6.3, 4.6), to=(0.4, 0.0, 1.0))


def _burst(bpy: Any, camera: Camera) -> None:
    """Pierce a balloon of latex, at 200 frames a second."""
    scene, needle = _begin(bpy, 50), 47
    scene.render.fps = 200
    bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=16, radius=0.1, location=(0.0, 0.0, 0.5))
    ball = bpy.context.object
    bpy.ops.balloon.inflate()
    balloon = ball.balloon_warp
    balloon.material, balloon.inflate, balloon.litres, balloon.fill_time = "LATEX", "LITRES", 40.0, 0.2
    balloon.filling, balloon.burst, balloon.burst_frame = "AIR", "NEEDLE", needle
    paint(bpy, ball, (0.75, 0.3, 0.02, 1.0))
    wait_for_bake(bpy)
    camera.take("burst", needle + 3, at=(0.9, -1.3, 0.84), to=(0.0, 0.0, 0.49))


def _begin(bpy: Any, frames: int) -> Any:
    """Begin a scene of frames on a floor, beside whose file it bakes."""
    path = bpy.data.filepath
    bpy.ops.wm.read_homefile(use_factory_startup=True, load_ui=False)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    bpy.ops.mesh.primitive_plane_add(size=400.0)
    scene = bpy.context.scene
    scene.frame_end = frames + 1
    return scene


def main() -> None:
    """Make the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--small", action="store_true", help="a few frames, and small pictures")
    asked = parser.parse_args()
    folder = asked.folder.resolve()
    for picture in walk(folder, 4, (96, 54), 2) if asked.small else walk(folder):
        print(f"wrote {picture}")


if __name__ == "__main__":
    main()

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
SAMPLES = 64
QUALITY = 90
"""of the JPEG files"""
OAK = (0.36, 0.17, 0.06)
LENS = 60.0
"""Focal length [mm]"""


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


KEY, RIM = (-0.62, 0.62, 1.0), (0.95, -0.15, 0.28)
"""Directions to the lamps: to the right, toward the camera, and up; as in our own pictures"""
KEY_DISTANCE, KEY_WIDTH, RIM_DISTANCE = 4.0, 1.7, 5.0
"""in sizes of the subject"""


class Camera:
    """Blender's camera, and the lights of our own studio around its target.

    Args:
        bpy: Blender's module.
        folder: of the pictures.
        size: Width and height in pixels.
        samples: Rays per pixel.
    """

    def __init__(self, bpy: Any, folder: Path, size: tuple[int, int], samples: int):
        self._bpy, self._folder, self._size, self._samples = bpy, folder, size, samples
        self.taken: list[Path] = []

    def set_up(self, at: Sequence[float], to: Sequence[float], size: float) -> None:
        """Look from one place to another, at a subject of a size, and dress the scene as a stage of ours."""
        from bl_ext.user_default.balloon_warp.studio_look import dress  # as Blender installed it
        from mathutils import Vector  # Blender's

        bpy, middle = self._bpy, Vector(to)
        bpy.data.objects.remove(bpy.data.objects["Light"])
        camera = bpy.data.objects["Camera"]
        camera.location = at
        camera.rotation_euler = (middle - camera.location).to_track_quat("-Z", "Y").to_euler()
        camera.data.lens = LENS
        back = (camera.location - middle) * Vector((1.0, 1.0, 0.0))
        back.normalize()
        right, up = Vector((-back.y, back.x, 0.0)), Vector((0.0, 0.0, 1.0))
        for name, (across, toward, above), distance in (("Key", KEY, KEY_DISTANCE), ("Rim", RIM, RIM_DISTANCE)):
            direction = (across * right + toward * back + above * up).normalized()
            bpy.ops.object.light_add(type="AREA", location=middle + distance * size * direction)
            lamp = bpy.context.object
            lamp.name, lamp.data.size = name, KEY_WIDTH * size
            lamp.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
        bpy.context.view_layer.update()
        dress(bpy.context.scene)

    def take(self, name: str, frame: int) -> None:
        """Take a picture of a frame."""
        scene = self._bpy.context.scene
        scene.cycles.device, scene.cycles.samples = "CPU", self._samples
        scene.render.resolution_x, scene.render.resolution_y = self._size
        scene.render.image_settings.file_format, scene.render.image_settings.quality = "JPEG", QUALITY
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
    shape = suzanne.modifiers.new("Shape", "SUBSURF")
    shape.levels = shape.render_levels = 1
    bpy.ops.balloon.inflate()
    balloon = suzanne.balloon_warp
    balloon.inflate, balloon.lift, balloon.mass = "PRESSURE", 9.0, 0.3
    for frame, pressure in ((1, 0.0), (frames // 2, 120.0), (frames + 1, 120.0)):
        balloon.pressure = pressure
        balloon.keyframe_insert("pressure", frame=frame)
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(-2.6, 0.0, 1.2), scale=(0.2, 2.2, 2.4))
    plate = bpy.context.object
    plate.balloon_warp.role = "OBSTACLE"
    paint(bpy, plate, OAK)
    for frame, x in ((1, -2.6), (frames + 1, -0.7)):
        plate.location.x = x
        plate.keyframe_insert("location", frame=frame)
    scene.balloon_warp.ground = True
    _add_floor(bpy, (0.72, 0.70, 0.66))


def _bake(bpy: Any) -> None:
    """Bake, and refine the result: steps 8 and 9."""
    wait_for_bake(bpy)
    paint_latex(bpy, bpy.data.objects["Suzanne"], (0.75, 0.02, 0.04))


def wait_for_bake(bpy: Any) -> None:
    """Press Bake, and follow it to its end."""
    from bl_ext.user_default.balloon_warp import baking  # as Blender installed it

    bpy.ops.balloon.bake()
    while baking.watch() is not None:  # in a window Blender's timer does this
        time.sleep(0.1)
    said = bpy.context.scene.balloon_warp
    if said.is_error:
        raise RuntimeError(said.message)


def paint(bpy: Any, thing: Any, color: Sequence[float]) -> Any:
    """Give a thing a matte skin of a color, and return its shader."""
    skin = bpy.data.materials.new("Skin")
    shader = skin.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value, shader.inputs["Roughness"].default_value = (*color, 1.0), 0.7
    thing.data.materials.append(skin)
    return shader


def paint_latex(bpy: Any, thing: Any, color: Sequence[float]) -> None:
    """Give a thing a skin as our stages have it for latex, refined."""
    thing.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    for polygon in thing.data.polygons:
        polygon.use_smooth = True
    shader = paint(bpy, thing, color)
    shader.inputs["Alpha"].default_value, shader.inputs["Coat Weight"].default_value = 0.92, 1.0


def _add_floor(bpy: Any, color: Sequence[float]) -> None:
    """Lay paper on the ground."""
    bpy.ops.mesh.primitive_plane_add(size=400.0)
    bpy.context.object.name = "Ground"
    paint(bpy, bpy.context.object, color)


def _render(bpy: Any, camera: Camera) -> None:
    """Render the first frame and the last: step 10."""
    scene = bpy.context.scene
    camera.set_up(at=(3.0, -12.0, 4.3), to=(0.15, 0.0, 1.1), size=2.6)
    for name, frame in (("start", scene.frame_start), ("end", scene.frame_end)):
        camera.take(name, frame)


def _push(bpy: Any, camera: Camera, frames: int) -> None:
    """Let a finger, which two bones bend, push a balloon."""
    scene = _begin(bpy, frames, (0.62, 0.40, 0.10))
    scene.balloon_warp.ground = True
    bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=16, radius=0.8, location=(0.7, 0.0, 0.9))
    ball = bpy.context.object
    bpy.ops.balloon.inflate()
    ball.balloon_warp.volume, ball.balloon_warp.lift, ball.balloon_warp.mass = 1.3, 9.81, 0.3
    paint_latex(bpy, ball, (0.02, 0.2, 0.75))
    bpy.ops.mesh.primitive_cylinder_add(vertices=48, radius=0.25, depth=3.0, location=(-0.8, 0.0, 1.5))
    finger = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide(number_cuts=7)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.object.shade_auto_smooth()
    finger.balloon_warp.role = "OBSTACLE"
    paint(bpy, finger, OAK)
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
    camera.set_up(at=(3.0, -7.6, 3.2), to=(0.5, 0.0, 1.0), size=2.6)
    camera.take("push", scene.frame_end)


def _burst(bpy: Any, camera: Camera) -> None:
    """Pierce a balloon of latex, at 200 frames a second."""
    scene, needle = _begin(bpy, 50, (0.06, 0.10, 0.12)), 47
    scene.render.fps = 200
    bpy.ops.mesh.primitive_uv_sphere_add(
        segments=32, ring_count=16, radius=0.1, location=(0.0, 0.0, 0.6), rotation=(-1.1, 0.0, 0.4)
    )
    ball = bpy.context.object
    for vertex in ball.data.vertices:  # narrow at one end, and bent: it stretches most beside that
        below = max(-vertex.co.z / 0.1, 0.0)
        narrow = 1.0 - 0.45 * below**2
        vertex.co = vertex.co.x * narrow, vertex.co.y * narrow + 0.04 * below**2, vertex.co.z * (1.0 + 0.35 * below)
    bpy.ops.balloon.inflate()
    balloon = ball.balloon_warp
    balloon.material, balloon.inflate, balloon.litres, balloon.fill_time = "LATEX", "LITRES", 40.0, 0.2
    balloon.filling, balloon.burst, balloon.burst_frame = "AIR", "NEEDLE", needle
    paint_latex(bpy, ball, (0.75, 0.3, 0.02))
    wait_for_bake(bpy)
    camera.set_up(at=(-0.1, -1.5, 0.7), to=(0.0, 0.0, 0.48), size=0.44)
    camera.take("burst", needle + 1)


def _begin(bpy: Any, frames: int, paper: Sequence[float]) -> Any:
    """Begin a scene of frames on a floor of a color, beside whose file it bakes."""
    path = bpy.data.filepath
    bpy.ops.wm.read_homefile(use_factory_startup=True, load_ui=False)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    _add_floor(bpy, paper)
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

"""The ten steps of BLENDER.md, from install to render, by Blender's Python module in place of hands.

`python -m balloon_warp.benchmarks.blender_walk docs/pictures` makes the page's pictures. It installs the extension for
the user that runs it, as a person does; BLENDER_USER_RESOURCES names another folder for that.
"""

import argparse
import sys
import time
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
    """Go through the steps, and return the pictures of the first frame and the last.

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
        _model(bpy, Path(scratch), frames)
        _bake(bpy)
        pictures = _render(bpy, folder, size, samples)
        bpy.ops.preferences.addon_disable(module=MODULE)
    return pictures


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
    bpy.ops.mesh.primitive_plane_add(size=40.0)


def _bake(bpy: Any) -> None:
    """Bake, and refine the result: steps 8 and 9."""
    from bl_ext.user_default.balloon_warp import baking  # as Blender installed it

    bpy.ops.balloon.bake()
    while baking.watch() is not None:  # in a window Blender's timer does this
        time.sleep(0.1)
    said = bpy.context.scene.balloon_warp
    if said.is_error:
        raise RuntimeError(said.message)
    suzanne = bpy.data.objects["Suzanne"]
    suzanne.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    for polygon in suzanne.data.polygons:
        polygon.use_smooth = True
    latex = bpy.data.materials.new("Latex")
    skin = latex.node_tree.nodes["Principled BSDF"]
    skin.inputs["Base Color"].default_value = (0.75, 0.02, 0.04, 1.0)
    skin.inputs["Roughness"].default_value = 0.2
    suzanne.data.materials.append(latex)


def _render(bpy: Any, folder: Path, size: tuple[int, int], samples: int) -> list[Path]:
    """Render: step 10."""
    scene = bpy.context.scene
    bpy.data.objects["Light"].data.type = "SUN"
    sun = bpy.data.objects["Light"].data
    sun.energy, sun.angle = 4.0, 0.2
    camera = bpy.data.objects["Camera"]
    camera.location = (6.2, -7.0, 3.0)
    way = bpy.data.objects["Suzanne"].location - camera.location
    way.x += 0.8  # where the plate pushes it
    camera.rotation_euler = way.to_track_quat("-Z", "Y").to_euler()
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", samples
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.image_settings.file_format = "JPEG"
    pictures = [folder / "blender_start.jpg", folder / "blender_end.jpg"]
    for frame, picture in zip((scene.frame_start, scene.frame_end), pictures, strict=True):
        scene.frame_set(frame)
        scene.render.filepath = str(picture)
        bpy.ops.render.render(write_still=True)
    return pictures


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

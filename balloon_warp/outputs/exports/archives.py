"""A stage as an Alembic archive, or as one .usdz package."""

import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from pxr import Usd, UsdUtils

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.files import folder_beside, whole_file
from balloon_warp.mesh.check import Pictures
from balloon_warp.mesh.usd_looks import content_of
from balloon_warp.mesh.usd_open import open_stage
from balloon_warp.outputs.exports.parts import Animation
from balloon_warp.outputs.render.timing import timing_of

SCRIPT = """
import sys
import bpy

stage, archive, first, last, rate = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=stage)
bpy.context.scene.render.fps = max(round(float(rate)), 1)
bpy.context.scene.render.fps_base = bpy.context.scene.render.fps / float(rate)
bpy.ops.wm.alembic_export(filepath=archive, start=int(first), end=int(last), as_background_job=False)
"""
"""Script for a process of its own: Blender brings a USD of its own, which conflicts with another"""


def require_blender() -> None:
    """Make sure that Blender's module is there.

    Raises:
        MissingExtraError: it is not.
    """
    if find_spec("bpy") is None:
        raise MissingExtraError(
            "an .abc needs Blender's Python module: pip install bpy; or write .usdc, and export Alembic from Blender"
        )


def write_alembic(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the archive; arguments as `export_stage` has them.

    Raises:
        MissingExtraError: Blender's module is not installed.
        InputError: Blender failed.
    """
    require_blender()
    frames, rate = animation.frames, animation.frames_per_second
    with whole_file(output) as temporary:
        words = [animation.path, temporary, frames[0], frames[-1], rate]
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, *map(str, words)], capture_output=True, text=True, check=False
        )
        if done.returncode or not temporary.is_file():
            reason = (done.stderr.strip() or done.stdout.strip() or f"exit status {done.returncode}").splitlines()[-1]
            raise InputError(f"{output}: Blender could not write it: {reason}")
    on_frame(1, 1)


def write_usdz(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the package; arguments as `export_stage` has them."""
    with folder_beside(output) as folder, whole_file(output) as temporary:
        flat = folder / f"{output.stem}.usdc"  # a package begins with a binary layer, under this name
        _as_it_is(animation).Export(str(flat), addSourceFileComment=False)  # which names our folder
        if not UsdUtils.CreateNewUsdzPackage(str(flat), str(temporary)):
            raise InputError(f"{output}: USD could not make a package of {animation.path}; is the disk full?")
    on_frame(1, 1)


def write_stage(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the stage in one file of another kind of USD, with its images beside it."""
    flat, pictures = _as_it_is(animation).Flatten(addSourceFileComment=False), Pictures(animation.path)

    def beside(path: str) -> str:
        data = content_of(path)
        picture = pictures.of_bytes(path, data) if data else None
        if picture is None:
            return path
        picture.write_beside(output)
        return picture.path

    UsdUtils.ModifyAssetPaths(flat, beside)
    with whole_file(output) as temporary:
        flat.Export(str(temporary))
    on_frame(1, 1)


def _as_it_is(animation: Animation) -> Usd.Stage:
    """Return the stage with its shapes and instances as they are, where others of its kind read them."""
    return timing_of(open_stage(animation.path), animation.path).stage

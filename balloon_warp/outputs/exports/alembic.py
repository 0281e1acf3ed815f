"""A stage as an Alembic archive: Blender writes it, where its Python module is installed."""

import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.files import whole_file
from balloon_warp.outputs.exports.parts import Animation

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

"""Our pictures of bundled scenes beside Blender's of the same stages.

`python -m balloon_warp.benchmarks.blender_pictures docs/pictures` writes those of ANIMATORS.md, in some minutes.

Blender's Python module, bpy, may be in an environment of its own, whose Python `BALLOON_WARP_BLENDER` names.
"""

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from balloon_warp import animate, load_scene, render_stage
from balloon_warp.blender.extension import STUDIO_LOOK
from balloon_warp.errors import MissingExtraError
from balloon_warp.studio.render.stage_reader import RenderStage

SCENES = ("squirrel_inflate", "foil_letters", "balloon_bunch", "latex_inflate")
SIZE = (480, 270)
SAMPLES = 64
QUALITY = 88
"""of the JPEG files"""
SCRIPT = """
import runpy
import sys
import bpy

look, stage, picture, frame, width, height, samples = sys.argv[1:]
scene = runpy.run_path(look)["import_stage"](stage)
scene.cycles.device, scene.cycles.samples = "CPU", int(samples)
scene.render.resolution_x, scene.render.resolution_y = int(width), int(height)
scene.render.resolution_percentage = 100
scene.render.image_settings.file_format, scene.render.filepath = "PNG", picture
scene.frame_set(int(frame))
bpy.ops.render.render(write_still=True)
"""
"""the steps of ANIMATORS.md; in a process of its own, since Blender brings a USD of its own"""


def blender_python() -> str | None:
    """Return the path of a Python that has Blender's module, or None."""
    python = os.environ.get("BALLOON_WARP_BLENDER", sys.executable)
    look = [python, "-c", "import importlib.util as u, sys; sys.exit(u.find_spec('bpy') is None)"]
    return None if subprocess.run(look, capture_output=True, check=False).returncode else python


def require_blender() -> str:
    """Return the Python that has Blender's module.

    Raises:
        MissingExtraError: none has it.
    """
    python = blender_python()
    if python is None:
        raise MissingExtraError(
            "no Blender: expected bpy to be installed, or BALLOON_WARP_BLENDER to name a Python that has it"
        )
    return python


def render_in_blender(
    stage: Path, picture: Path, frame: int, size: tuple[int, int] = SIZE, samples: int = SAMPLES
) -> None:
    """Make a picture of a stage in the studio look, by its own camera, in Cycles on the CPU.

    Raises:
        MissingExtraError: Blender is not there.
        RuntimeError: it failed.
    """
    python = require_blender()
    words = [STUDIO_LOOK, stage.resolve(), picture.resolve(), frame, *size, samples]
    done = subprocess.run([python, "-c", SCRIPT, *map(str, words)], capture_output=True, text=True, check=False)
    if done.returncode or not picture.is_file():
        raise RuntimeError(f"Blender could not render {stage}: {done.stderr.strip() or done.stdout.strip()}")


def beside(ours: Path, blenders: Path) -> Image.Image:
    """Return two pictures side by side."""
    pair = [np.asarray(Image.open(picture).convert("RGB")) for picture in (ours, blenders)]
    return Image.fromarray(np.concatenate(pair, axis=1))


def main(folder: Path, names: list[str]) -> None:
    """Simulate scenes, and write the pair of pictures of each.

    Raises:
        MissingExtraError: Blender is not there.
    """
    require_blender()
    with TemporaryDirectory() as work:
        for name in names:
            stage, ours, blenders = (Path(work) / f"{name}{end}" for end in (".usdc", "_ours.png", "_blender.png"))
            animate(load_scene(name), stage)
            render_stage(stage, ours, size=SIZE, samples=16)
            render_in_blender(stage, blenders, RenderStage(stage).picture_frame)
            pair = folder / f"pair_{name}.jpg"
            beside(ours, blenders).save(pair, quality=QUALITY)
            print(f"wrote {pair}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures"), sys.argv[2:] or list(SCENES))

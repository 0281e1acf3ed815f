"""Small batch that can be stopped."""

from collections.abc import Callable
from pathlib import Path

import pytest
from batches import OFTEN
from meshes import quad_sphere

from balloon_warp import Scene, run_batch
from balloon_warp.scene import Balloon, Ground, Inflation, Sphere, String

FRAMES, WORLDS = 6, 5


def scene(**fields) -> Scene:
    """Return a small scene with one of each kind of thing."""
    fields = {
        "balloon": [Balloon(mesh=quad_sphere(3), position=(0, 2, 0), helium=20.0, inflation=Inflation(k_normal=0.2))],
        "sphere": [Sphere(position=(0, 4, 0), radius=0.3, start=0.03)],
        "string": [String(anchor=(0, 0, 0), length=1.5)],
        "ground": Ground(),
        "frames": FRAMES,
        "substeps": 40,
        "faces": False,
    } | fields
    return Scene(**fields)


def stop_after(last: int) -> Callable[[int], None]:
    """Return a callback that kills a batch once that frame is simulated, before any of it is saved."""

    def stop(frame: int) -> None:
        if frame == last:
            raise RuntimeError("stopped")

    return stop


def stop_batch(folder: Path) -> Path:
    """Return a folder with a batch that was stopped after frame 3, and saved after frame 2."""
    often = {"checkpoint_seconds": OFTEN, "on_frame": stop_after(3)}
    with pytest.raises(RuntimeError):
        run_batch(scene(), folder, 2, {"gravity": [1, 9]}, device="cpu", **often)
    return folder

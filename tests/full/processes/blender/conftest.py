"""Blender with the add-on, and new files."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(scope="module", autouse=True)
def registered() -> Iterator[None]:
    """Register the add-on; a module of tests that gets here has found Blender."""
    from blender_scenes import bpy

    from balloon_warp.blender import addon

    bpy.ops.wm.read_factory_settings()
    addon.register()
    yield
    addon.unregister()


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Any]:
    """Return the scene of a new file beside which it bakes: Blender's own, with a cube."""
    from blender_scenes import FRAMES, bpy

    from balloon_warp.blender.addon import baking

    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.context.scene.frame_end = 1 + FRAMES
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "film.blend"))
    yield bpy.context.scene
    baking.stop()

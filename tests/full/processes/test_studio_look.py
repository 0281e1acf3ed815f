"""The studio look, in Blender's own Python module: what it makes of an imported stage."""

import subprocess
import sys
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy", reason="needs Blender's module: pip install bpy, for its Python")

from balloon_warp.blender import addon  # noqa: E402 (from here on Blender is there)


def test_it_dresses_an_imported_stage_once(tmp_path: Path):
    """Latex is a wall that passes light, the sun is the key, and mirrors alone see softboxes."""
    stage = tmp_path / "balls.usdc"
    words = ["run", "latex_inflate", "--frames", "3", "--device", "cpu", "-o", str(stage)]
    subprocess.run([sys.executable, "-m", "balloon_warp", *words], check=True, capture_output=True)
    bpy.ops.wm.read_factory_settings()
    addon.register()
    assert not bpy.ops.balloon.dress.poll()
    bpy.data.batch_remove(bpy.data.objects)
    bpy.ops.wm.usd_import(filepath=str(stage))
    assert bpy.ops.balloon.dress() == {"FINISHED"}
    assert not bpy.ops.balloon.dress.poll()
    addon.unregister()
    scene = bpy.context.scene
    shaders = {node.type for node in bpy.data.materials["small"].node_tree.nodes}
    assert {"BSDF_TRANSPARENT", "BSDF_TRANSLUCENT", "BSDF_GLOSSY"} <= shaders
    assert scene.objects["Key"].data.type == "SUN"
    cards = [scene.objects[f"{name} Card"] for name in ("Key", "Rim")]
    assert all(each.visible_glossy and not each.visible_camera and not each.visible_diffuse for each in cards)
    assert scene.objects["Backdrop"].hide_render
    assert scene.camera.name == "Camera"
    assert scene.view_settings.view_transform == "Khronos PBR Neutral"
    small = scene.objects["small"]
    assert [modifier.type for modifier in small.modifiers] == ["MESH_SEQUENCE_CACHE", "NODES", "SUBSURF"]
    thinned = small.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.attributes["thinned"]
    assert all(0.3 < value.value < 1.5 for value in thinned.data)

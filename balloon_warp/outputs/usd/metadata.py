"""Metadata of every stage of ours."""

import json
from collections.abc import Mapping
from typing import Any

from pxr import Gf, Usd, UsdGeom

from balloon_warp.marks import STAGE_KEY
from balloon_warp.scene import Scene


def describe_stage(
    stage: Usd.Stage, scene: Scene, provenance: Mapping[str, Any] | None = None, view: bool = False
) -> None:
    """Write the default prim /World, up axis, units and time, and `customLayerData`.

    The latter has, as `balloonWarp`, by which the stage is known as ours, the frame of a picture, its camera if `view`
    is wanted, and the stage's provenance: words, numbers and tables of them, and the scene, as JSON.
    """
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    UsdGeom.SetStageUpAxis(stage, scene.up_axis)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(scene.frames_per_second)
    stage.SetFramesPerSecond(scene.frames_per_second)
    stage.SetStartTimeCode(0)
    layer = stage.GetRootLayer()
    layer.comment = scene.description
    said = dict(provenance or {})
    if "scene" in said:
        said["scene"] = json.dumps(said["scene"])
    if scene.picture_frame is not None:
        said["pictureFrame"] = min(scene.picture_frame, scene.frames)
    if scene.picture is not None and view:
        place = scene.picture.model_dump(exclude_none=True)
        said["pictureView"] = {name: Gf.Vec3d(*n) if isinstance(n, tuple) else n for name, n in place.items()}
    layer.customLayerData = {STAGE_KEY: said}

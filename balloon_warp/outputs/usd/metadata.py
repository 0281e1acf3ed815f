"""What every stage of ours says of itself, and how its prims are called."""

import itertools
from collections.abc import Collection, Iterable

from pxr import Tf, Usd, UsdGeom

from balloon_warp.scene import Scene

RESERVED = ("Ground", "Floor", "Water", "Pool", "Looks", "Spheres", "Strings", "NetForces", "Prototypes")
"""what no balloon is called"""


def describe_stage(stage: Usd.Stage, scene: Scene) -> None:
    """The default prim /World, up axis, units and time."""
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    UsdGeom.SetStageUpAxis(stage, scene.up_axis)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(scene.frames_per_second)
    stage.SetFramesPerSecond(scene.frames_per_second)
    stage.SetStartTimeCode(0)
    layer = stage.GetRootLayer()
    layer.comment = scene.description
    if scene.picture_frame is not None:
        layer.customLayerData = {"balloonWarp": {"pictureFrame": min(scene.picture_frame, scene.frames)}}


def prim_names(names: Iterable[str], taken: Collection[str] = ()) -> list[str]:
    """A valid prim name for each balloon's name, all different, and none of those that are taken."""
    chosen: list[str] = []
    for name in map(Tf.MakeValidIdentifier, names):
        numbered = (f"{name}_{number}" for number in itertools.count(1))
        chosen.append(
            next(free for free in itertools.chain([name], numbered) if free not in (*RESERVED, *taken, *chosen))
        )
    return chosen

"""What appears and ends in the stage."""

from pxr import UsdGeom

from balloon_warp.scene import Scene, Sphere, String
from balloon_warp.scene.timeline import is_there


def show_while_there(prim: UsdGeom.Imageable, scene: Scene, lasting: Sphere | String, frame: int) -> None:
    """Author whether a prim is to be seen at a frame, where that changes at all."""
    if lasting.start > 0.0 or lasting.end is not None:
        seen = UsdGeom.Tokens.inherited if is_there(scene, lasting, frame) else UsdGeom.Tokens.invisible
        prim.CreateVisibilityAttr().Set(seen, frame)

"""Visibility of prims in the stage."""

from pxr import Usd, UsdGeom

from balloon_warp.scene import Scene, Sphere, String
from balloon_warp.scene.timeline import is_there

PAIRED = "balloonWarpPair"
"""Key of the custom data of a curve and of the mesh around it: pictures and exports of ours take the curve"""
BACKDROP = "balloonWarpBackdrop"
"""Key of the custom data of a backdrop: pictures of ours bring their own, and exports have none"""
SHOWN = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
"""Purposes of visible prims"""


def is_shown(prim: Usd.Prim) -> bool:
    """Return whether a prim is visible in pictures and exports; of a curve and its mesh, the curve."""
    if prim.HasCustomDataKey(BACKDROP):
        return False
    return (UsdGeom.Imageable(prim).ComputePurpose() in SHOWN) != prim.HasCustomDataKey(PAIRED)


def show_while_there(prim: UsdGeom.Imageable, scene: Scene, lasting: Sphere | String, frame: int) -> None:
    """Write whether a prim is to be seen at a frame, where that changes at all."""
    if lasting.start > 0.0 or lasting.end is not None:
        seen = UsdGeom.Tokens.inherited if is_there(scene, lasting, frame) else UsdGeom.Tokens.invisible
        prim.CreateVisibilityAttr().Set(seen, frame)

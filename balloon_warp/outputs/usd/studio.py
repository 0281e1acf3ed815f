"""Lights, and a camera that has all of the run in view, in a group of their own that can be left out or deleted."""

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

HOME = Sdf.Path("/World/Studio")
OURS = "balloonWarp"
"""key of the custom data that tells our camera from a user's: pictures find a better place for each themselves"""
ASPECT = 16.0 / 9.0
FOCAL_LENGTH = 0.5
"""of the camera, in tenths of the stage's unit, as USD has it: 50 mm where that is a meter"""
MOST_FRAMES = 40
"""that the camera's place is found from"""


def define_studio(stage: Usd.Stage, up_axis: str) -> None:
    """A sky all around and a sun from above, to the right and behind whoever looks from the front."""
    home = UsdGeom.Xform.Define(stage, HOME)
    if up_axis == "Z":  # what is in it is placed as if Y were up
        home.AddRotateXOp().Set(90.0)
    sky = UsdLux.DomeLight.Define(stage, HOME.AppendChild("Sky"))
    sky.CreateIntensityAttr(0.5)
    sky.CreateColorAttr(Gf.Vec3f(0.90, 0.95, 1.0))
    sun = UsdLux.DistantLight.Define(stage, HOME.AppendChild("Sun"))
    sun.CreateNormalizeAttr(True)  # what it gives does not depend on how wide it is
    sun.CreateIntensityAttr(0.7)  # Blender takes it four times as strong, others as it is: fit for both
    sun.CreateAngleAttr(4.0)
    sun.AddRotateXYZOp().Set(Gf.Vec3f(-50.0, 40.0, 0.0))


def define_camera(stage: Usd.Stage, paths: list[Sdf.Path], frames: list[int]) -> None:
    """A camera for a wide picture, near enough to have prims at all frames in view; none where nothing is to be seen.

    Args:
        paths: of the prims that matter.
        frames: whose time samples are there.
    """
    from balloon_warp.outputs.render.camera import CameraFit  # a room that reads stages, and so loads this one
    from balloon_warp.outputs.render.moment import Z_TO_Y_UP

    chosen = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST_FRAMES)).round().astype(int))
    purposes = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render, UsdGeom.Tokens.proxy]
    turn = Z_TO_Y_UP if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z else np.eye(3)
    fit, seen = CameraFit(ASPECT), [np.empty((0, 3))]
    for place in chosen.tolist():
        cache = UsdGeom.BBoxCache(Usd.TimeCode(frames[place]), purposes)
        boxes = [cache.ComputeWorldBound(stage.GetPrimAtPath(path)).ComputeAlignedRange() for path in paths]
        seen += [np.array([box.GetCorner(corner) for corner in range(8)]) for box in boxes if not box.IsEmpty()]
    corners = np.concatenate(seen) @ turn
    if not len(corners) or not np.isfinite(corners).all() or not np.ptp(corners, axis=0).max() > 0.0:
        return
    fit.include(corners)
    found = fit.camera()
    camera = UsdGeom.Camera.Define(stage, HOME.AppendChild("Camera"))
    camera.GetPrim().SetCustomDataByKey(OURS, "frames the run")
    camera.AddTransformOp().Set(_matrix(found.axes, found.eye))
    camera.CreateFocalLengthAttr(FOCAL_LENGTH)
    camera.CreateHorizontalApertureAttr(2.0 * FOCAL_LENGTH * found.half_width)
    camera.CreateVerticalApertureAttr(2.0 * FOCAL_LENGTH * found.half_height)
    distance = float(np.linalg.norm(found.eye - corners.mean(axis=0)))
    camera.CreateFocusDistanceAttr(distance)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01 * distance, 1000.0 * distance))


def _matrix(axes: NDArray[np.float64], eye: NDArray[np.float64]) -> Gf.Matrix4d:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = axes, eye
    return Gf.Matrix4d(matrix.tolist())

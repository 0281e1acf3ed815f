"""The stage's camera: it has the run in view, from where the scene says that a picture is taken."""

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom

from balloon_warp.outputs.camera import AZIMUTH, ELEVATION, Camera, CameraFit
from balloon_warp.outputs.moment import Z_TO_Y_UP
from balloon_warp.scene import Scene

OURS = "balloonWarp"
"""Key of the custom data that tells our camera from a user's: pictures find a better place for each themselves"""
ASPECT = 16.0 / 9.0
FOCAL_LENGTH = 0.5
"""Focal length in tenths of the stage's unit, as USD has it: 50 mm where that is a meter"""


def fit_for(scene: Scene) -> CameraFit:
    """Begin to find the camera for a wide picture, from where the scene's picture looks."""
    said = scene.picture
    azimuth = AZIMUTH if said is None or said.azimuth is None else said.azimuth
    elevation = ELEVATION if said is None or said.elevation is None else said.elevation
    return CameraFit(ASPECT, azimuth, elevation)


def as_pictured(camera: Camera, center: NDArray[np.float64], scene: Scene) -> Camera:
    """Return a camera with the target and the zoom of the scene's picture.

    Args:
        center: of the camera's subject, Y up, shape (3,).
    """
    if scene.picture is None:
        return camera
    if scene.picture.look_at is not None:
        middle = np.array(scene.picture.look_at) @ (Z_TO_Y_UP if scene.up_axis == "Z" else np.eye(3))
        camera = camera.looking_at(middle, center)
    return camera.zoomed(scene.picture.zoom)


def define_camera(stage: Usd.Stage, path: Sdf.Path, camera: Camera, sharp: NDArray[np.float64]) -> None:
    """Define a camera in the coordinates of its parent, where Y is up.

    Args:
        sharp: the point that is in focus, shape (3,).
    """
    prim = UsdGeom.Camera.Define(stage, path)
    prim.GetPrim().SetCustomDataByKey(OURS, "frames the run")
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = camera.axes, camera.eye
    prim.AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))
    prim.CreateFocalLengthAttr(FOCAL_LENGTH)
    prim.CreateHorizontalApertureAttr(2.0 * FOCAL_LENGTH * camera.half_width)
    prim.CreateVerticalApertureAttr(2.0 * FOCAL_LENGTH * camera.half_height)
    distance = float(np.linalg.norm(camera.eye - sharp))
    prim.CreateFocusDistanceAttr(distance)
    prim.CreateClippingRangeAttr(Gf.Vec2f(0.01 * distance, 1000.0 * distance))

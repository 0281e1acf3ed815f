"""The ground in the stage: a large square."""

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from balloon_warp.model import Model
from balloon_warp.outputs.usd.material import GROUND_COLOR, paint

SIZES = 20.0
"""half the square's side, as a multiple of the scene's size"""


def define_ground(stage: Usd.Stage, path: Sdf.Path, model: Model) -> None:
    """A square across the up axis, around the balloons as they are at the start."""
    points = np.concatenate([shape.mesh.points for shape in model.shapes])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    height = float(model.ground_height.numpy()[0])
    define_square(stage, path, middle, SIZES * float(np.ptp(points, axis=0).max()), height, model.scene.up_axis)


def define_square(
    stage: Usd.Stage, path: Sdf.Path, middle: NDArray[np.float64], half: float, height: float, up_axis: str
) -> None:
    """A level square: `half` is half its side [m], `middle` a point above its center."""
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    if up_axis == "Y":
        square = np.stack([middle[0] + corners[:, 0], np.full(4, height), middle[2] - corners[:, 1]], axis=1)
    else:
        square = np.stack([middle[0] + corners[:, 0], middle[1] + corners[:, 1], np.full(4, height)], axis=1)
    square = Vt.Vec3fArray.FromNumpy(square.astype(np.float32))
    prim = UsdGeom.Mesh.Define(stage, path)
    prim.CreatePointsAttr(square)
    prim.CreateFaceVertexCountsAttr([4])
    prim.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(square))
    paint(prim, GROUND_COLOR, roughness=0.9)

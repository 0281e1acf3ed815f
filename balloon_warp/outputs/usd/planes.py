"""The level planes of the stage, ground and water: large squares."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from balloon_warp.model import Model
from balloon_warp.outputs.usd.material import GROUND_COLOR, WATER_COLOR, Color, paint
from balloon_warp.scene import Scene

SIZES = 20.0
"""half the square's side, as a multiple of the scene's size"""


class Plane(NamedTuple):
    """What a level plane is called, and looks like."""

    name: str
    """of its prim"""
    piece: str
    """of the prims of worlds that each have their own, at their own height"""
    height: str
    """the parameter of the model that says its height"""
    color: Color
    roughness: float
    opacity: float


PLANES = {
    "ground": Plane("Ground", "Floor", "ground_height", GROUND_COLOR, roughness=0.9, opacity=1.0),
    "water": Plane("Water", "Pool", "water_level", WATER_COLOR, roughness=0.05, opacity=0.5),
}
"""by their tables of the scene"""


def planes_of(scene: Scene) -> list[Plane]:
    """Those that the scene has."""
    return [plane for table, plane in PLANES.items() if getattr(scene, table)]


def define_planes(stage: Usd.Stage, model: Model) -> None:
    """A square for each plane of the scene, around the balloons as they are at the start."""
    points = np.concatenate([shape.mesh.points for shape in model.shapes])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    half = SIZES * float(np.ptp(points, axis=0).max())
    for plane in planes_of(model.scene):
        height = float(getattr(model, plane.height).numpy()[0])
        define_square(stage, Sdf.Path(f"/World/{plane.name}"), plane, middle, half, height, model.scene.up_axis)


def define_square(
    stage: Usd.Stage,
    path: Sdf.Path,
    plane: Plane,
    middle: NDArray[np.float64],
    half: float,
    height: float,
    up_axis: str,
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
    paint(prim, plane.color, roughness=plane.roughness, opacity=plane.opacity)

"""The level planes of the stage, ground and water: large squares."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from balloon_warp.frame import Frame
from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.model import Model
from balloon_warp.outputs.usd.material import Color, paint
from balloon_warp.outputs.usd.rigid import SURFACE, be_hit
from balloon_warp.scene import Scene
from balloon_warp.scene.colors import GROUND_COLOR, WATER_COLOR, paper_of

SIZES = 20.0
"""Half the square's side, as a multiple of the scene's size"""


class Plane(NamedTuple):
    """Name and look of a level plane."""

    name: str
    """Name of the plane's prim"""
    piece: str
    """Name of the prims of worlds that each have their own, at their own height"""
    height: str
    """Name of the plane's height, in the model and in a frame"""
    color: Color
    roughness: float
    opacity: float


PLANES = {
    "ground": Plane("Ground", "Floor", "ground_height", GROUND_COLOR, roughness=0.9, opacity=1.0),
    "water": Plane("Water", "Pool", "water_level", WATER_COLOR, roughness=0.05, opacity=0.5),
}
"""Planes by their tables of the scene"""


def planes_of(scene: Scene) -> list[Plane]:
    """Return the planes that the scene has; its ground is of the paper of its picture."""
    planes = PLANES | {"ground": PLANES["ground"]._replace(color=paper_of(scene))}
    return [plane for table, plane in planes.items() if getattr(scene, table)]


def define_square(
    stage: Usd.Stage,
    path: Sdf.Path,
    plane: Plane,
    middle: NDArray[np.float64],
    half: float,
    height: float,
    up_axis: str,
) -> UsdGeom.Mesh:
    """Return a level square: `half` is half its side [m], `middle` a point above its center."""
    prim = UsdGeom.Mesh.Define(stage, path)
    square = level_square(middle, half, height, up_axis)
    prim.CreatePointsAttr(square)
    prim.CreateFaceVertexCountsAttr([4])
    prim.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(square))
    prim.GetPrim().SetCustomDataByKey(SCENERY, plane.name)
    paint(prim, plane.color, roughness=plane.roughness, opacity=plane.opacity)
    return prim


class PlanePrim:
    """A plane of the scene: a square around the balloons as they are at the start."""

    def __init__(self, stage: Usd.Stage, plane: Plane, model: Model):
        points = np.concatenate([shape.mesh.points for shape in model.shapes])
        self.plane, self.up_axis = plane, model.scene.up_axis
        self.middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self.half = SIZES * float(np.ptp(points, axis=0).max())
        self._moves = any(plane.height in change.values for change in model.due_changes)
        height = float(model.parameters[plane.height].numpy()[0])
        path = Sdf.Path(f"/World/{plane.name}")
        self.prim = define_square(stage, path, plane, self.middle, self.half, height, self.up_axis)
        if plane.name == "Ground":
            be_hit(self.prim.GetPrim(), *(float(model.parameters[f"ground_{each}"].numpy()[0]) for each in SURFACE))

    def write(self, frame: Frame) -> None:
        """Write the plane's height, if the scene moves it: one at rest has no time samples."""
        if self._moves:
            self._place(getattr(frame, self.plane.height), frame.number)

    def _place(self, height: float, time: float) -> None:
        square = level_square(self.middle, self.half, height, self.up_axis)
        self.prim.GetPointsAttr().Set(square, time)
        self.prim.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(square), time)


def level_square(middle: NDArray[np.float64], half: float, height: float, up_axis: str) -> Vt.Vec3fArray:
    """Return the square's corners, counter-clockwise from above; arguments as for `define_square`."""
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    if up_axis == "Y":
        square = np.stack([middle[0] + corners[:, 0], np.full(4, height), middle[2] - corners[:, 1]], axis=1)
    else:
        square = np.stack([middle[0] + corners[:, 0], middle[1] + corners[:, 1], np.full(4, height)], axis=1)
    return Vt.Vec3fArray.FromNumpy(square.astype(np.float32))

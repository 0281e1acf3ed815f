"""The knot of a string in the stage: a mesh of its own, with an animated place and turn."""

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.outputs.knot import Knot, knot_mesh, knot_size
from balloon_warp.outputs.usd.material import paint
from balloon_warp.outputs.usd.obstacle import as_gf
from balloon_warp.scene import Scene
from balloon_warp.scene.colors import balloon_color, mean_color

OPACITY = 0.98
"""Opacity of the rubber there, which is not stretched and lies in folds"""


def knot_path(string: Sdf.Path) -> Sdf.Path:
    """Return the path of a knot, beside the string's."""
    return string.ReplaceName(f"{string.name}_Knot")


def define_knot(stage: Usd.Stage, path: Sdf.Path, scene: Scene, number: int, held: PolygonMesh) -> UsdGeom.Mesh:
    """Define a knot's mesh in the balloon's color, with ops for position and rotation without values.

    Args:
        number: Number of the string.
        held: Mesh of the balloon.
    """
    mesh = knot_mesh(knot_size(held), scene.up)
    prim = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(mesh.points.astype(np.float32))
    prim.CreatePointsAttr(points)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_counts))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_indices))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
    prim.CreateDoubleSidedAttr(True)
    prim.GetPrim().SetCustomDataByKey(SCENERY, "Knot")
    prim.AddTranslateOp()
    prim.AddOrientOp()
    balloon = scene.string[number].balloon
    color = mean_color(held, scene.balloon[balloon], balloon_color(scene, balloon))
    paint(prim, color, roughness=0.2, opacity=OPACITY, clearcoat=1.0)
    return prim


class KnotPrim:
    """The knot of one string of the scene."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, scene: Scene, number: int, held: PolygonMesh, particle: int):
        self._up = scene.up
        self._knot = Knot(held, particle)
        self.prim = define_knot(stage, path, scene, number, held)
        self._place, self._turn = self.prim.GetOrderedXformOps()

    def write(self, points: NDArray[np.float32], curve: NDArray[np.float32], time: float) -> None:
        """Write the knot's pose; arguments as in `Knot.pose`."""
        for op, value in zip((self._place, self._turn), as_gf(self._knot.pose(points, curve, self._up)), strict=True):
            op.Set(value, time)

"""The tube around a string or a tube's curve: Blender gives materials to meshes, and none to curves."""

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdShade, Vt

from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.outputs.tubes import SIDES, tube_topology
from balloon_warp.outputs.usd.lines import write_lines
from balloon_warp.outputs.usd.presence import PAIRED


class Strand:
    """A curve, and a mesh around it that final pictures of other programs show in its place.

    USD has purposes for such pairs: the mesh is for rendering, and the curve is its proxy.

    Args:
        curve: one that has its material and no points yet.
        start: points along the curve before there are any frames, shape (count, 3): who takes no times, such as a
            simulator that goes on, has them.
    """

    def __init__(self, stage: Usd.Stage, curve: UsdGeom.BasisCurves, start: NDArray[np.floating]):
        self.curve = curve
        (count,) = curve.GetCurveVertexCountsAttr().Get()
        (width,) = curve.GetWidthsAttr().Get()
        self._radius = 0.5 * width
        path = curve.GetPath()
        self.mesh = UsdGeom.Mesh.Define(stage, path.ReplaceName(f"{path.name}_Mesh"))
        counts, indices = tube_topology(np.array([count], np.int32))
        self.mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
        self.mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices))
        self.mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points_around(start, self._radius)))
        self.mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
        self.mesh.CreateDisplayColorAttr(curve.GetDisplayColorAttr().Get())
        material, _ = UsdShade.MaterialBindingAPI(curve.GetPrim()).ComputeBoundMaterial()
        UsdShade.MaterialBindingAPI.Apply(self.mesh.GetPrim()).Bind(material)
        self.mesh.CreatePurposeAttr(UsdGeom.Tokens.render)
        curve.CreatePurposeAttr(UsdGeom.Tokens.proxy)
        self.mesh.SetProxyPrim(curve.GetPrim())
        self.mesh.GetPrim().SetCustomDataByKey(SCENERY, "Strand")
        for prim, meaning in ((curve, "stands for its mesh"), (self.mesh, "the curve stands for it")):
            prim.GetPrim().SetCustomDataByKey(PAIRED, meaning)

    def write(self, points: NDArray[np.float32], time: float) -> None:
        """Write points along the curve, shape (count, 3)."""
        write_lines(self.curve, points, time)
        around = Vt.Vec3fArray.FromNumpy(points_around(points, self._radius))
        self.mesh.GetPointsAttr().Set(around, time)
        self.mesh.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(around), time)


def points_around(points: NDArray[np.floating], radius: float) -> NDArray[np.float32]:
    """Return `SIDES` points about each point of a curve in a plane, in the order of `tube_topology`.

    Returns:
        shape (SIDES * len(points), 3)
    """
    places = np.asarray(points, float)
    chord = places[-1] - places[0]
    bend = places - places[0]
    if chord @ chord > 0.0:
        bend -= np.outer(bend @ chord / (chord @ chord), chord)
    side = np.cross(chord, bend[(bend * bend).sum(axis=1).argmax()])  # across the plane
    if np.linalg.norm(side) <= 1e-6 * (chord @ chord):  # the curve is straight: any will do
        side = np.cross(chord, np.eye(3)[np.abs(chord).argmin()])
    side /= max(float(np.linalg.norm(side)), 1e-12)
    along = np.gradient(places, axis=0)
    other = np.cross(along, side)
    other /= np.maximum(np.linalg.norm(other, axis=1, keepdims=True), 1e-12)
    turn = 2.0 * np.pi * np.arange(SIDES)[:, None] / SIDES
    rings = places[:, None] + radius * (np.cos(turn) * side + np.sin(turn) * other[:, None])
    return rings.reshape(-1, 3).astype(np.float32)

"""A balloon in the stage: a polygon mesh of fixed topology."""

from dataclasses import replace

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from balloon_warp.mesh.geometry import signed_volume, total_area
from balloon_warp.model import Model
from balloon_warp.outputs.usd.material import BALLOON_COLORS, paint
from balloon_warp.simulator import Frame

MEASURES = ("volume", "area", "pressure")
"""per-frame attributes under `userProperties:`, in m^3, m^2 and Pa"""


class BalloonPrim:
    """One balloon of the scene."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number = number
        self.mesh = model.shapes[number].mesh
        self.prim = UsdGeom.Mesh.Define(stage, path)
        self.prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(self.mesh.face_vertex_counts))
        self.prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(self.mesh.face_vertex_indices))
        self.prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        self.prim.CreateDoubleSidedAttr(True)
        color = model.scene.balloon[number].color or BALLOON_COLORS[number % len(BALLOON_COLORS)]
        paint(self.prim, color, roughness=0.2, opacity=0.92, clearcoat=1.0)
        self._measures = {
            name: self.prim.GetPrim().CreateAttribute(f"userProperties:{name}", Sdf.ValueTypeNames.Double, custom=True)
            for name in MEASURES
        }

    def write(self, frame: Frame) -> None:
        points = frame.points[self.number]
        self.prim.GetPointsAttr().Set(points, frame.number)
        self.prim.GetVelocitiesAttr().Set(frame.velocities[self.number], frame.number)
        self.prim.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(Vt.Vec3fArray.FromNumpy(points)), frame.number)
        for name, value in self._measure(frame).items():
            self._measures[name].Set(value, frame.number)

    def _measure(self, frame: Frame) -> dict[str, float]:
        mesh = replace(self.mesh, points=frame.points[self.number].astype(np.float64))
        area = total_area(mesh)
        inflation = float(np.linalg.norm(frame.inflation_forces[self.number], axis=1).sum())
        return {"volume": signed_volume(mesh), "area": area, "pressure": inflation / area if area > 0.0 else 0.0}

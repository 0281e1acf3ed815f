"""Balloon in the stage: a polygon mesh of fixed topology.

Where it may burst, the corners of its faces are written in each frame: those of a torn face are all at one of its
vertices, so that the number of faces stays.
"""

from dataclasses import replace

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from balloon_warp.frame import Frame
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.corners import beside_faces
from balloon_warp.mesh.folds import SOFT_CREASE, sharp_edges
from balloon_warp.model import Model
from balloon_warp.model.shape import BalloonShape
from balloon_warp.outputs.usd.contacts import ContactChannels
from balloon_warp.outputs.usd.deformable import define_deformable, rest_points
from balloon_warp.outputs.usd.looks import paint_as_file, place_texture
from balloon_warp.outputs.usd.material import offer_latex, paint, print_on
from balloon_warp.scene import Balloon
from balloon_warp.scene.colors import looks_of_file, palette_color

MEASURES = ("volume", "area", "pressure", "stretch")
"""Attributes per frame under `userProperties:`, in m^3, m^2 and Pa; the last is the mean over the start"""
OF_GAS = ("moles", "thrust")
"""Attributes of balloons with gas: amount in mol, and thrust of the jet in N"""
PAINTED = {"roughness": 0.4, "clearcoat": 0.3}
"""Opaque finish of a mesh with looks of its own"""


def define_balloon(
    stage: Usd.Stage, path: Sdf.Path, shape: BalloonShape, number: int, balloon: Balloon
) -> UsdGeom.Mesh:
    """Define the mesh's topology and look; no points yet.

    The look is the balloon's color, else that of the mesh's file, else the palette's for its number.
    """
    mesh, prim = shape.mesh, UsdGeom.Mesh.Define(stage, path)
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_counts))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.face_vertex_indices))
    # Who draws it refines it, or makes it smooth at least: simulated points are the control points of that surface.
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
    if (mesh.face_vertex_counts == 3).any():
        prim.CreateTriangleSubdivisionRuleAttr(UsdGeom.Tokens.smooth)
    _crease(prim, replace(mesh, points=rest_points(shape)))
    prim.CreateDoubleSidedAttr(True)
    place_texture(prim, mesh)
    own, looks_like = balloon.color or palette_color(number), balloon.looks_like
    if looks_like == "foil":
        finish = {"roughness": 0.12, "metallic": 1.0}
    else:
        # A balloon of springs is inflated from the start; rubber is thick until it is.
        opacity = 0.92 if balloon.material.law == "springs" else 0.97
        finish = {"roughness": 0.2, "opacity": opacity, "clearcoat": 1.0, "ior": 1.0}  # the coat alone mirrors
    if looks := looks_of_file(mesh, balloon):
        if balloon.look is None and looks_like == "latex":
            finish = PAINTED
        paint_as_file(prim, mesh, looks, own, **finish)
        return prim
    material = paint(prim, own, **finish)
    if looks_like == "latex":
        offer_latex(material, own)
    if balloon.print is not None:
        print_on(material, balloon.print)
    return prim


def _crease(prim: UsdGeom.Mesh, mesh: PolygonMesh) -> None:
    """Keep edges sharp that are so at rest, as those of a box and the seam of foil, but no folds of a parcel."""
    edges = sharp_edges(mesh, SOFT_CREASE)
    if len(edges):
        prim.CreateCreaseIndicesAttr(Vt.IntArray.FromNumpy(edges.ravel()))
        prim.CreateCreaseLengthsAttr([2] * len(edges))
        prim.CreateCreaseSharpnessesAttr([UsdGeom.Mesh.SHARPNESS_INFINITE] * len(edges))


class BalloonPrim:
    """Balloon of the scene."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number = number
        kind = model.scene.balloon[number].inflation.kind
        self._has_pressure, self._has_gas = kind != "normal_force", kind == "gas"
        self.mesh = model.shapes[number].mesh
        self.prim = define_balloon(stage, path, model.shapes[number], number, model.scene.balloon[number])
        define_deformable(self.prim, model, number)
        self._may_burst = model.scene.balloon[number].material.strength is not None
        self._first_area = model.shapes[number].area
        self._measures = {
            name: self.prim.GetPrim().CreateAttribute(f"userProperties:{name}", Sdf.ValueTypeNames.Double, custom=True)
            for name in (*MEASURES, *(OF_GAS if self._has_gas else ()))
        }
        self._contacts = ContactChannels(self.prim.GetPrim(), model, number)

    def write(self, frame: Frame) -> None:
        points = Vt.Vec3fArray.FromNumpy(frame.points[self.number])
        self.prim.GetPointsAttr().Set(points, frame.number)
        if self._may_burst:
            corners = Vt.IntArray.FromNumpy(frame.corners(self.number))
            self.prim.GetFaceVertexIndicesAttr().Set(corners, frame.number)
        self.prim.GetExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(self._seen(frame)), frame.number)
        for name, value in self._measure(frame).items():
            self._measures[name].Set(value, frame.number)
        self._contacts.write(frame)

    def _seen(self, frame: Frame) -> Vt.Vec3fArray:
        """Return the balloon's points but those that a tear cut off from all faces: they fly far, and are invisible."""
        points = frame.points[self.number]
        if frame.torn and frame.torn[self.number].any():
            points = points[beside_faces(self.mesh, frame.torn[self.number])]
        return Vt.Vec3fArray.FromNumpy(points)

    @property
    def points(self) -> tuple[Sdf.Path, Sdf.Path]:
        """Attributes of the points and of their velocities."""
        return self.prim.GetPointsAttr().GetPath(), self.prim.GetVelocitiesAttr().GetPath()

    def _measure(self, frame: Frame) -> dict[str, float]:
        volume, area = float(frame.volumes[self.number]), float(frame.areas[self.number])
        stretch = float(np.sqrt(area / self._first_area)) if self._first_area else 1.0
        measures = {"volume": volume, "area": area, "pressure": self._pressure(frame, area), "stretch": stretch}
        if self._has_gas:
            gas = float(frame.gas_amounts[self.number]), float(frame.thrusts[self.number])
            measures |= dict(zip(OF_GAS, gas, strict=True))
        return measures

    def _pressure(self, frame: Frame, area: float) -> float:
        """Return the gauge pressure [Pa]; for normal forces, their sum over the area."""
        if self._has_pressure:
            return float(frame.pressures[self.number])
        forces = frame.inflation_forces[self.number]
        inflation = float(np.sqrt(np.einsum("ij,ij->i", forces, forces)).sum(dtype=np.float64))
        return inflation / area if area > 0.0 else 0.0

"""The studio's backdrop: a sheet of paper on the floor that curves up behind the subject, so that no edge is seen."""

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import vertex_normals
from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.outputs.usd.material import Color, paint, shine_from_within, take_from_primvar
from balloon_warp.outputs.usd.presence import BACKDROP

RADIUS, BEND, HEIGHT = 9.0, 7.0, 9.0
"""Radius of the floor, radius of the curve between floor and wall, and height of the wall, in sizes of the subject"""
OPEN = (-0.6, 0.2)
"""Cosines of the angle from straight behind the subject between which the wall comes down to the floor: there is none
in front"""
AROUND, FLAT, CURVED, UPRIGHT = 96, 6, 14, 2
"""Number of faces around the subject, and of the floor, the curve and the wall from bottom to top"""
FLOOR_GLOW, WALL_GLOW = 0.18, 0.95
"""Fractions of their color that floor and wall emit, as if lamps of their own lit them evenly"""
GLOW_RISES = (0.0, 0.8)
"""Heights between which the one becomes the other, in sizes of the subject"""
ROUGHNESS = 0.9


def define_backdrop(
    stage: Usd.Stage,
    path: Sdf.Path,
    foot: NDArray[np.float64],
    level_axes: NDArray[np.float64],
    size: float,
    paper: Color,
) -> None:
    """Define the sheet, in the coordinates of the prim's parent, where Y is up.

    Args:
        foot: the point of the floor below the subject, shape (3,).
        level_axes: unit vectors to the right, up, and level back toward the camera, a row each, shape (3, 3).
        size: of the subject.
        paper: color of the sheet.
    """
    sheet = sweep()
    points = Vt.Vec3fArray.FromNumpy((size * sheet.points @ level_axes + foot).astype(np.float32))
    prim = UsdGeom.Mesh.Define(stage, path)
    prim.CreatePointsAttr(points)
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(sheet.face_vertex_counts))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(sheet.face_vertex_indices))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy((vertex_normals(sheet) @ level_axes).astype(np.float32)))
    prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    prim.CreateDoubleSidedAttr(True)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    prim.CreatePurposeAttr(UsdGeom.Tokens.render)  # a viewer that frames prims of default purpose frames the subject
    for key in (SCENERY, BACKDROP):
        prim.GetPrim().SetCustomDataByKey(key, "Backdrop")
    _light_from_within(prim, sheet.points[:, 1], paper)


def glow_like_floor(ground: Usd.Prim, paper: Color) -> None:
    """Make the ground emit light as the sheet below it does, so that the transition is invisible."""
    material = UsdShade.MaterialBindingAPI(ground).ComputeBoundMaterial()[0]
    shine_from_within(material).Set(FLOOR_GLOW * Gf.Vec3f(*paper))


def _light_from_within(prim: UsdGeom.Mesh, heights: NDArray[np.float64], paper: Color) -> None:
    material = paint(prim, paper, roughness=ROUGHNESS)
    shares = FLOOR_GLOW + (WALL_GLOW - FLOOR_GLOW) * _smooth_step(*GLOW_RISES, heights)
    colors = np.outer(shares, paper).astype(np.float32)
    kind, each_point = Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("glow", kind, each_point).Set(Vt.Vec3fArray.FromNumpy(colors))
    take_from_primvar(shine_from_within(material), "glow", FLOOR_GLOW * Gf.Vec3f(*paper))


def sweep() -> PolygonMesh:
    """Return the sheet for a subject of size 1 above the origin, whose camera looks along -Z."""
    outward, upward = _profile()
    angles = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    rise = _smooth_step(*OPEN, np.cos(angles))[:, None]
    rings = np.stack([np.sin(angles)[:, None] * outward, rise * upward, -np.cos(angles)[:, None] * outward], axis=-1)
    first = 1 + np.arange(AROUND)[:, None] * len(outward)  # after the point in the middle
    following = np.roll(first, -1, axis=0)
    place = np.arange(len(outward) - 1)
    quads = np.stack([first + place, following + place, following + place + 1, first + place + 1], axis=-1)
    fan = np.concatenate([np.zeros_like(first), following, first], axis=1)
    counts = np.repeat([3, 4], [len(fan), quads.size // 4]).astype(np.int32)
    corners = np.concatenate([fan.ravel(), quads.ravel()]).astype(np.int32)
    return PolygonMesh(np.concatenate([np.zeros((1, 3)), rings.reshape(-1, 3)]), counts, corners)


def _profile() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return distance and height of the sheet straight behind the subject."""
    flat = np.linspace(0.0, RADIUS - BEND, FLAT + 1)[1:]
    turn = np.linspace(0.0, 0.5 * np.pi, CURVED + 1)[1:]
    wall = np.linspace(BEND, HEIGHT, UPRIGHT + 1)[1:]
    outward = np.concatenate([flat, RADIUS - BEND + BEND * np.sin(turn), np.full(len(wall), RADIUS)])
    upward = np.concatenate([np.zeros(len(flat)), BEND - BEND * np.cos(turn), wall])
    return outward, upward


def _smooth_step(begin: float, end: float, value: NDArray[np.float64]) -> NDArray[np.float64]:
    t = np.clip((value - begin) / (end - begin), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)

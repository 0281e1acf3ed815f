"""Meshes of USD stages: polygons at the default time, placed in the stage's world."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Tf, Usd, UsdGeom, UsdUtils

from balloon_warp.errors import InputError
from balloon_warp.mesh.check import check_mesh
from balloon_warp.mesh.corners import backward_corners, with_corners
from balloon_warp.mesh.polygon_mesh import PolygonMesh


def read_stage(path: Path | str, prim_path: str | None) -> PolygonMesh:
    """See `read_usd`."""
    stage = open_stage(path)
    prim, warnings = choose_prim(stage, path, prim_path)
    return _read_prim(stage, prim, f"{path}: {prim.GetPath()}", warnings)


def open_stage(path: Path | str) -> Usd.Stage:
    """The stage of a file.

    Raises:
        InputError: it is none.
    """
    _quiet = UsdUtils.CoalescingDiagnosticDelegate()  # while it lives, USD prints nothing
    try:
        return Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError(f"{path}: is not a USD stage that can be read") from error


def choose_prim(stage: Usd.Stage, path: Path | str, prim_path: str | None) -> tuple[Usd.Prim, tuple[str, ...]]:
    """The mesh at a path, or the stage's first, and what is to be said of the choice.

    Raises:
        InputError: there is none.
    """
    everything = Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
    prims = [prim for prim in everything if UsdGeom.Mesh(prim)]
    if not prims:
        raise InputError(f"{path}: has no mesh (a prim of type Mesh)")
    if prim_path is not None:
        for prim in prims:
            if str(prim.GetPath()) == prim_path:
                return prim, ()
        raise InputError(f"{path}: has no mesh {prim_path} (its first of {len(prims)} is {prims[0].GetPath()})")
    if len(prims) == 1:
        return prims[0], ()
    return prims[0], (f"The stage has {len(prims)} meshes; this is the first, {prims[0].GetPath()}.",)


def _read_prim(stage: Usd.Stage, prim: Usd.Prim, source: str, warnings: tuple[str, ...]) -> PolygonMesh:
    geometry = UsdGeom.Mesh(prim)
    points = np.array(_value(geometry.GetPointsAttr(), source), dtype=np.float64).reshape(-1, 3)
    counts = np.array(_value(geometry.GetFaceVertexCountsAttr(), source), dtype=np.int32)
    indices = np.array(_value(geometry.GetFaceVertexIndicesAttr(), source), dtype=np.int32)
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    if not 0.0 < unit < np.inf:
        raise InputError(f"{source}: the stage's metersPerUnit must be positive (got {unit})")

    to_world = world_matrix(prim)
    left_handed = geometry.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
    mesh = PolygonMesh(
        # USD multiplies row vectors from the left.
        points=points @ to_world[:3, :3] + to_world[3, :3],
        face_vertex_counts=counts,
        face_vertex_indices=indices,
        name=prim.GetName(),
        up_axis=str(UsdGeom.GetStageUpAxis(stage)),
        meters_per_unit=float(unit),
        unit_known=UsdGeom.StageHasAuthoredMetersPerUnit(stage),
        warnings=warnings,
    )
    check_mesh(mesh, source)
    mesh = replace(
        mesh,
        texture_coordinates=_texture_coordinates(geometry, indices),
        groups=_groups(geometry, counts, indices, len(points)),
    )
    if left_handed != (np.linalg.det(to_world[:3, :3]) < 0.0):
        mesh = with_corners(mesh, backward_corners(mesh))
    return mesh


def _groups(
    geometry: UsdGeom.Mesh, counts: NDArray[np.int32], indices: NDArray[np.int32], point_count: int
) -> dict[str, NDArray[np.int32]]:
    """The points of the mesh's subsets, of faces or of points, ascending; without what names nothing there is."""
    groups, faces = {}, np.repeat(np.arange(len(counts)), counts)
    for subset in UsdGeom.Subset.GetAllGeomSubsets(geometry):
        named = np.array(subset.GetIndicesAttr().Get() or (), dtype=np.int32)
        if subset.GetElementTypeAttr().Get() == UsdGeom.Tokens.face:
            groups[subset.GetPrim().GetName()] = np.unique(indices[np.isin(faces, named)])
        elif subset.GetElementTypeAttr().Get() == UsdGeom.Tokens.point:
            groups[subset.GetPrim().GetName()] = np.unique(named[(named >= 0) & (named < point_count)])
    return groups


def _texture_coordinates(geometry: UsdGeom.Mesh, indices: NDArray[np.int32]) -> NDArray[np.float32] | None:
    """`primvars:st` at each corner, shape (corner_count, 2); None without it, or where it does not fit the mesh."""
    primvar = UsdGeom.PrimvarsAPI(geometry).GetPrimvar("st")
    value = primvar.ComputeFlattened() if primvar and primvar.HasValue() else None
    flat = np.array(value if value is not None else (), dtype=np.float32)
    if flat.ndim != 2 or flat.shape[1] != 2 or not np.isfinite(flat).all():
        return None
    if primvar.GetInterpolation() in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying) and len(flat) > indices.max():
        return flat[indices]
    return flat if primvar.GetInterpolation() == UsdGeom.Tokens.faceVarying and len(flat) == len(indices) else None


def _value(attribute: Usd.Attribute, source: str) -> Any:
    value = attribute.Get()
    if value is None:
        value = attribute.Get(Usd.TimeCode.EarliestTime())
    if value is None:
        raise InputError(f"{source}: has no {attribute.GetName()}")
    return value


def world_matrix(prim: Usd.Prim) -> NDArray[np.float64]:
    """Local to world, shape (4, 4), row vectors; at the earliest sample where a transform has no default."""
    time = Usd.TimeCode.Default()
    ancestor = prim
    while ancestor:
        for operation in UsdGeom.Xformable(ancestor).GetOrderedXformOps():
            if operation.GetAttr().Get() is None:
                time = Usd.TimeCode.EarliestTime()
        ancestor = ancestor.GetParent()
    return np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time))

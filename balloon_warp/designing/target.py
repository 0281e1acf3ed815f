"""The shape that is wanted: one closed surface that does not cross itself, centered, of the size asked for."""

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import crossings_said
from balloon_warp.mesh.from_python import MeshLike
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.placement import axes_matrix
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.mesh.topology import border_edges, is_closed, mesh_edges, vertex_components
from balloon_warp.model.fixed import fixed_particles
from balloon_warp.model.unit_checks import LARGEST, SMALLEST

LEAST_SIZE, MOST_SIZE = 0.01, 100.0
"""Range of sizes [m]"""
MOST_VERTICES = 20_000
"""Largest number of vertices that are designed within minutes"""
HELD, NECK = "held", "neck"
"""Groups of the vertices that are held, and of those that are unless others are named"""
THINNEST = 1.0e-6
"""Volume over the cube of the size below which a shape is flat"""


def target_of(given: str | Path | MeshLike, size: float | None) -> PolygonMesh:
    """Read the wanted shape, or take it as it is in Python.

    Args:
        size: its largest extent [m]; its own when missing.

    Raises:
        InputError: it cannot be read, is open, has several parts, crosses itself or is too large.
    """
    require_size(size)
    return centered(shape_of(given)[1], size)


def held_target_of(
    given: str | Path | MeshLike, size: float | None, fixed: Sequence[int | str] | None
) -> tuple[PolygonMesh, NDArray[np.bool_]]:
    """Read the wanted shape, turned so that Y is up, and which of its vertices are held.

    Args:
        size: its largest extent [m]; its own when missing.
        fixed: held vertices of the file, counted from 0, and held groups of the mesh; its neck when missing.

    Raises:
        InputError: as of `target_of`, or there is no such vertex or group.
    """
    require_size(size)
    read = load_mesh(Path(given) if isinstance(given, str) else given)
    if fixed is None:
        if NECK not in read.groups:
            raise InputError(f"{read.name}: has no group {NECK} to hang from; expected fixed, with vertices or groups")
        fixed = [NECK]
    named = np.unique(np.array(fixed_particles(fixed, read), dtype=np.int32))
    shape = shape_of(replace(read, groups={HELD: named}))[1]
    held = np.zeros(shape.vertex_count, dtype=bool)
    held[shape.groups[HELD]] = True
    if not held.any() or held.all():
        raise InputError(f"fixed: holds {int(held.sum())} of {held.size} vertices; expected some, and not all")
    turned = replace(shape, points=shape.points @ axes_matrix(shape.up_axis, "Y").T, up_axis="Y")
    return centered(turned, size), held


def shape_of(given: str | Path | MeshLike) -> tuple[PolygonMesh, PolygonMesh]:
    """Read a shape: as its file has it, and closed, of one part and with faces outward.

    Raises:
        InputError: it cannot be read, is open, has several parts, crosses itself or is too large.
    """
    read = load_mesh(Path(given) if isinstance(given, str) else given)
    source = given if isinstance(given, str | Path) else read.name
    mesh = _used(prepared(read, source, Treatment()))
    edges = mesh_edges(mesh)
    if not is_closed(edges):
        low, high = edges.ends[border_edges(edges)[0]] + 1
        raise InputError(
            f"{source}: is open, between vertex {low} and {high}, counted from 1; expected a closed shape, as "
            "`balloon-warp remesh` makes of any surface"
        )
    if parts := len(np.unique(vertex_components(mesh, edges))) - 1:
        raise InputError(f"{source}: has {parts + 1} parts; expected one closed shape, as `balloon-warp remesh` makes")
    if mesh.vertex_count > MOST_VERTICES:
        raise InputError(
            f"{source}: has {mesh.vertex_count:,} vertices; expected at most {MOST_VERTICES:,}, see "
            "`balloon-warp remesh`"
        )
    if not abs(volume := signed_volume(mesh)) > THINNEST * float(np.ptp(mesh.points, axis=0).max()) ** 3:
        raise InputError(f"{source}: is flat and encloses no volume; expected a solid shape")
    if volume < 0.0:
        mesh = _turned(mesh)
    if crossed := crossings_said(mesh):
        raise InputError(f"{source}: {crossed}; expected a surface that does not, such as `balloon-warp remesh` makes")
    return read, mesh


def centered(mesh: PolygonMesh, size: float | None) -> PolygonMesh:
    """Return the bare shape in meters about the origin, of a size, or of its own.

    Raises:
        InputError: its own size is not that of a balloon.
    """
    points = mesh.points * mesh.meters_per_unit
    points = points - 0.5 * (points.max(axis=0) + points.min(axis=0))
    if size is None:
        size = float(np.ptp(points, axis=0).max())
        low, high = (LEAST_SIZE, MOST_SIZE) if mesh.unit_known else (SMALLEST, LARGEST)
        if not low <= size <= high:
            unit = "" if mesh.unit_known else ", in meters"
            raise InputError(
                f"{mesh.name}: is {size:.3g} m large{unit}; expected {low:g} to {high:g} m, or a size (--size)"
            )
    return replace(
        mesh, points=points * (size / np.ptp(points, axis=0).max()), meters_per_unit=1.0, warnings=(), looks=None,
        texture_coordinates=None, stand_ins=None, groups={},
    )  # fmt: skip


def require_size(size: float | None) -> None:
    """Make sure that a size can be simulated, if one is given.

    Raises:
        InputError: it cannot.
    """
    if size is not None and not (isfinite(size) and LEAST_SIZE <= size <= MOST_SIZE):
        raise InputError(f"size: must be from {LEAST_SIZE:g} to {MOST_SIZE:g} m (got {size})")


def _used(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh without unused vertices."""
    used, numbers = np.unique(mesh.face_vertex_indices, return_inverse=True)
    new = np.full(mesh.vertex_count, -1, dtype=np.int32)
    new[used] = np.arange(len(used), dtype=np.int32)
    there = np.arange(mesh.vertex_count) if mesh.stand_ins is None else mesh.stand_ins
    groups = {name: np.unique(new[there[vertices]]) for name, vertices in mesh.groups.items()}
    return replace(
        mesh, points=mesh.points[used], face_vertex_indices=numbers.ravel().astype(np.int32), stand_ins=None,
        groups={name: vertices[vertices >= 0] for name, vertices in groups.items()},
    )  # fmt: skip


def _turned(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with faces outward."""
    starts = np.cumsum(mesh.face_vertex_counts) - mesh.face_vertex_counts
    order = np.concatenate([
        np.arange(start + count - 1, start - 1, -1)
        for start, count in zip(starts.tolist(), mesh.face_vertex_counts.tolist(), strict=True)
    ])  # fmt: skip
    looks = mesh.looks.at(order) if mesh.looks else None
    return replace(mesh, face_vertex_indices=mesh.face_vertex_indices[order], looks=looks)

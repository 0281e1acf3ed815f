"""Any surface as a closed mesh of even quads: signed distance, then surface nets."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.faithful import infidelity
from balloon_warp.mesh.feasible import (
    MOST_BY_ITSELF,
    MOST_QUADS,
    quads_expected,
    require_no_ribbons,
    require_quads,
    wrong_volume,
)
from balloon_warp.mesh.fit import fitted, slabs_left
from balloon_warp.mesh.geometry import triangulate
from balloon_warp.mesh.mesh_distance import MeshDistance
from balloon_warp.mesh.orientation import oriented_outward
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.quiet import quiet_warp

MIN_CELLS, MAX_CELLS = 4, 256
TRIES, FINER = 3, 1.5
"""times that a surface is tried with more cells each time, where what comes of it is not faithful to it"""
CRUMB = 3.0
"""cells: a part is a crumb that no box has of more than that, which is what a speck of a cell and a half becomes"""


def remesh(mesh: PolygonMesh, cells: int, on_stage: Callable[[str], None] = lambda stage: None) -> PolygonMesh:
    """A closed quad mesh of a surface that may have holes, cracks, flipped faces and sheets without thickness.

    What the surface winds around becomes the inside. Holes are closed by a smooth membrane. Sheets become 1.5 cells
    thick, but what has an inside stays as thin as it is, and tips stay where they are. Crumbs are dropped. Every other
    part of the surface is there in one piece, which may take more cells. `warnings` says what was done. It runs on
    Warp's default device.

    Args:
        mesh: the surface; the result keeps its name, unit and up axis.
        cells: grid cells along the longest side of its bounding box, from 4 to 256. Edges are about a cell long.
        on_stage: told what is done, whenever something else begins; a mesh of 200,000 faces takes a minute.

    Raises:
        InputError: `cells` is out of range, the mesh has no size, it is of many ribbons, there would be too many quads,
            or more cells do not help either.
    """
    if not MIN_CELLS <= cells <= MAX_CELLS:
        raise InputError(f"cells must be from {MIN_CELLS} to {MAX_CELLS} (got {cells})")
    quiet_warp()
    used = mesh.points[np.unique(mesh.face_vertex_indices)]
    size = float(np.ptp(used, axis=0).max())
    if size == 0.0:
        raise InputError(f"{mesh.name}: all its vertices are at one place, expected a surface")
    on_stage("looking at the surface")
    require_quads(mesh, cells)
    require_no_ribbons(mesh)
    finer = [min(round(cells * FINER**power), MAX_CELLS) for power in range(1, TRIES)]
    number, mistake, wrong = cells, None, None
    for number in dict.fromkeys([cells, *(more for more in finer if quads_expected(mesh, more) < MOST_BY_ITSELF)]):
        quads, warnings = _quads(mesh, number, on_stage)
        on_stage("comparing them with the surface")
        mistake = infidelity(mesh, quads, size / number) or wrong_volume(mesh, quads)
        if mistake is None:
            more = [f"With {cells} cells {wrong}: {number} were taken."] if number > cells else []
            return replace(quads, warnings=(*mesh.warnings, *more, *warnings))
        wrong = wrong or mistake
    more = 2 * number
    finer_helps = more <= MAX_CELLS and quads_expected(mesh, more) < MOST_QUADS
    expected = f"--cells {more}, or a surface without that" if finer_helps else "a surface without that"
    raise InputError(f"{mesh.name}: with {number} cells {mistake}; expected {expected}")


def _quads(mesh: PolygonMesh, cells: int, on_stage: Callable[[str], None]) -> tuple[PolygonMesh, list[str]]:
    """A closed quad mesh of a surface, with so many cells, and what to say about it."""
    used = mesh.points[np.unique(mesh.face_vertex_indices)]
    lower, upper = used.min(axis=0), used.max(axis=0)
    middle, cell = 0.5 * (lower + upper), float((upper - lower).max()) / cells
    on_stage("looking for thin parts")
    triangles, _ = triangulate(oriented_outward(mesh))
    # In cells about the middle: Warp measures in float32.
    distance = MeshDistance((mesh.points - middle) / cell, triangles, thickness=1.0)
    # Half of a slab and its blend stand out of the box.
    reach = 0.5 * (upper - lower) / cell + 2.0
    on_stage(f"making quads of {cells} cells")
    nets = surface_nets(distance, -reach, reach, cell=1.0)
    if nets.face_count == 0:
        raise InputError(
            f"{mesh.name}: nothing of it is as thick as a cell ({cell:.3g}), expected more than {cells} cells"
        )
    kept, warnings = _without_crumbs(nets)
    used = (used - middle) / cell
    on_stage("fitting them to the surface")
    kept = fitted(kept, distance, used)
    if distance.has_thin_parts and slabs_left(kept, distance):
        warnings.append(
            f"Open parts became 1.5 cells thick ({1.5 * cell:.3g}), and thin ones where there is no room; more cells "
            "make them thinner."
        )
    placed = replace(
        mesh,
        points=kept.points * cell + middle,
        face_vertex_counts=kept.face_vertex_counts,
        face_vertex_indices=kept.face_vertex_indices,
        texture_coordinates=None,
        looks=None,
        groups={},
        stand_ins=None,
    )
    return placed, warnings


def _without_crumbs(mesh: PolygonMesh) -> tuple[PolygonMesh, list[str]]:
    """The components of the mesh that are worth keeping, and what to say about it; points are in cells."""
    edges = mesh_edges(mesh)
    labels = component_labels(mesh.vertex_count, edges.ends[:, 0], edges.ends[:, 1])
    lowest, highest = np.full((mesh.vertex_count, 3), np.inf), np.full((mesh.vertex_count, 3), -np.inf)
    np.minimum.at(lowest, labels, mesh.points)
    np.maximum.at(highest, labels, mesh.points)
    sizes = (highest - lowest).max(axis=1)  # minus infinity where no component has that number
    worth = sizes >= min(CRUMB, sizes.max())
    parts, crumbs = np.count_nonzero(worth), np.count_nonzero(~worth & (sizes >= 0.0))
    warnings = [f"It has {parts} separate parts."] if parts > 1 else []
    if crumbs:
        what = "1 crumb" if crumbs == 1 else f"{crumbs} crumbs"
        warnings.append(f"Left out {what} of less than {CRUMB:g} cells.")
    return _vertices_kept(mesh, worth[labels]), warnings


def _vertices_kept(mesh: PolygonMesh, keep: NDArray[np.bool_]) -> PolygonMesh:
    """The quad mesh without the components whose vertices are not kept."""
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    quads = (np.cumsum(keep) - 1)[quads[keep[quads[:, 0]]]].astype(np.int32)
    return replace(
        mesh,
        points=mesh.points[keep],
        face_vertex_counts=np.full(len(quads), 4, dtype=np.int32),
        face_vertex_indices=quads.ravel(),
    )

"""Preparation of a mesh for simulation: welding, holes, parts and winding."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from balloon_warp.mesh.copies import counted_once
from balloon_warp.mesh.defects import describe_defects
from balloon_warp.mesh.parts import Taken, of_vertices, parts_taken
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.repair import repaired
from balloon_warp.mesh.seams import open_seam, welded, welded_along_seams

Weld = bool | Literal["auto"] | float
Holes = Literal["cap", "keep"]
Parts = Literal["held", "free"]
LEAST_GAP, LARGEST_GAP = 1e-6, 0.1
"""Range of a weldable gap over the mesh's size"""


@dataclass(frozen=True)
class Treatment:
    """Treatment of a mesh's seams, holes and parts, as the scene's balloon gives it in fields of these names."""

    weld: Weld = "auto"
    """Weld open edges that coincide up to rounding, or up to a gap over the mesh's size; or all vertices that coincide
    exactly; or none"""
    holes: Holes = "cap"
    """Close holes in the surface, or keep them"""
    parts: Parts = "held"
    """Hold components together, or leave them free"""
    taken: Taken = "all"
    """Parts to take: all, those without a border, or the largest by area"""


def prepared(mesh: PolygonMesh, source: object, treatment: Treatment) -> PolygonMesh:
    """Return the mesh as it is simulated, with warnings of its defects and their treatment.

    Vertices keep their numbers; the springs that hold its parts are made later.

    A mesh of edges alone, faces of two corners, is a net of springs: it stays as it is.

    Raises:
        InputError: no face is left, or no part of those that are to be taken; it names `source`.
    """
    if mesh.face_count and mesh.face_vertex_counts.max() == 2:
        return mesh
    mesh = counted_once(mesh)
    if treatment.weld is True:
        mesh = welded(mesh)
    elif treatment.weld:
        mesh = welded_along_seams(mesh, 0.0 if treatment.weld == "auto" else treatment.weld)
    whole = repaired(mesh, source, treatment.holes)
    kept, left_out = parts_taken(whole, treatment.taken, source)
    whole, mesh = of_vertices(whole, kept), of_vertices(mesh, kept)
    seam = open_seam(mesh) if treatment.weld is not False else None
    told = [str(each) for each in (left_out, seam) if each]
    said = describe_defects(mesh, whole, treatment.parts, np.flatnonzero(~kept))
    return replace(whole, warnings=(*whole.warnings, *told, *said))

"""What a mesh is, and what is odd about it, before it becomes a balloon."""

from dataclasses import dataclass

import numpy as np

from balloon_warp.mesh.defects import describe_defects
from balloon_warp.mesh.geometry import signed_volume, total_area
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.repair import repaired
from balloon_warp.mesh.topology import (
    border_edges,
    component_count,
    genus,
    is_closed,
    is_manifold,
    mesh_edges,
    unused_vertices,
)
from balloon_warp.springs import build_springs


@dataclass(frozen=True)
class SpringCounts:
    """Springs of each kind."""

    structural: int
    shear: int
    flexion: int


@dataclass(frozen=True)
class MeshReport:
    """The report of `balloon-warp inspect`; its fields are the keys of the JSON."""

    vertices: int
    faces: int
    triangles: int
    quads: int
    ngons: int
    """faces of five corners or more"""
    springs: SpringCounts
    """of the balloon, once what `warnings` tells of is repaired"""
    closed: bool
    """no edge is on a border"""
    border_edges: int
    manifold: bool
    """no edge has more than two faces, and the faces at each vertex form one fan"""
    components: int
    genus: int | None
    """handles, summed over the components; None unless closed, manifold and orientable"""
    volume: float | None
    """in the file's unit cubed, negative where the faces wind inward; None unless closed"""
    area: float
    """in the file's unit squared"""
    unused_vertices: int
    """vertices of no face"""
    warnings: list[str]
    """for each kind of defect what there is and what is done about it, and what the reader had to say"""


def inspect_mesh(mesh: PolygonMesh, source: object = None) -> MeshReport:
    """Count, measure and check a mesh.

    Args:
        source: what a refusal names, such as its file; the mesh's name, when missing.

    Raises:
        InputError: no balloon can be made of its faces, see `repaired` and `build_springs`.
    """
    springs = build_springs(repaired(mesh, source or mesh.name))
    edges = mesh_edges(mesh)
    sizes = mesh.face_vertex_counts
    return MeshReport(
        vertices=mesh.vertex_count,
        faces=mesh.face_count,
        triangles=int(np.count_nonzero(sizes == 3)),
        quads=int(np.count_nonzero(sizes == 4)),
        ngons=int(np.count_nonzero(sizes > 4)),
        springs=SpringCounts(springs.structural_count, springs.shear_count, springs.flexion_count),
        closed=is_closed(edges),
        border_edges=len(border_edges(edges)),
        manifold=is_manifold(mesh, edges),
        components=component_count(mesh, edges),
        genus=genus(mesh, edges),
        volume=signed_volume(mesh) if is_closed(edges) else None,
        area=total_area(mesh),
        unused_vertices=len(unused_vertices(mesh)),
        warnings=[*mesh.warnings, *describe_defects(mesh)],
    )

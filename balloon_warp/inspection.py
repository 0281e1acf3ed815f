"""What a mesh is as a balloon, and what is odd about the one in the file."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from balloon_warp.mesh.geometry import signed_volume, total_area
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.mesh.topology import (
    border_edges,
    component_count,
    genus,
    is_closed,
    is_manifold,
    mesh_edges,
    unused_vertices,
    vertex_components,
)
from balloon_warp.springs.ties import balloon_springs


@dataclass(frozen=True)
class SpringCounts:
    """Springs of each kind, and those that hold parts together."""

    structural: int
    shear: int
    flexion: int
    holding: int
    """of the structural ones, those between parts that share no vertex"""


@dataclass(frozen=True)
class Figures:
    """What is counted and measured of a mesh."""

    vertices: int
    faces: int
    triangles: int
    quads: int
    ngons: int
    """faces of five corners or more"""
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


@dataclass(frozen=True)
class MeshReport(Figures):
    """The report of `balloon-warp inspect`; its fields are the keys of the JSON.

    The figures are those of the balloon: seams, faces, winding and holes are as a run has them.
    """

    springs: SpringCounts
    in_file: dict[str, Any]
    """the figures that are others in the file, by their names"""
    warnings: list[str]
    """for each kind of defect what there is and what is done about it, and what the reader had to say"""


def inspect_mesh(mesh: PolygonMesh, source: object = None, treatment: Treatment | None = None) -> MeshReport:
    """Count, measure and check a mesh, as it is and as it is simulated.

    Args:
        source: what a refusal names, such as its file; the mesh's name, when missing.
        treatment: what becomes of its seams, holes and parts; as in a scene that says nothing of them, when missing.

    Raises:
        InputError: no balloon can be made of its faces, see `prepared` and `build_springs`.
    """
    treatment = treatment or Treatment()
    whole = prepared(mesh, source or mesh.name, treatment)
    springs = balloon_springs(whole, treatment.parts)
    component = vertex_components(whole, mesh_edges(whole))
    simulated, in_file = _figures(whole), asdict(_figures(mesh))
    return MeshReport(
        **vars(simulated),
        springs=SpringCounts(
            springs.structural_count,
            springs.shear_count,
            springs.flexion_count,
            int(np.count_nonzero(np.diff(component[springs.pairs], axis=1))),
        ),
        in_file={name: value for name, value in in_file.items() if not _alike(value, getattr(simulated, name))},
        warnings=list(whole.warnings),
    )


def _figures(mesh: PolygonMesh) -> Figures:
    edges = mesh_edges(mesh)
    sizes = mesh.face_vertex_counts
    return Figures(
        vertices=mesh.vertex_count,
        faces=mesh.face_count,
        triangles=int(np.count_nonzero(sizes == 3)),
        quads=int(np.count_nonzero(sizes == 4)),
        ngons=int(np.count_nonzero(sizes > 4)),
        closed=is_closed(edges),
        border_edges=len(border_edges(edges)),
        manifold=is_manifold(mesh, edges),
        components=component_count(mesh, edges),
        genus=genus(mesh, edges),
        volume=signed_volume(mesh) if is_closed(edges) else None,
        area=total_area(mesh),
        unused_vertices=len(unused_vertices(mesh)),
    )


def _alike(first: Any, second: Any) -> bool:
    """Whether two figures are the same, but for what another order of a sum makes of them."""
    if isinstance(first, float) and isinstance(second, float):
        return bool(np.isclose(first, second, rtol=1e-9, atol=0.0))
    return first == second

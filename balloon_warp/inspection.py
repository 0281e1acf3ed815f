"""Properties of a mesh as a balloon, and defects of the mesh in the file."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from balloon_warp.arguments import checked
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
    """Number of structural springs between parts that share no vertex"""


@dataclass(frozen=True)
class Figures:
    """Counts and measures of a mesh."""

    vertices: int
    faces: int
    triangles: int
    quads: int
    ngons: int
    """Number of faces with five corners or more"""
    closed: bool
    """True where no edge is on a border"""
    border_edges: int
    manifold: bool
    """True where no edge has more than two faces, and the faces at each vertex form one fan"""
    components: int
    genus: int | None
    """Number of handles, summed over the components; None unless closed, manifold and orientable"""
    volume: float | None
    """Volume in the file's unit cubed, negative where the faces wind inward; None unless closed"""
    area: float
    """Area in the file's unit squared"""
    unused_vertices: int
    """Number of vertices without faces"""


@dataclass(frozen=True)
class MeshReport(Figures):
    """The report of `balloon-warp inspect`; its fields are the keys of the JSON.

    The figures are those of the balloon: seams, faces, winding and holes are as a run has them.
    """

    springs: SpringCounts
    in_file: dict[str, Any]
    """Figures of the mesh in the file that differ, by their names"""
    warnings: list[str]
    """Warnings: one for each kind of defect, with its treatment, and those of the reader"""


@checked
def inspect_mesh(mesh: PolygonMesh, source: object = None, treatment: Treatment | None = None) -> MeshReport:
    """Count, measure and check a mesh, as it is and as it is simulated.

    Args:
        source: Name of the mesh in errors, such as its file; its own name if not given.
        treatment: Treatment of its seams, holes and parts; a scene's default if not given.

    Raises:
        InputError: no balloon can be made of its faces, see `prepared` and `build_springs`.
    """
    treatment = treatment or Treatment()
    whole = prepared(mesh, mesh.name if source is None else source, treatment)
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
    """Return whether two figures are equal, up to the rounding of sums in another order."""
    if isinstance(first, float) and isinstance(second, float):
        return bool(np.isclose(first, second, rtol=1e-9, atol=0.0))
    return first == second

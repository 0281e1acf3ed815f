"""Properties of a mesh as a balloon: its stable step, its predicted volume, and its defects."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import ceil
from typing import Any

import numpy as np

from balloon_warp.kernels.laws import Law
from balloon_warp.mesh.load import Treatment, prepared
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    border_edges,
    component_count,
    genus,
    is_closed,
    is_manifold,
    mesh_edges,
    signed_volume,
    total_area,
    unused_vertices,
    vertex_components,
)
from balloon_warp.model import plan_model
from balloon_warp.model.plan import implausible_values
from balloon_warp.model.stability import Network, strain_bound_sentence
from balloon_warp.run.report import many_substeps_sentence
from balloon_warp.scene import SceneLike, scene_of
from balloon_warp.scene.load import override_scene
from balloon_warp.springs.even import balloon_springs
from balloon_warp.system.api import checked


@dataclass(frozen=True)
class StepAdvice:
    """The step part of `balloon-warp inspect`; its fields are keys of the JSON."""

    solver: str
    """Solver of the scene; "projective" is stable at any step, so that the limits are those of symplectic Euler"""
    stable_step: float
    """Longest stable step at the start [s], by the highest frequency of springs and masses"""
    least_substeps: int
    """Number of substeps in a frame at that step"""
    substeps: int
    """Number of substeps in a frame that "auto" chooses: with a margin, and for all changes during the simulation"""
    frames_per_second: float
    limiting_balloon: str
    """Balloon that needs the shortest step"""
    limiting_particle: int
    """Particle of that balloon whose springs are the stiffest for its mass, by the order of the file's vertices,
    counted from 0"""
    limiting_place: tuple[float, float, float]
    """Position of that particle at the start [m]"""
    limiting_body: int | None
    """Free body that needs that step instead, by the strings that are tied to it, by its index in the scene"""
    many_substeps: str | None
    """Sentence on the cause of many substeps of a mesh by itself, and its remedy; None if there are few"""
    strain_bound: str | None
    """Sentence on film that is softer than its material, and the substeps that this spares; None without such film"""
    doubts: tuple[str, ...]
    """Warnings of values that may be in another unit than intended, and of axes, as sentences"""


@checked
def advise_step(scene: SceneLike, laws: Sequence[Law] = ()) -> StepAdvice:
    """Find the stable step of a scene, even if the scene itself asks for too few substeps.

    Args:
        laws: User-defined laws beside the built-in ones, which count where they have bounds.

    Raises:
        InputError: the scene's meshes or particles are wrong, or no step would do.
    """
    scene = scene_of(scene)
    plan = plan_model(override_scene(scene, [("substeps", "auto")]), laws=laws)
    network = Network(plan.shapes, plan.held, plan.laws, plan.bodies)
    step = network.stable_step(plan.scene, plan.parameters)
    balloon, particle = network.limiting_particle(plan.scene, plan.parameters)
    shape = plan.shapes[balloon]
    x, y, z = shape.mesh.points[particle].tolist()
    return StepAdvice(
        solver=scene.solver,
        stable_step=step,
        least_substeps=max(ceil(1.0 / scene.frames_per_second / step), 1),
        substeps=plan.substeps,
        frames_per_second=scene.frames_per_second,
        limiting_balloon=shape.name,
        limiting_particle=particle,
        limiting_place=(x, y, z),
        limiting_body=network.limiting_body(plan.scene, plan.parameters),
        many_substeps=many_substeps_sentence(plan.scene, plan.shapes, plan.substeps),
        strain_bound=strain_bound_sentence(plan),
        doubts=tuple(implausible_values(plan.scene, plan.shapes, plan.parameters)),
    )


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

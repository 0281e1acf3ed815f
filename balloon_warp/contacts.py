"""What presses on what, on the host: the net force of each pair of things, on average over a frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.corners import corner_faces
from balloon_warp.mesh.geometry import face_vector_areas
from balloon_warp.model import Model
from balloon_warp.shown import Shown, described


@described
@dataclass(frozen=True, repr=False)
class Contact(Shown):
    """What a thing does to a balloon that it touches, on average over a frame."""

    balloon: str
    """its name"""
    other: str
    """the name of the other: an obstacle, a body or a balloon; "ground", or "sphere 0" """
    force: NDArray[np.float64]
    """on the balloon [N], shape (3,); on the other it is the opposite"""
    torque: NDArray[np.float64]
    """on the balloon, about the mean of its points [N m], shape (3,)"""
    area: float
    """of the balloon, that touches [m^2]"""
    pressure: float
    """the largest of any particle: its force over its part of the area [Pa]"""
    number: int
    """the balloon's, in the scene"""
    thing: int
    """the other's, among `things_of` the model"""

    def __repr__(self) -> str:
        force = ", ".join(f"{number:.3g}" for number in self.force)
        return f"Contact({self.other} on {self.balloon}: ({force}) N on {self.area:.3g} m^2)"


def things_of(model: Model) -> list[str]:
    """Name all that balloons may touch, in the order in which kernels number it: see `kernels.loops.contact_things`."""
    scene = model.scene
    kinds = (("obstacle", scene.obstacle), ("body", scene.body))
    named = {kind: [each.name or f"{kind} {number}" for number, each in enumerate(things)] for kind, things in kinds}
    spheres = [f"sphere {number}" for number in range(model.sphere_count)]
    return ["ground", *named["obstacle"], *spheres, *named["body"], *(shape.name for shape in model.shapes)]


def contacts_of(model: Model, points: NDArray[np.float32], pushes: NDArray[np.float32]) -> list[Contact]:
    """Add up what things did to balloons in a frame, of pairs that touched.

    Args:
        points: of all particles [m], shape (particle_count, 3).
        pushes: of each thing and particle the impulse [N s] and for how long they touched [s], shape (thing_count,
            particle_count, 4).
    """
    things, seconds = things_of(model), model.frame_seconds
    offsets, first = model.particle_offsets, len(things) - len(model.shapes)
    found = []
    for number, shape in enumerate(model.shapes):
        own = slice(offsets[number], offsets[number + 1])
        areas = vertex_areas(shape.mesh, points[own])
        center = points[own].mean(axis=0, dtype=np.float64)
        for thing, name in enumerate(things):
            told = pushes[thing, own].astype(np.float64)
            forces, arms = told[:, :3] / seconds, points[own] - center
            force, torque = forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)
            area = float(areas @ told[:, 3]) / seconds
            if thing >= first:  # a balloon, whose particles press this one's triangles
                its = slice(offsets[thing - first], offsets[thing - first + 1])
                back = pushes[first + number, its].astype(np.float64)
                force -= back[:, :3].sum(axis=0) / seconds
                torque -= np.cross(points[its] - center, back[:, :3]).sum(axis=0) / seconds
                told = told if told[:, 3].any() else back
                area = max(
                    area, float(vertex_areas(model.shapes[thing - first].mesh, points[its]) @ back[:, 3]) / seconds
                )
            if told[:, 3].any():
                strengths = np.linalg.norm(forces, axis=1)
                pressure = float((strengths / np.maximum(areas, 1e-30))[areas > 0.0].max(initial=0.0))
                found.append(Contact(shape.name, name, force, torque, area, pressure, number, thing))
    return found


def vertex_areas(mesh: PolygonMesh, points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Share each face's area out among its corners [m^2], shape (vertex_count,)."""
    placed = PolygonMesh(points.astype(np.float64), mesh.face_vertex_counts, mesh.face_vertex_indices)
    areas = np.linalg.norm(face_vector_areas(placed), axis=1) / np.maximum(mesh.face_vertex_counts, 1)
    return np.asarray(np.bincount(mesh.face_vertex_indices, areas[corner_faces(mesh)], len(points)), dtype=np.float64)

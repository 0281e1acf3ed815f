"""A model with its particles in another order, so that the threads of a warp have as many springs each.

Otherwise a warp takes as long as its particle with the most springs.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.model import Model
from balloon_warp.schedules.spring_ends import SpringEnds


def order_by_springs(model: Model, ends: SpringEnds) -> NDArray[np.int64]:
    """Return the particles of each balloon by their number of springs of each kind."""
    structural, shear, flexion = ends.by_kind.T
    return np.lexsort([flexion, shear, structural, model.particle_balloon.numpy()])


def renumbered(model: Model, order: NDArray[np.int64]) -> Model:
    """Return the model whose particle at each place is that of the order, shape (particle_count,).

    Particles of a balloon must stay together. Only the shapes' meshes take that order: membranes and hinges do not.
    """
    places = np.argsort(order)
    offsets = np.asarray(model.particle_face_offsets.numpy(), dtype=np.int64)
    around = np.split(np.asarray(model.particle_faces.numpy()), offsets[1:-1])
    shapes = []
    for shape, first in zip(model.shapes, model.particle_offsets, strict=False):
        mesh = shape.mesh
        own = order[first : first + mesh.vertex_count] - first
        indices = np.argsort(own)[mesh.face_vertex_indices].astype(mesh.face_vertex_indices.dtype)
        shapes.append(replace(shape, mesh=replace(mesh, points=mesh.points[own], face_vertex_indices=indices)))

    def array(like: wp.array, values: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=like.dtype, device=model.device)

    def of_particles(values: wp.array) -> wp.array:
        return array(values, values.numpy()[order]) if values.size else values

    def to_particles(particles: wp.array) -> wp.array:
        numbers = np.asarray(particles.numpy(), dtype=np.int64)
        return array(particles, places[numbers].astype(np.int32)) if particles.size else particles

    return replace(
        model,
        shapes=shapes,
        initial_points=of_particles(model.initial_points),
        particle_mass_share=of_particles(model.particle_mass_share),
        particle_face_offsets=array(model.particle_face_offsets, np.cumsum([0, *(len(around[p]) for p in order)])),
        particle_faces=array(model.particle_faces, np.concatenate([around[p] for p in order])),
        face_particles=to_particles(model.face_particles),
        spring_particles=to_particles(model.spring_particles),
        string_particle=to_particles(model.string_particle),
        driven=model.driven._replace(particles=places[model.driven.particles]),
        neck_weights=of_particles(model.neck_weights),
        neck_edges=to_particles(model.neck_edges),
    )

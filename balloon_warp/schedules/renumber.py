"""The same model with its particles in another order: the threads of a warp then have as many springs as each other,
and none waits for another's."""

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.model import Model
from balloon_warp.schedules.banks import spread_over_lanes
from balloon_warp.schedules.rings import quad_rings
from balloon_warp.schedules.spring_ends import SpringEnds, neighbors_in_slots


def order_by_springs(model: Model, ends: SpringEnds) -> NDArray[np.int64]:
    """The particles of each balloon by how many springs of each kind they have; those of a warp so that their neighbors
    are read from different banks of shared memory."""
    structural, shear, flexion = ends.by_kind.T
    order = np.lexsort([flexion, shear, structural, model.particle_balloon.numpy()])
    if model.balloon_count > 1 or not model.spring_count:
        return order  # a warp may have particles of two balloons, which must stay together
    ring = quad_rings(model)
    slots = [neighbors_in_slots(ends, kind) for kind in range(3)]
    if ring is not None:
        slots[:2] = ring
    return spread_over_lanes(order, np.concatenate(slots))


def renumbered(model: Model, order: NDArray[np.int64]) -> Model:
    """The model in which the particle at each place is that of the order, shape (particle_count,).

    Particles of a balloon must stay together. Of the shapes, the meshes alone are in that order.
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
        return array(values, values.numpy()[order])

    def to_particles(particles: wp.array) -> wp.array:
        return (
            array(particles, places[np.asarray(particles.numpy(), dtype=np.int64)].astype(np.int32))
            if particles.size
            else particles
        )

    return replace(
        model,
        shapes=shapes,
        initial_points=of_particles(model.initial_points),
        particle_mass_share=of_particles(model.particle_mass_share),
        particle_face_offsets=array(model.particle_face_offsets, np.cumsum([0, *(len(around[p]) for p in order)])),
        particle_faces=array(model.particle_faces, np.concatenate([around[p] for p in order])),
        face_particles=to_particles(model.face_particles),
        spring_particles=to_particles(model.spring_particles),
        membrane_corners=to_particles(model.membrane_corners),
        string_particle=to_particles(model.string_particle),
        neck_weights=of_particles(model.neck_weights) if model.neck_weights.size else model.neck_weights,
        neck_edges=to_particles(model.neck_edges),
    )

"""The faces around a particle, each of which may have a force that its corners share."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.areas import face_measures
from balloon_warp.kernels.memory import int_at, vector_at
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.tables import Tables


@cache
def face_push(features: Features, at: Any, velocity_at: Any) -> Any:
    """Return the function for the force on a corner of a face."""
    laws, read_numbers = features.laws_on("face"), numbers_reader(features.columns)
    center_of_face, area_vector_of_face = face_measures(at)
    moving = features.needs("face", "velocity")

    @wp.func
    def push_at_corner(t: Tables, points: Any, velocities: Any, world: wp.int32, face: wp.int32, time: float):
        """Return one corner's share of the force on a face [N]; zero where it is torn."""
        if wp.static(features.bursts):
            if t.membranes.wear.tears.gone[world, face] == wp.int8(1):
                return wp.vec3()
        begin = int_at(t.faces.offsets, face)
        end = int_at(t.faces.offsets, face + 1)
        corners = float(end - begin)
        center = center_of_face(t.faces, points, face)
        velocity = wp.vec3()
        if wp.static(moving):
            for corner in range(begin, end):
                velocity += velocity_at(velocities, int_at(t.faces.particles, corner)) / corners
        area_vector = area_vector_of_face(t.faces, points, face, center)
        n = read_numbers(t, world, int_at(t.faces.balloon, face))
        return laws(center, area_vector, velocity, t.up, t.step_seconds, time, n) / corners

    return push_at_corner


@wp.func
def visits_of(t: Tables, face: wp.int32, particle: wp.int32):
    """Return how many corners of a face are a particle."""
    visits = float(0.0)
    for corner in range(int_at(t.faces.offsets, face), int_at(t.faces.offsets, face + 1)):
        if int_at(t.faces.particles, corner) == particle:
            visits += 1.0
    return visits


@cache
def visits_function(features: Features) -> Any:
    """Return the function for how often a face visits a particle around which it is: once, but for folded ones."""

    @wp.func
    def one_visit(t: Tables, face: wp.int32, particle: wp.int32):
        return float(1.0)

    return visits_of if features.revisits else one_visit


@cache
def push_of_faces_function(features: Features) -> Any:
    """Return the function that sums the forces of faces."""
    visits = visits_function(features)

    @wp.func
    def push_of_faces(t: Tables, face_pushes: Any, particle: wp.int32):
        """Return the net force of the faces around a particle [N], each of which has found its corners' share."""
        force = wp.vec3()
        begin = int_at(t.faces.particle_offsets, particle)
        for incidence in range(begin, int_at(t.faces.particle_offsets, particle + 1)):
            face = int_at(t.faces.around_particles, incidence)
            force += visits(t, face, particle) * vector_at(face_pushes, face)
        return force

    return push_of_faces


@cache
def face_loop(features: Features, at: Any, velocity_at: Any) -> Any:
    """Return the function that finds the forces of its faces on a particle, and sums them."""
    push_at_corner, visits = face_push(features, at, velocity_at), visits_function(features)

    @wp.func
    def find_push_of_faces(t: Tables, points: Any, velocities: Any, world: wp.int32, particle: wp.int32, time: float):
        """Return the net force of the faces around a particle [N]."""
        force = wp.vec3()
        for incidence in range(t.faces.particle_offsets[particle], t.faces.particle_offsets[particle + 1]):
            face = t.faces.around_particles[incidence]
            force += visits(t, face, particle) * push_at_corner(t, points, velocities, world, face, time)
        return force

    return find_push_of_faces

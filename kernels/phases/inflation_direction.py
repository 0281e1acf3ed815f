"""Aim of the paper's normal force on a particle, (A_p / A_total) n, once the faces have been measured."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.directions import directions_backwards
from balloon_warp.kernels.algebra import length_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.inflation import inflation_direction_of
from balloon_warp.kernels.loops.areas import area_vector_between, face_measures
from balloon_warp.kernels.loops.inflation_directions import direction_loop, direction_loop_of_eight
from balloon_warp.kernels.memory import quad_at
from balloon_warp.kernels.phase import Look, phase


def _by_normal_forces(features: Features) -> bool:
    return features.inflation_directions


def _cached(features: Features) -> bool:
    """Return whether a frame keeps the directions from its beginning, as the paper does."""
    return not features.fresh_normals


@phase(
    "face",
    {"face_center": wp.vec3, "face_area": wp.vec3},
    when=_by_normal_forces,
    once=_cached,
    adjoint=directions_backwards,
)
def measure(features: Features, look: Look) -> Any:
    """Measure the center of a face [m], and its area times its unit normal [m^2]."""
    center_of_face, area_vector_of_face = face_measures(look.at)

    @wp.func
    def measure(t: Any, points: Any, face: Any):
        center = center_of_face(t.faces, points, face)
        return center, area_vector_of_face(t.faces, points, face, center)

    return measure


@phase("face", {"balloon_area": float}, when=_by_normal_forces, once=_cached, sums=True, adjoint=directions_backwards)
def extend(features: Features, look: Look) -> Any:
    """Sum the area of a balloon [m^2]."""

    @wp.func
    def extend(face_area: Any):
        return length_of(face_area)

    return extend


@phase("particle", {"inflation_direction": wp.vec3}, when=_by_normal_forces, once=_cached, adjoint=directions_backwards)
def find_direction(features: Features, look: Look) -> Any:
    """Find where a normal force pushes a particle: (A_p / A_total) n."""
    direction_of_particle = direction_loop_of_eight(look.at) if look.world else direction_loop(look.at)

    @wp.func
    def find_direction(t: Any, face_centers: Any, face_areas: Any, particle: Any, point: Any, balloon_area: Any):
        return direction_of_particle(t.faces, face_centers, face_areas, particle, point, balloon_area)

    return find_direction


@phase("face", {"balloon_area": float}, when=_by_normal_forces, once=_cached, sums=True)
def spread(features: Features, look: Look) -> Any:
    """Sum the area of a balloon [m^2], from where its corners are."""
    center_of_face, area_vector_of_face = face_measures(look.at)

    @wp.func
    def spread_quads(t: Any, points: Any, face: wp.int32):
        return wp.length(area_vector_between(points, quad_at(t.faces.particles, face)))

    @wp.func
    def spread(t: Any, points: Any, face: wp.int32):
        return wp.length(area_vector_of_face(t.faces, points, face, center_of_face(t.faces, points, face)))

    return spread_quads if features.quads else spread


@phase("particle", {"inflation_direction": wp.vec3}, when=_by_normal_forces, once=_cached)
def turn(features: Features, look: Look) -> Any:
    """Find where a normal force pushes a particle, from A_p n: (A_p / A_total) n."""

    @wp.func
    def turn(vertex_normal: wp.vec3, balloon_area: float):
        return inflation_direction_of(vertex_normal, balloon_area)

    return turn

"""Aim of the paper's normal force on a particle, (A_p / A_total) n, once the faces have been measured."""

from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import length_of
from balloon_warp.kernels.laws.inflation import aim_of
from balloon_warp.kernels.loops.aims import aim_loop, aim_loop_of_eight
from balloon_warp.kernels.loops.areas import area_vector_between, face_measures
from balloon_warp.kernels.memory import quad_at
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.traits import Traits


def _aims(traits: Traits) -> bool:
    return traits.aims


def _cached(traits: Traits) -> bool:
    """Return whether a frame keeps the aims from its beginning, as the paper does."""
    return not traits.fresh_normals


@phase("face", {"face_center": wp.vec3, "face_area": wp.vec3}, when=_aims, once=_cached)
def measure(traits: Traits, look: Look) -> Any:
    """Measure the center of a face [m], and its area times its unit normal [m^2]."""
    center_of_face, area_vector_of_face = face_measures(look.at)

    @wp.func
    def measure(t: Any, points: Any, face: Any):
        center = center_of_face(t.faces, points, face)
        return center, area_vector_of_face(t.faces, points, face, center)

    return measure


@phase("face", {"balloon_area": float}, when=_aims, once=_cached, sums=True)
def extend(traits: Traits, look: Look) -> Any:
    """Sum the area of a balloon [m^2]."""

    @wp.func
    def extend(face_area: Any):
        return length_of(face_area)

    return extend


@phase("particle", {"aim": wp.vec3}, when=_aims, once=_cached)
def take_aim(traits: Traits, look: Look) -> Any:
    """Find where a normal force pushes a particle: (A_p / A_total) n."""
    aim_of_particle = aim_loop_of_eight(look.at) if look.world else aim_loop(look.at)

    @wp.func
    def take_aim(t: Any, face_centers: Any, face_areas: Any, particle: Any, point: Any, balloon_area: Any):
        return aim_of_particle(t.faces, face_centers, face_areas, particle, point, balloon_area)

    return take_aim


@phase("face", {"balloon_area": float}, when=_aims, once=_cached, sums=True)
def spread(traits: Traits, look: Look) -> Any:
    """Sum the area of a balloon [m^2], from where its corners are."""
    center_of_face, area_vector_of_face = face_measures(look.at)

    @wp.func
    def spread_quads(t: Any, points: Any, face: wp.int32):
        return wp.length(area_vector_between(points, quad_at(t.faces.particles, face)))

    @wp.func
    def spread(t: Any, points: Any, face: wp.int32):
        return wp.length(area_vector_of_face(t.faces, points, face, center_of_face(t.faces, points, face)))

    return spread_quads if traits.quads else spread


@phase("particle", {"aim": wp.vec3}, when=_aims, once=_cached)
def turn(traits: Traits, look: Look) -> Any:
    """Find where a normal force pushes a particle, from A_p n: (A_p / A_total) n."""

    @wp.func
    def turn(facing: wp.vec3, balloon_area: float):
        return aim_of(facing, balloon_area)

    return turn

"""Membranes face by face, where each is measured once for all of its corners."""

from typing import Any

import warp as wp

from balloon_warp.kernels.loops.net_force import net_force_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


def _has_membranes(traits: Traits) -> bool:
    return bool(traits.membranes)


@phase("world", when=_has_membranes, once=lambda traits: True)
def clear(traits: Traits, look: Look) -> Any:
    """Clear the unused entries of particles that have fewer faces than others."""
    return look.films(traits).clear


@phase("film", when=_has_membranes)
def stretch(traits: Traits, look: Look) -> Any:
    """Measure a face, and store its forces at its corners."""
    if look.films(traits).keeps:
        return look.films(traits).stretch
    stretch_face = look.films(traits).stretch

    @wp.func
    def stretch(t: Tables, world: wp.int32, film: wp.int32, points: Any, pulls: Any, area_vectors: Any):
        stretch_face(t, world, film, points, points, pulls, area_vectors)

    @wp.func
    def stretch_by_velocities(
        t: Tables, world: wp.int32, film: wp.int32, points: Any, velocities: Any, pulls: Any, area_vectors: Any
    ):
        stretch_face(t, world, film, points, velocities, pulls, area_vectors)

    return stretch_by_velocities if traits.viscous else stretch


@phase("particle", {"skin": Any}, when=_has_membranes)
def collect(traits: Traits, look: Look) -> Any:
    """Sum the forces of its faces on a particle."""
    return look.films(traits).collect


@phase("particle", {"force": wp.vec3, "area_vector": wp.vec3}, when=_has_membranes)
def pull_with_skin(traits: Traits, look: Look) -> Any:
    """Sum the forces on a particle [N], and where it is needed find its area vector [m^2]."""
    net_force = net_force_function(traits, look.loops(traits))

    @wp.func
    def pull_with_skin(t: Tables, points: Any, own: Any, skin: Any, point: wp.vec3, velocity: wp.vec3, time: float):
        force, area_vector, _facing = net_force(t, points, points, own, skin, point, velocity, time)
        return force, area_vector

    @wp.func
    def pull_by_velocities(
        t: Tables,
        points: Any,
        velocities: Any,
        own: Any,
        skin: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        force, area_vector, _facing = net_force(t, points, velocities, own, skin, point, velocity, time)
        return force, area_vector

    return pull_by_velocities if traits.looks_at_velocities else pull_with_skin

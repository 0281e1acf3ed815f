"""Detection of places that no particle or sphere can have, where places are written."""

from typing import Any

import warp as wp

HEALTHY = 2**31 - 1
"""Marker: no particle or sphere of a world is bad"""


@wp.struct
class HealthTable:
    """Limits of distance, squared [m^2]."""

    near: float
    """Distance from the world's origin within which nothing is bad"""
    reach: float
    """Limit of the distance from the world's origin"""
    spans: wp.array[float]
    """Limit of the distance between two particles of a balloon"""
    origins: wp.array[wp.int32]
    """Particle of each balloon from which the others' distances are measured"""
    partners: wp.array[wp.int32]
    """Particle from which the distance of that particle is measured"""


@wp.func
def is_past(vector: wp.vec3, squared_limit: float):
    """Return whether a vector is longer than a limit, or not finite.

    As unsigned integers, NaN and infinities exceed every float; compilers that assume finite numbers leave this alone.
    """
    return wp.cast(wp.length_sq(vector), wp.uint32) > wp.cast(squared_limit, wp.uint32)


@wp.func
def look_at_particle(
    health: HealthTable,
    first_bad: wp.array[wp.int32],
    world: wp.int32,
    particle: wp.int32,
    number: wp.int32,
    balloon: wp.int32,
    mass_share: float,
    points: Any,
):
    """Lower the world's entry to the particle's number in the model if the particle is bad.

    It is bad if it is too far from its balloon's origin, or is that origin and too far from the world's or from its
    partner. Most particles are near, which takes no memory to see. A particle without mass stays where it is.
    """
    point = points[particle]
    if is_past(point, health.near):
        if mass_share > 0.0:
            other = health.origins[balloon]
            bad = bool(False)
            if particle == other:
                other = health.partners[balloon]
                bad = is_past(point, health.reach)
            if bad or is_past(point - points[other], health.spans[balloon]):
                wp.atomic_min(first_bad, world, number)


@wp.func
def look_at_sphere(
    health: HealthTable,
    first_bad: wp.array[wp.int32],
    world: wp.int32,
    particle_count: wp.int32,
    sphere: wp.int32,
    position: wp.vec3,
):
    """Lower the world's entry to the sphere, numbered after the particles, if that is bad."""
    if is_past(position, health.reach):
        wp.atomic_min(first_bad, world, particle_count + sphere)

"""What is no place for a particle or a sphere, found where places are written."""

from typing import Any

import warp as wp

HEALTHY = 2**31 - 1
"""no particle or sphere of a world is bad"""


@wp.struct
class HealthTable:
    """How far is too far, in squares [m^2]."""

    near: float
    """from the world's origin: no balloon or sphere is bad whose parts are all nearer"""
    reach: float
    """from the world's origin"""
    spans: wp.array[float]
    """from one particle of a balloon to another"""
    origins: wp.array[wp.int32]
    """of each balloon the particle that the others' spans are taken from"""
    partners: wp.array[wp.int32]
    """and the one that its own span is taken from"""


@wp.func
def is_past(vector: wp.vec3, squared_limit: float):
    """Whether a vector is longer than a limit, or none. As numbers without a sign, NaN and infinities are past every
    float; compilers that count on there being none leave this alone."""
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
    """Lower the world's entry to the particle's number in the model if that is bad: too far from its balloon's origin,
    or itself that origin and too far from the world's or from its partner. Most are near, which takes no memory to see.
    A particle without mass stays where it is."""
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

"""What is no place for a particle or a sphere, found where places are written."""

import warp as wp

from balloon_warp.kernels.tables import BodyTable

HEALTHY = 2**31 - 1
"""no particle or sphere of a world is bad"""


@wp.struct
class HealthTable:
    """How far is too far."""

    origins: wp.array[wp.int32]
    """of each balloon the particle that the others' spans are taken from"""
    squared_spans: wp.array[float]
    """of each balloon [m^2]"""
    squared_reach: float
    """from the world's origin [m^2]"""


@wp.func
def is_past(vector: wp.vec3, squared_limit: float):
    """Whether a vector is longer than a limit, or none. As numbers without a sign, NaN and infinities are past every
    float; compilers that count on there being none leave this alone."""
    return wp.cast(wp.length_sq(vector), wp.uint32) > wp.cast(squared_limit, wp.uint32)


@wp.func
def look_along(
    bodies: BodyTable,
    first_bad: wp.array[wp.int32],
    world: wp.int32,
    particle: wp.int32,
    vector: wp.vec3,
    squared_limit: float,
):
    """Lower the world's entry to the particle if a vector to it is past a limit. One without mass stays where it is."""
    if is_past(vector, squared_limit):
        if bodies.mass_share[particle] > 0.0:
            wp.atomic_min(first_bad, world, particle)


@wp.func
def look_at_particle(
    bodies: BodyTable,
    health: HealthTable,
    first_bad: wp.array[wp.int32],
    world: wp.int32,
    balloon: wp.int32,
    particle: wp.int32,
    point: wp.vec3,
    origin: wp.vec3,
):
    """Lower the world's entry to the particle if that is bad. The balloon's `origin` may not be past the reach, other
    particles not past a span from there."""
    look_along(bodies, first_bad, world, particle, point - origin, health.squared_spans[balloon])
    if particle == health.origins[balloon]:
        look_along(bodies, first_bad, world, particle, point, health.squared_reach)


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
    if is_past(position, health.squared_reach):
        wp.atomic_min(first_bad, world, particle_count + sphere)

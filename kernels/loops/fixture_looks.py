"""Cached distances of a particle to obstacles.

Distances are 1-Lipschitz: one query bounds how far the particle may move without another. A particle on one of many
obstacles is checked against this one alone, as long as the others are out of its path.
"""

import warp as wp

from balloon_warp.kernels.laws.fixture import FAR_AWAY
from balloon_warp.kernels.memory import four_in, two_in
from balloon_warp.kernels.tables import Tables

SURELY = wp.constant(0.999)
"""Fraction of a distance that is safe from rounding"""


@wp.func
def is_free(t: Tables, world: wp.int32, particle: wp.int32, time: float, end: wp.vec3):
    """Return whether no obstacle is in a particle's path, by the cached query."""
    seen = four_in(t.fixtures.looks, world, particle)
    return wp.length(end - wp.vec3(seen[0], seen[1], seen[2])) + t.fixtures.fastest * time < seen[3]


@wp.func
def nearest_alone(t: Tables, world: wp.int32, particle: wp.int32, time: float, end: wp.vec3):
    """Return the nearest obstacle, and the clearance from all others [m]: positive if only that one may be met."""
    if t.fixtures.nearest.shape[1] == 0:
        return 0, FAR_AWAY  # there is one obstacle
    seen = four_in(t.fixtures.looks, world, particle)
    noted = two_in(t.fixtures.nearest, world, particle)
    gone = wp.length(end - wp.vec3(seen[0], seen[1], seen[2])) + t.fixtures.fastest * time
    return wp.int32(noted[0]), noted[1] - gone


@wp.func
def note_look(
    t: Tables,
    world: wp.int32,
    particle: wp.int32,
    time: float,
    free: float,
    nearest: wp.int32,
    beyond: float,
    point: wp.vec3,
):
    """Cache the clearance of a particle at the end of its path, the nearest obstacle, and that of all others [m]."""
    gone = t.fixtures.fastest * time
    t.fixtures.looks[world, particle] = wp.vec4(point[0], point[1], point[2], SURELY * free + gone)
    if t.fixtures.nearest.shape[1] > 0:
        t.fixtures.nearest[world, particle] = wp.vec2(float(nearest), SURELY * beyond + gone)


@wp.func
def forget_look(t: Tables, world: wp.int32, particle: wp.int32):
    """Clear the cached query of a particle, before another path in the same step."""
    t.fixtures.looks[world, particle] = wp.vec4()
    if t.fixtures.nearest.shape[1] > 0:
        t.fixtures.nearest[world, particle] = wp.vec2()

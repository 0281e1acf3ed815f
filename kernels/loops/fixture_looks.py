"""Cached distances of a particle to obstacles.

Distances are 1-Lipschitz: one query bounds how far the particle may move without another.
"""

import warp as wp

from balloon_warp.kernels.memory import four_in
from balloon_warp.kernels.tables import Tables

SURELY = wp.constant(0.999)
"""Fraction of a distance that is safe from rounding"""


@wp.func
def is_free(t: Tables, world: wp.int32, particle: wp.int32, time: float, end: wp.vec3):
    """Return whether no obstacle is in a particle's path, by the cached query."""
    seen = four_in(t.fixtures.looks, world, particle)
    return wp.length(end - wp.vec3(seen[0], seen[1], seen[2])) + t.fixtures.fastest * time < seen[3]


@wp.func
def note_look(t: Tables, world: wp.int32, particle: wp.int32, time: float, free: float, point: wp.vec3):
    """Cache the clearance of a particle at the end of its path [m]."""
    t.fixtures.looks[world, particle] = wp.vec4(point[0], point[1], point[2], SURELY * free + t.fixtures.fastest * time)


@wp.func
def forget_look(t: Tables, world: wp.int32, particle: wp.int32):
    """Clear the cached query of a particle, before another path in the same step."""
    t.fixtures.looks[world, particle] = wp.vec4()

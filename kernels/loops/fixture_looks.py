"""Cached distances of a particle to obstacles.

Distances are 1-Lipschitz: one query bounds how far the particle may move without another query of any obstacle, or of
any but the nearest.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.fixture import FAR_AWAY
from balloon_warp.kernels.memory import four_in, two_in
from balloon_warp.kernels.tables import Tables

SURELY = wp.constant(0.999)
"""Fraction of a distance that is safe from rounding"""


@wp.struct
class Look:
    """Clearances around a particle at some obstacles, in a step that ends at a time."""

    first: wp.int32  # from this one
    last: wp.int32  # up to, not with, this one
    nearest: wp.int32
    free: float  # how far that is, at least [m]
    beyond: float  # how far the others are, at least [m]


@wp.func
def gone_since(t: Tables, seen: wp.vec4, time: float, place: wp.vec3):
    """Return how much nearer a particle and the obstacles may have come since the cached query [m]."""
    return wp.length(place - wp.vec3(seen[0], seen[1], seen[2])) + t.fixtures.fastest * time


@wp.func
def is_free(t: Tables, world: wp.int32, particle: wp.int32, time: float, end: wp.vec3):
    """Return whether no obstacle is in a particle's path, by the cached query."""
    seen = four_in(t.fixtures.looks, world, particle)
    return gone_since(t, seen, time, end) < seen[3]


@wp.func
def forget_look(t: Tables, world: wp.int32, particle: wp.int32):
    """Clear the cached query of a particle, before another path in the same step."""
    t.fixtures.looks[world, particle] = wp.vec4()
    if t.fixtures.nearest.shape[1] > 0:
        t.fixtures.nearest[world, particle] = wp.vec2()


@cache
def look_functions(several: bool) -> tuple[Any, Any, Any]:
    """Return the functions that begin a query of obstacles, update it with one, and cache its result.

    Args:
        several: whether there is more than one.
    """

    @wp.func
    def begin_look(t: Tables, world: wp.int32, particle: wp.int32, time: float, start: wp.vec3, end: wp.vec3):
        """Begin a query of the obstacles that may be in a particle's path; often none."""
        look = Look()
        look.last = t.fixtures.solids.shape[0]
        look.free = FAR_AWAY
        look.beyond = FAR_AWAY
        seen = four_in(t.fixtures.looks, world, particle)
        gone = gone_since(t, seen, time, end)
        if gone < seen[3]:
            look.last = 0
        elif wp.static(several):
            nearest = two_in(t.fixtures.nearest, world, particle)
            if gone + wp.length(end - start) + t.fixtures.fastest * t.step_seconds < nearest[0]:
                look.first = wp.int32(nearest[1])
                look.last = look.first + 1
        return look

    @wp.func
    def look_at(look: Look, fixture: wp.int32, free: float):
        """Update a query with the distance to one obstacle [m]."""
        if wp.static(several):
            if free < look.free:
                look.beyond = look.free
                look.nearest = fixture
            else:
                look.beyond = wp.min(look.beyond, free)
        look.free = wp.min(look.free, free)
        return look

    @wp.func
    def note_look(
        t: Tables, world: wp.int32, particle: wp.int32, time: float, look: Look, end: wp.vec3, point: wp.vec3
    ):
        """Cache a query from the end of a particle's path, which is at a given point now.

        If one obstacle alone was queried, the previous query bounds the others.
        """
        passes = t.fixtures.fastest * time
        free = SURELY * look.free + passes
        if wp.static(several):
            beyond = SURELY * (look.beyond - wp.length(point - end)) + passes
            if look.last - look.first < t.fixtures.solids.shape[0]:
                seen = t.fixtures.looks[world, particle]
                gone = wp.length(point - wp.vec3(seen[0], seen[1], seen[2]))
                beyond = t.fixtures.nearest[world, particle][0] - gone / SURELY
            free = wp.min(free, beyond)
            t.fixtures.nearest[world, particle] = wp.vec2(beyond, float(look.nearest))
        t.fixtures.looks[world, particle] = wp.vec4(point[0], point[1], point[2], free)

    return begin_look, look_at, note_look

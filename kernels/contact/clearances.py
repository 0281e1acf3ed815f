"""Clearances of a balloon that touches itself: where a particle or an edge need not search.

A search looks farther than it has to, and keeps how far away the nearest is that a particle or an edge may touch. Until
its own way since then, and that of whatever moved most, have used that up, nothing can be near: a search would find
nothing, and is left out. So results stay the same to the bit, whatever has been left out before.
"""

import warp as wp

from balloon_warp.kernels.contact.boxes import MOVED, PACE, SPEED, has_strayed
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working

LOOKOUT = wp.constant(5.0)
"""Distance by which a search looks farther than it has to, over a balloon's slack"""
ROUNDED = wp.constant(0.999)
"""Fraction of a clearance that is safe from rounding"""


@wp.func
def lookout_of(t: Tables, balloon: wp.int32):
    """Return the distance that a search looks farther than it has to [m]."""
    return LOOKOUT * t.touch.slack[balloon]


@wp.func
def clearance_left(working: Working, world: wp.int32, balloon: wp.int32, clearance: float, moved: float):
    """Return the rest of a clearance [m].

    Args:
        moved: Distance that its owner has moved since it was found [m].
    """
    return ROUNDED * clearance - moved - working.balloon_boxes[world, balloon, PACE][MOVED]


@wp.func
def fastest_of(working: Working, world: wp.int32, balloon: wp.int32):
    """Return the highest speed of a balloon's particles [m/s]."""
    return working.balloon_boxes[world, balloon, PACE][SPEED]


@wp.func
def pays_to_look_out(t: Tables, working: Working, world: wp.int32, balloon: wp.int32):
    """Return whether a balloon is so slow that clearances last longer than to the next search."""
    return 2.0 * t.touch.seconds * fastest_of(working, world, balloon) < lookout_of(t, balloon)


@wp.func
def pad_with_lookout(t: Tables, working: Working, world: wp.int32, balloon: wp.int32, pad: float):
    """Return the distance within which a balloon's boxes are looked into, which contain their ways [m]."""
    if pays_to_look_out(t, working, world, balloon):
        return pad + 2.0 * t.touch.seconds * fastest_of(working, world, balloon) + lookout_of(t, balloon)
    return pad


@wp.func
def is_clear_of_own(
    t: Tables, working: Working, world: wp.int32, balloon: wp.int32, item: wp.int32, clearances: wp.array2d[float],
    moved: float, speed: float, pad: float,
):  # fmt: skip
    """Return whether a particle or an edge cannot touch its own balloon until the next search, by its clearance.

    Args:
        moved: Distance that it has moved since the last search [m].
        speed: Its speed [m/s].
        pad: Distance at which it is near [m].
    """
    left = clearance_left(working, world, balloon, clearances[world, item], moved)
    if has_strayed(working, world, balloon):
        clearances[world, item] = left
    return left > pad + t.touch.seconds * (speed + fastest_of(working, world, balloon))


@wp.func
def keep_clearance(working: Working, world: wp.int32, balloon: wp.int32, particle: wp.int32, distance: float):
    """Keep a particle's distance from triangles of its balloon that it may touch [m], if that is where it is now."""
    working.clearances[world, particle] = wp.where(has_strayed(working, world, balloon), distance, 0.0)

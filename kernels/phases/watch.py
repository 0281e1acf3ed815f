"""Watch over a free frame: whether a particle moves farther than assumed."""

from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import squared_length, times
from balloon_warp.kernels.contact.free_frames import HURRIED
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import all_positive
from balloon_warp.kernels.memory import fixed_float_at, put_int_unless
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


def _is_free(features: Features) -> bool:
    return features.watched


@phase("particle", {"start": wp.vec3}, when=_is_free)
def set_off(features: Features, look: Look) -> Any:
    """Store a particle's position at the begin of its substep."""

    @wp.func
    def set_off(point: Any):
        return point

    return set_off


def _hurries(features: Features, look: Look) -> Any:
    if not look.world:  # of one particle it is asked as fast
        return None

    @wp.func
    def is_faster(t: Any, way: Any, start: Any, point: Any):
        """Return whether any particle of eight may be faster than allowed, with a margin."""
        most = times(way, way) * (0.999 / (float(t.substeps) * float(t.substeps)))
        return not all_positive(most - squared_length(point - start))

    return is_faster


@phase("particle", when=_is_free, rare=_hurries)
def watch(features: Features, look: Look) -> Any:
    """Mark a world with a particle faster than assumed: its frame does not hold."""

    @wp.func
    def watch(t: Tables, working: Working, world: wp.int32, start: wp.vec3, point: wp.vec3):
        way = fixed_float_at(working.ways, world)
        substeps = float(t.substeps)
        stays = substeps * substeps * wp.length_sq(point - start) < way * way  # not if it is no number
        put_int_unless(stays, working.verdicts, world, HURRIED)
        put_int_unless(stays, working.any_busy, 0, 1)

    return watch

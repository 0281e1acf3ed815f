"""Bounding boxes of balloons swept until the next search: pairs that may touch, and the work on them."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.meeting import skin_functions
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import any_in_block
from balloon_warp.kernels.working import Working

wp.set_module_options(OPTIONS)

LOWER, UPPER, PACE = wp.constant(0), wp.constant(1), wp.constant(2)
"""Rows of a box"""
SPEED, STRAYED, MOVED = wp.constant(0), wp.constant(1), wp.constant(2)
"""Entries of `PACE`: the highest speed [m/s], whether a particle has strayed, see `Sweep`, and the longest way that one
has moved since it was looked for [m]"""
APART, WAS_NEAR, ARE_NEAR, STILL_NEAR = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
"""Work in a world: none, clear the lists of near balloons, search, or reuse the last lists"""
ALONE, KNOWN, LOOKS = wp.constant(0), wp.constant(1), wp.constant(2)
"""Work of a balloon's particles: none, since no balloon is near; reuse their last lists; or search"""
SPARE = wp.constant(0.25)
"""Fraction of a balloon's slack that its particles may move before a new search. Another balloon may move as much, and
both as much before as after one of them was searched; so half of the slack is left for their way by
acceleration"""


@wp.struct
class Sweep:
    """Bounds on particles until the next search."""

    lower: wp.vec3  # corners of the box around it [m]
    upper: wp.vec3
    fastest: float  # square of the highest speed [m^2/s^2]
    strayed: float  # the longest way from where a particle was looked for to where it will be [m]
    moved: float  # the longest way from there to where it is [m]


@wp.func
def sweep_of(
    t: Tables,
    balloon: wp.int32,
    first: wp.int32,
    step: wp.int32,
    points: wp.array[wp.vec3],
    velocities: wp.array[wp.vec3],
    sought: wp.array[wp.vec3],
):
    """Return the bounds on every n-th particle of a balloon.

    Args:
        sought: Positions at the last search [m].
    """
    sweep = Sweep()
    sweep.lower = wp.vec3(1.0e30)
    sweep.upper = wp.vec3(-1.0e30)
    for particle in range(t.particles.offsets[balloon] + first, t.particles.offsets[balloon + 1], step):
        here = points[particle]
        way = t.touch.seconds * velocities[particle]
        sweep.lower = wp.min(sweep.lower, wp.min(here, here + way))
        sweep.upper = wp.max(sweep.upper, wp.max(here, here + way))
        sweep.fastest = wp.max(sweep.fastest, wp.length_sq(velocities[particle]))
        moved = wp.length(here - sought[particle])
        sweep.strayed = wp.max(sweep.strayed, moved + wp.length(way))
        sweep.moved = wp.max(sweep.moved, moved)
    return sweep


@wp.func
def is_known(working: Working, world: wp.int32):
    """Return whether the lists of near balloons are valid."""
    before = working.near_balloons[world, working.balloon_boxes.shape[1]]
    return before >= ARE_NEAR


@wp.func
def put_sweep(t: Tables, working: Working, world: wp.int32, balloon: wp.int32, sweep: Sweep, is_first: bool):
    """Store the bounds of a balloon's particles.

    Args:
        is_first: Whether a frame begins, with a state that may be another's.
    """
    strayed = is_first or not is_known(working, world) or sweep.strayed > SPARE * t.touch.slack[balloon]
    working.balloon_boxes[world, balloon, LOWER] = sweep.lower
    working.balloon_boxes[world, balloon, UPPER] = sweep.upper
    working.balloon_boxes[world, balloon, PACE] = wp.vec3(
        wp.sqrt(sweep.fastest), wp.where(strayed, 1.0, 0.0), sweep.moved
    )


@wp.kernel(enable_backward=False)
def box_balloons(
    # model
    t: Tables,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    is_first: wp.int32,
    # in and out
    working: Working,
):
    """Compute the bounds that the particles of a balloon sweep until the next search; a block a (world, balloon)."""
    world, balloon, thread = wp.tid()
    own = sweep_of(t, balloon, thread, wp.block_dim(), points[world], velocities[world], working.sought[world])
    sweep = Sweep()
    x = wp.tile_min(wp.tile(own.lower[0]))[0]
    y = wp.tile_min(wp.tile(own.lower[1]))[0]
    z = wp.tile_min(wp.tile(own.lower[2]))[0]
    sweep.lower = wp.vec3(x, y, z)
    x = wp.tile_max(wp.tile(own.upper[0]))[0]
    y = wp.tile_max(wp.tile(own.upper[1]))[0]
    z = wp.tile_max(wp.tile(own.upper[2]))[0]
    sweep.upper = wp.vec3(x, y, z)
    sweep.fastest = wp.tile_max(wp.tile(float(own.fastest)))[0]
    sweep.strayed = wp.tile_max(wp.tile(float(own.strayed)))[0]
    sweep.moved = wp.tile_max(wp.tile(float(own.moved)))[0]
    if thread == 0:
        put_sweep(t, working, world, balloon, sweep, is_first == 1)


@wp.func
def boxes_meet(lower: wp.vec3, upper: wp.vec3, other_lower: wp.vec3, other_upper: wp.vec3, pad: float):
    """Return whether two boxes are within a distance in each direction [m]."""
    gap = wp.max(lower - other_upper, other_lower - upper)
    return wp.max(gap) <= pad


@wp.func
def squared_distance_to_box(point: wp.vec3, lower: wp.vec3, upper: wp.vec3):
    """Return the squared distance of a point to a box [m^2]."""
    return wp.length_sq(wp.max(wp.max(lower - point, point - upper), wp.vec3()))


@cache
def pad_function(features: Features) -> Any:
    """Return the function for the distance at which particles and triangles of two balloons are near [m].

    The distance excludes their own ways.
    """
    thickness_between, _ = skin_functions(features)

    @wp.func
    def pad_between(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
        return thickness_between(t, world, first, second) + t.touch.slack[first] + t.touch.slack[second]

    return pad_between


@cache
def nearing_function(features: Features) -> Any:
    """Return the function that returns whether a particle may touch a balloon until the next search."""
    pad_between = pad_function(features)

    @wp.func
    def is_nearing(
        t: Tables,
        working: Working,
        world: wp.int32,
        balloon: wp.int32,
        other: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
    ):
        """Return whether a particle may come near another balloon, by the box that the balloon sweeps."""
        end = point + t.touch.seconds * velocity
        lower = working.balloon_boxes[world, other, LOWER]
        upper = working.balloon_boxes[world, other, UPPER]
        pad = pad_between(t, world, balloon, other)
        return boxes_meet(wp.min(point, end), wp.max(point, end), lower, upper, pad)

    return is_nearing


@wp.func
def has_strayed(working: Working, world: wp.int32, balloon: wp.int32):
    """Return whether a balloon's particles may have moved farther than its lists allow."""
    return working.balloon_boxes[world, balloon, PACE][STRAYED] > 0.0


@wp.func
def decide(working: Working, world: wp.int32, near: bool, strayed: bool):
    """Decide the work in a world, and clear lists where others will be made.

    Args:
        near: Whether any of its balloons are near each other.
        strayed: Whether any balloon has strayed.
    """
    now = wp.where(is_known(working, world), WAS_NEAR, APART)
    if near:
        now = wp.where(strayed, ARE_NEAR, STILL_NEAR)
    if now != STILL_NEAR:
        for which in range(working.list_lengths.shape[1]):
            working.list_lengths[world, which] = 0
    working.near_balloons[world, working.balloon_boxes.shape[1]] = now


@cache
def meet_kernel(features: Features) -> Any:
    """Return the kernel that finds the balloons that may touch, and the work that this asks for."""
    pad_between = pad_function(features)

    @wp.func
    def meet(t: Tables, working: Working, world: wp.int32, balloon: wp.int32):
        """Record the balloons that one may touch, and return the work of its particles."""
        count = wp.int32(0)
        strayed = has_strayed(working, world, balloon)
        lower = working.balloon_boxes[world, balloon, LOWER]
        upper = working.balloon_boxes[world, balloon, UPPER]
        for other in range(working.balloon_boxes.shape[1]):
            near = bool(wp.static(features.touches_itself))
            if other != balloon:
                other_lower = working.balloon_boxes[world, other, LOWER]
                other_upper = working.balloon_boxes[world, other, UPPER]
                near = boxes_meet(lower, upper, other_lower, other_upper, pad_between(t, world, balloon, other))
            if near:
                working.neighbors[world, balloon, count] = other
                count += 1
                strayed = strayed or has_strayed(working, world, other)
        working.neighbor_counts[world, balloon] = count
        return wp.where(count > 0, wp.where(strayed, LOOKS, KNOWN), ALONE)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def meet_balloons(
        # model
        t: Tables,
        # in and out
        working: Working,
    ):
        """Find the balloons that may touch; a block a world."""
        world, thread = wp.tid()
        near = bool(False)
        strayed = bool(False)
        for balloon in range(thread, working.balloon_boxes.shape[1], wp.block_dim()):
            does = meet(t, working, world, balloon)
            working.near_balloons[world, balloon] = does
            near = near or does != ALONE
            strayed = strayed or has_strayed(working, world, balloon)
        any_near = any_in_block(near)
        any_strayed = any_in_block(strayed)
        if thread == 0:
            decide(working, world, any_near, any_strayed)

    return meet_balloons


@wp.func
def is_searched(working: Working, world: wp.int32):
    """Return whether there are lists to make, or to clear."""
    what = working.near_balloons[world, working.balloon_boxes.shape[1]]
    return what > APART and what < STILL_NEAR

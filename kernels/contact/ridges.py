"""Contact of faces and edges of balloons with ridges of obstacles, bodies and spheres, see `laws.ridges`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.contact.kind import Kind, list_contact
from balloon_warp.kernels.contact.ridge_poses import Placed, placing_function
from balloon_warp.kernels.contact.ridge_search import corners_of, near_in, ridge_search_function, start_in
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import Ridge, way_to_part
from balloon_warp.kernels.loops.fixtures import friction_on
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working

SETTLED = wp.constant(0.02)
"""Fraction of the distance to ridges by which features may come nearer in a substep"""


@wp.func
def ridge_contact(placed: Placed, ridge: Ridge, feature: wp.vec4i, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the contact of a feature and a ridge of a solid.

    Args:
        a: corner of the feature, relative to the solid, as are b and c.
    """
    contact = Contact()
    near = near_in(placed, ridge, feature, a, b, c)
    contact.kept = placed.kept
    contact.weights = wp.vec4(near.weights[0], near.weights[1], near.weights[2], 0.0)
    contact.gap = near.gap
    contact.overlap = way_to_part(near.gap, placed.kept)
    if wp.length_sq(near.normal) > 0.0:
        contact.normal = wp.quat_rotate(placed.turn, near.normal)
        inside = near.weights[0] * a + near.weights[1] * b + near.weights[2] * c
        contact.arm = wp.quat_rotate(placed.turn, inside)
        contact.moving = placed.velocity + wp.cross(placed.spin, contact.arm)
    return contact


@cache
def contact_function(features: Features) -> Any:
    """Return the function that measures a pair as a substep begins."""
    place_of = placing_function(features)

    @wp.func
    def contact_of(
        t: Tables, state: WorldState, working: Working, world: wp.int32, number: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return the contact of a pair that is near: feature, ridge and solid."""
        pair = working.ridge_pairs[world, number]
        feature = t.ridges.features[pair[0]]
        placed = place_of(t, state, working, world, pair[2], end)
        ends = wp.vec4i(feature[0], corners_of(feature, 1), corners_of(feature, 2), feature[0])
        a = start_in(t, placed, ends[0], points, velocities)
        b = start_in(t, placed, ends[1], points, velocities)
        c = start_in(t, placed, ends[2], points, velocities)
        contact = ridge_contact(placed, t.ridges.ridges[pair[1]], feature, a, b, c)
        contact.ends = ends
        contact.pair = number
        contact.solid = pair[2]
        contact.left = SETTLED * t.ridges.kept
        if wp.length_sq(contact.normal) > 0.0:
            contact.friction = friction_on(t, world, t.particles.balloon[ends[0]], placed.thing)
        return contact

    return contact_of


@cache
def listing_function(features: Features, backwards: bool) -> Any:
    """Return the function that lists pairs that may meet in a substep, see `kind.Kind`."""
    search_ridges, contact_of = ridge_search_function(features), contact_function(features)

    @wp.func
    def list_ridges(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        near, way = search_ridges(t, state, working, world, thread, end, points, velocities)
        overlaps = bool(False)
        for number in range(thread, near, wp.block_dim()):
            contact = contact_of(t, state, working, world, number, end, points, velocities)
            if wp.length_sq(contact.normal) > 0.0 and contact.gap < contact.kept + way:
                overlaps = list_contact(working, world, contact) or overlaps
        return overlaps

    return list_ridges


RIDGES = Kind(lambda features: features.ridges, listing_function, 24)
"""Faces and edges of balloons beside ridges of solids; particles leave the ground and obstacles after them"""

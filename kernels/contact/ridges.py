"""Contact of faces and edges of balloons with ridges of obstacles, bodies and spheres, see `laws.touch`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import LOWER, UPPER, squared_distance_to_box
from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.contact.kind import Kind, list_contact
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.rigid import spin_of, turned_by
from balloon_warp.kernels.laws.touch import Ridge, edge_near, face_near, separating_shift
from balloon_warp.kernels.loops.bodies import body_mass
from balloon_warp.kernels.loops.fixtures import (
    friction_on,
    number_of_body,
    number_of_obstacle,
    number_of_sphere,
    pose_function,
)
from balloon_warp.kernels.tables import Tables, WorldState, sphere_radius
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import OF_RIDGES, Working, request_capacity


@wp.struct
class Placed:
    """A solid as a substep begins."""

    center: wp.vec3
    turn: wp.quat
    velocity: wp.vec3
    spin: wp.vec3  # [rad/s]
    reach: float  # of its farthest point [m]
    thing: wp.int32  # its number, as friction has it
    radius: float  # of a sphere, around its ridge, which is its center [m]
    kept: float  # distance that faces keep [m]


@wp.func
def body_of(t: Tables, solid: wp.int32):
    """Return the body that a solid is, or -1."""
    body = solid - t.fixtures.solids.shape[0]
    return wp.where(body < t.bodies.solids.shape[0], body, -1)


@wp.func
def sphere_of(t: Tables, solid: wp.int32):
    """Return the sphere that a solid is; below 0 if it is none."""
    return solid - t.fixtures.solids.shape[0] - t.bodies.solids.shape[0]


@cache
def placing_function(features: Features) -> Any:
    """Return the function for the pose of a solid with ridges: obstacles are first, then bodies, then spheres."""
    pose_at = pose_function(features) if features.fixtures else None

    @wp.func
    def place_of(t: Tables, state: WorldState, working: Working, world: wp.int32, number: wp.int32, end: float):
        """Return the pose of a solid in a substep that ends at a time."""
        placed = Placed()
        placed.kept = t.ridges.kept
        fixtures = t.fixtures.solids.shape[0]
        if wp.static(features.fixtures):
            if number < fixtures:
                pose = pose_at(t, world, number, end)
                placed.center = pose.center - t.step_seconds * pose.velocity
                placed.turn = turned_by(pose.turn, -t.step_seconds * pose.spin)
                placed.velocity = pose.velocity
                placed.spin = pose.spin
                placed.reach = t.fixtures.solids[number].reach
                placed.thing = number_of_obstacle(number)
        if wp.static(features.bodies > 0):
            body = body_of(t, number)
            if body >= 0:
                placed.center = working.body_starts[world, body]
                placed.turn = working.body_start_turns[world, body]
                placed.velocity = state.body_velocities[world, body]
                mass = body_mass(t, world, body)
                placed.spin = spin_of(
                    placed.turn, t.bodies.inverse_inertias[body], mass, state.body_momenta[world, body]
                )
                placed.reach = t.bodies.solids[body].reach
                placed.thing = number_of_body(t, body)
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, number)
            if sphere >= 0:
                placed.center = working.sphere_starts[world, sphere]
                placed.turn = wp.quat_identity()
                placed.thing = number_of_sphere(t, sphere)
                placed.radius = sphere_radius(t.spheres, world, sphere)
                if placed.radius > 0.0:
                    placed.velocity = state.sphere_velocities[world, sphere]
                placed.kept = 0.0  # as particles
        return placed

    return place_of


FAR_OFF = wp.constant(1.0e18)
"""Distance beyond all others [m]"""
FAST = wp.constant(2.0)
"""Least number of substeps that a search is valid for, at the highest speed"""
LASTING, FARTHEST, DENSE = wp.constant(12.0), wp.constant(4.0), wp.constant(512)
"""Number of substeps that a search lasts where it need look no farther for that than some usual distances, and there
are fewer ridges than that: of a mesh of many, too many pairs would be near"""


@wp.func
def corners_of(feature: wp.vec4i, corner: wp.int32):
    """Return a feature's particles; an edge has its first again in place of a third."""
    return wp.where(feature[corner] < 0, feature[0], feature[corner])


@wp.func
def start_of(t: Tables, particle: wp.int32, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3]):
    """Return the position of a particle at the begin of the substep [m]."""
    return points[particle] - t.step_seconds * velocities[particle]


@wp.func
def seen_from(placed: Placed, place: wp.vec3):
    """Return a place relative to a solid."""
    return wp.quat_rotate_inv(placed.turn, place - placed.center)


@wp.func
def start_in(t: Tables, placed: Placed, particle: wp.int32, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3]):
    """Return the position of a particle at the begin of the substep, relative to a solid."""
    return seen_from(placed, start_of(t, particle, points, velocities))


@wp.func
def near_line(ridge: Ridge, feature: wp.vec4i, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the closest points of a balloon's feature and a ridge."""
    if feature[2] < 0:
        return edge_near(ridge, a, b)
    return face_near(ridge, a, b, c)


@wp.func
def near_in(placed: Placed, ridge: Ridge, feature: wp.vec4i, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the closest points of a balloon's feature and a ridge of a solid, which may be a sphere."""
    near = near_line(ridge, feature, a, b, c)
    near.gap -= placed.radius
    return near


@wp.func
def note_pair(working: Working, world: wp.int32, feature: wp.int32, ridge: wp.int32, solid: wp.int32):
    """Append a feature and a ridge of a solid to the list of pairs."""
    place = wp.atomic_add(working.ridge_counts, world, 1)
    if place < working.ridge_pairs.shape[1]:
        working.ridge_pairs[world, place] = wp.vec3i(feature, ridge, solid)
    else:
        request_capacity(working, world, OF_RIDGES, place + 1, 1)


@wp.func
def note_if_near(
    t: Tables, working: Working, world: wp.int32, number: wp.int32, index: wp.int32, solid: wp.int32, placed: Placed,
    within: float, a: wp.vec3, b: wp.vec3, c: wp.vec3,
):  # fmt: skip
    """Note a ridge of a solid if it is near a feature."""
    feature = t.ridges.features[number]
    ridge = t.ridges.ridges[index]
    near = near_in(placed, ridge, feature, a, b, c)
    # one that is above a side of the solid now may come beside it before the next search
    if near.gap < within and (feature[2] < 0 or ridge.tips != 0):
        note_pair(working, world, number, index, solid)


@wp.func
def box_around(thread: wp.int32, points: wp.array[wp.vec3]):
    """Return the lower and the upper corner of the box around all particles [m], by all threads of a block."""
    low = wp.vec3(FAR_OFF)
    high = wp.vec3(-FAR_OFF)
    for particle in range(thread, points.shape[0], wp.block_dim()):
        low = wp.min(low, points[particle])
        high = wp.max(high, points[particle])
    x = wp.tile_min(wp.tile(low[0]))[0]
    y = wp.tile_min(wp.tile(low[1]))[0]
    z = wp.tile_min(wp.tile(low[2]))[0]
    lower = wp.vec3(x, y, z)
    x = wp.tile_max(wp.tile(high[0]))[0]
    y = wp.tile_max(wp.tile(high[1]))[0]
    z = wp.tile_max(wp.tile(high[2]))[0]
    return lower, wp.vec3(x, y, z)


@wp.func
def apart_from(t: Tables, solid: wp.int32, placed: Placed, low: wp.vec3, high: wp.vec3):
    """Lower bound of a box's distance from a solid's ridges [m]."""
    half = 0.5 * (high - low)
    x = wp.quat_rotate_inv(placed.turn, wp.vec3(half[0], 0.0, 0.0))
    y = wp.quat_rotate_inv(placed.turn, wp.vec3(0.0, half[1], 0.0))
    z = wp.quat_rotate_inv(placed.turn, wp.vec3(0.0, 0.0, half[2]))
    around = wp.abs(x) + wp.abs(y) + wp.abs(z)
    middle = seen_from(placed, 0.5 * (low + high))
    lower = t.ridges.boxes[solid, LOWER] - around
    return wp.sqrt(squared_distance_to_box(middle, lower, t.ridges.boxes[solid, UPPER] + around)) - placed.radius


@wp.func
def list_near_ridges(
    t: Tables, working: Working, world: wp.int32, number: wp.int32, solid: wp.int32, placed: Placed, within: float,
    way: float, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
):  # fmt: skip
    """List the ridges of a solid near a feature, and return the least distance to them [m].

    Args:
        way: the farthest that anything moves in the substep [m].
    """
    feature = t.ridges.features[number]
    is_round = placed.radius > 0.0
    if is_round and feature[2] < 0:  # a sphere meets an edge as a side of a face
        return float(FAR_OFF)
    a = points[corners_of(feature, 0)]
    b = points[corners_of(feature, 1)]
    c = points[corners_of(feature, 2)]
    low = wp.min(wp.min(a, b), c)
    high = wp.max(wp.max(a, b), c)
    middle = seen_from(placed, 0.5 * (low + high))
    squared = squared_distance_to_box(middle, t.ridges.boxes[solid, LOWER], t.ridges.boxes[solid, UPPER])
    apart = wp.sqrt(squared) - placed.radius - 0.5 * wp.length(high - low) - way  # as the substep begins
    if apart < within:
        first = t.ridges.ends[solid][0]
        a = start_in(t, placed, corners_of(feature, 0), points, velocities)
        b = start_in(t, placed, corners_of(feature, 1), points, velocities)
        c = start_in(t, placed, corners_of(feature, 2), points, velocities)
        if is_round:
            note_if_near(t, working, world, number, first, solid, placed, within, a, b, c)
        else:
            lower = wp.min(wp.min(a, b), c)
            upper = wp.max(wp.max(a, b), c)
            pad = wp.vec3(within, within, within)
            query = wp.bvh_query_aabb(t.ridges.trees[solid], lower - pad, upper + pad)
            found = wp.int32(0)
            while wp.bvh_query_next(query, found):
                note_if_near(t, working, world, number, first + found, solid, placed, within, a, b, c)
    return apart


@wp.func
def have_changed(t: Tables, working: Working, world: wp.int32):
    """Test for spheres that appeared, or changed their radius, since the last search."""
    changed = bool(False)
    for sphere in range(working.ridge_radii.shape[1]):
        radius = sphere_radius(t.spheres, world, sphere)
        changed = changed or radius != working.ridge_radii[world, sphere]
    return changed


@cache
def ridge_search_function(features: Features) -> Any:
    """Return the function that keeps the list of features and ridges that are near each other."""
    place_of = placing_function(features)

    @wp.func
    def has_ridges(t: Tables, world: wp.int32, solid: wp.int32):
        """Return whether a solid has ridges, and is there: a sphere may come later."""
        has = t.ridges.ends[solid][1] > t.ridges.ends[solid][0]
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, solid)
            if has and sphere >= 0:
                has = sphere_radius(t.spheres, world, sphere) > 0.0
        return has

    @wp.func
    def fastest_of_thread(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return the highest speed among the items of a thread [m/s]."""
        squared = float(0.0)
        for particle in range(thread, velocities.shape[0], wp.block_dim()):
            squared = wp.max(squared, wp.length_sq(velocities[particle]))
        fastest = wp.sqrt(squared)
        solids = float(t.fixtures.fastest)
        for number in range(t.fixtures.solids.shape[0], t.ridges.ends.shape[0]):
            placed = place_of(t, state, working, world, number, end)
            solids = wp.max(solids, wp.length(placed.velocity) + placed.reach * wp.length(placed.spin))
        return fastest + solids

    @wp.func
    def search_ridges(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return the number of near pairs in a substep and the largest distance moved in it [m].

        The substep ends at a given time.
        """
        mine = fastest_of_thread(t, state, working, world, thread, end, velocities)
        way = t.step_seconds * wp.tile_max(wp.tile(mine))[0]
        left = working.ridge_budgets[world] - way
        if have_changed(t, working, world):
            left = float(0.0)
        block_barrier()
        if left < way:
            margin = wp.max(t.ridges.margin, FAST * way)
            if t.ridges.ridges.shape[0] < DENSE:
                margin = wp.max(margin, wp.min(LASTING * way, FARTHEST * t.ridges.margin))
            if thread == 0:
                working.ridge_counts[world] = 0
                for sphere in range(working.ridge_radii.shape[1]):
                    working.ridge_radii[world, sphere] = sphere_radius(t.spheres, world, sphere)
            block_barrier()
            apart = float(FAR_OFF)
            low, high = box_around(thread, points)
            spread = wp.vec3(way, way, way)
            for solid in range(t.ridges.ends.shape[0]):
                if has_ridges(t, world, solid):
                    placed = place_of(t, state, working, world, solid, end)
                    within = margin + t.ridges.kept
                    of_all = apart_from(t, solid, placed, low - spread, high + spread)
                    count = wp.where(of_all < within, t.ridges.features.shape[0], 0)
                    if count == 0:
                        apart = wp.min(apart, of_all)
                    for number in range(thread, count, wp.block_dim()):
                        found = list_near_ridges(
                            t, working, world, number, solid, placed, within, way, points, velocities
                        )
                        apart = wp.min(apart, found)
            nearest = wp.tile_min(wp.tile(apart))[0]
            left = wp.max(margin, nearest - t.ridges.kept)
            block_barrier()
        if thread == 0:
            working.ridge_budgets[world] = left
        block_barrier()
        return wp.min(working.ridge_counts[world], working.ridge_pairs.shape[1]), way

    return search_ridges


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
    contact.overlap = separating_shift(near.gap, placed.kept)
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

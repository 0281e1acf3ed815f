"""Contact of sharp edges of balloons, see `laws.edges`, and of particles that would come through triangles.

The spring between a particle and a triangle, see `laws.touch`, may let it through. A search now and then finds pairs
that are near each other.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.contact import NONE, Contact
from balloon_warp.kernels.contact.ends import four_of
from balloon_warp.kernels.contact.kind import Kind, list_contact
from balloon_warp.kernels.contact.list_lengths import PAIRS, SUBSTEPS
from balloon_warp.kernels.contact.triangles import side_of, triangle_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import FOUR, KEPT, couples_of, crosses, crossing_of, way_to_part, weights_of
from balloon_warp.kernels.loops.fixtures import friction_of_balloons
from balloon_warp.kernels.loops.meeting import place_beside, skin_functions
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_warp, block_barrier
from balloon_warp.kernels.working import Working

AHEAD = wp.constant(2.0)
"""Number of substeps ahead in which edges at their speeds would touch, so that they count as near in this one"""
SETTLED = wp.constant(0.01)
"""Fraction of the distance that edges keep by which they may come nearer in a substep, left to the next one"""
SAFE = wp.constant(0.2)
"""Fraction of a small distance by which edges may come nearer"""


@wp.func
def of_balloons(normal: wp.vec3, gap: float, thickness: float):
    """Return a contact of balloons a gap apart along a normal, where they keep a part of the thickness."""
    contact = Contact()
    contact.solid = NONE
    contact.normal = normal
    contact.gap = gap
    contact.kept = KEPT * thickness
    contact.left = wp.min(SETTLED * contact.kept, SAFE * gap)
    contact.overlap = way_to_part(gap, contact.kept)
    return contact


@wp.func
def edge_contact(before: FOUR, thickness: float, friction: float):
    """Return the contact of two edges, by the places of their ends."""
    crossing = crossing_of(before[0], before[1], before[2], before[3])
    contact = of_balloons(crossing.normal, crossing.gap, thickness)
    contact.weights = weights_of(crossing.parts)
    if crosses(crossing):
        contact.friction = friction
        first, other = couples_of(crossing)
        contact.couple = first
        contact.other_couple = other
    return contact


@wp.func
def particle_contact(before: FOUR, thickness: float):
    """Return the contact of a triangle and a particle, by the places of the corners and the particle.

    Friction is that of the spring between them.
    """
    place = place_beside(before[3], before[0], before[1], before[2])
    contact = of_balloons(wp.normalize(place.arm), wp.sqrt(place.squared), thickness)
    contact.weights = wp.vec4(-place.weights[0], -place.weights[1], -place.weights[2], 1.0)
    return contact


@wp.func
def clear_substeps(t: Tables, balloon: wp.int32, other: wp.int32, gap: float, kept: float, fastest: float):
    """Return the number of substeps after this one in which two edges of balloons cannot touch yet.

    They may come nearer as fast as they do now, and by as much acceleration as lists allow for.

    Args:
        fastest: Largest speed of a point of one relative to one of the other [m/s].
    """
    way = t.step_seconds * fastest
    gain = (t.touch.slack[balloon] + t.touch.slack[other]) * t.step_seconds / t.touch.seconds
    return int(wp.max(gap - 2.0 * kept - AHEAD * way, 0.0) / (way + gain))


@wp.func
def may_touch(t: Tables, contact: Contact, moving: FOUR):
    """Return whether two edges may touch in this substep."""
    speed = wp.length(contact.weights * moving)
    near = contact.gap < 2.0 * contact.kept + AHEAD * t.step_seconds * speed
    return near and wp.length_sq(contact.normal) > 0.0


@cache
def contact_function(features: Features) -> Any:
    """Return the function that measures two edges, or a particle and a triangle, as a substep begins."""
    thickness_between, _ = skin_functions(features)

    @wp.func
    def edges_of_pair(
        t: Tables, world: wp.int32, first: wp.int32, second: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return two edges at the start of the substep, whether they may touch in it, and for how many more not."""
        own = t.touch.edges[first]
        other = t.touch.edges[second]
        ends = wp.vec4i(own[0], own[1], other[0], other[1])
        moving = four_of(velocities, ends)
        before = four_of(points, ends) - t.step_seconds * moving
        balloon = t.particles.balloon[own[0]]
        beside = t.particles.balloon[other[0]]
        friction = friction_of_balloons(t, world, balloon, beside)
        contact = edge_contact(before, thickness_between(t, world, balloon, beside), friction)
        contact.ends = ends
        fastest = wp.max(
            wp.max(wp.length(moving[0] - moving[2]), wp.length(moving[0] - moving[3])),
            wp.max(wp.length(moving[1] - moving[2]), wp.length(moving[1] - moving[3])),
        )
        clear = clear_substeps(t, balloon, beside, contact.gap, contact.kept, fastest)
        return contact, may_touch(t, contact, moving), clear

    @wp.func
    def particle_of_pair(
        t: Tables, world: wp.int32, particle: wp.int32, candidate: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return the same of a particle and a triangle.

        One that is behind the triangle already, and to be pushed out of it, is let through.
        """
        corners = t.touch.triangles[triangle_of(candidate)]
        ends = wp.vec4i(corners[0], corners[1], corners[2], particle)
        moving = four_of(velocities, ends)
        before = four_of(points, ends) - t.step_seconds * moving
        own = t.particles.balloon[particle]
        other = t.particles.balloon[corners[0]]
        contact = particle_contact(before, thickness_between(t, world, own, other))
        contact.ends = ends
        area_vector = wp.cross(before[1] - before[0], before[2] - before[0])
        is_right = other == own or side_of(candidate) * wp.dot(contact.normal, area_vector) >= 0.0
        fastest = wp.max(
            wp.max(wp.length(moving[0] - moving[3]), wp.length(moving[1] - moving[3])),
            wp.length(moving[2] - moving[3]),
        )
        clear = clear_substeps(t, own, other, contact.gap, contact.kept, fastest)
        return contact, is_right and may_touch(t, contact, moving), clear

    @wp.func
    def contact_of(
        t: Tables, working: Working, world: wp.int32, pair: wp.vec2i, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return a listed pair at the start of the substep, whether it may touch in it, and for how many more not."""
        if pair[0] >= 0:
            return edges_of_pair(t, world, pair[0], pair[1], points, velocities)
        particle = -1 - pair[0]
        candidate = working.candidates[world, particle, pair[1]]
        return particle_of_pair(t, world, particle, candidate, points, velocities)

    return contact_of


@cache
def listing_function(features: Features, backwards: bool) -> Any:
    """Return the function that lists pairs that may touch in a substep, see `kind.Kind`.

    Forward, pairs are left out that cannot touch yet, by how near they were when last measured.
    """
    contact_of = contact_function(features)

    @wp.func
    def next_due(working: Working, world: wp.int32, place: wp.int32, count: wp.int32, substep: wp.int32):
        """Return the place of the next pair of a thread that may touch in a substep, or one beyond the list."""
        if wp.static(not backwards):
            while place < count and working.edge_pairs[world, place][2] > substep:
                place += wp.block_dim()
        return place

    @wp.func
    def list_edges(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """List contacts in any order.

        A thread takes single pairs: where all of an edge or a particle are one's, the others wait for the fullest.
        Each thread first goes on to its next pair that is due, so that those of a warp measure together.
        """
        overlaps = bool(False)
        substep = working.list_lengths[world, SUBSTEPS]
        count = wp.min(working.list_lengths[world, PAIRS], working.edge_pairs.shape[1])
        place = next_due(working, world, thread, count, substep)
        while any_in_warp(place < count):  # or each thread of a warp would measure by itself
            if place < count:
                pair = working.edge_pairs[world, place]
                contact, near, clear = contact_of(t, working, world, wp.vec2i(pair[0], pair[1]), points, velocities)
                if near:
                    contact.pair = place
                    overlaps = list_contact(working, world, contact) or overlaps
                if wp.static(not backwards):
                    working.edge_pairs[world, place] = wp.vec3i(pair[0], pair[1], substep + 1 + clear)
            place = next_due(working, world, place + wp.block_dim(), count, substep)
        block_barrier()
        if thread == 0:
            working.list_lengths[world, SUBSTEPS] = substep + 1
        return overlaps

    return list_edges


EDGES = Kind(lambda features: features.edges_meet, listing_function, 300)
"""Sharp edges of balloons, and particles that would come through triangles"""

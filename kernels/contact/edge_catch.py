"""Edges of balloons that may touch in a substep, as they were at its start.

So may a particle and a triangle: where the spring between them, see `laws.touch`, would let the particle through.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.catch import EdgeCatch
from balloon_warp.kernels.contact.triangles import side_of, triangle_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.edges import FOUR, KEPT, Crossing, crossing_of, weights_of
from balloon_warp.kernels.loops.meeting import place_beside, skin_functions
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working

AHEAD = wp.constant(2.0)
"""Number of substeps ahead in which edges at their speeds would touch, so that they count as near in this one"""


@wp.func
def four_of(vectors: wp.array[wp.vec3], ends: wp.vec4i):
    """Return the vectors of the four ends, row by row."""
    return wp.matrix_from_rows(vectors[ends[0]], vectors[ends[1]], vectors[ends[2]], vectors[ends[3]])


@wp.func
def edges_there(before: FOUR, thickness: float):
    """Return the contact of two edges, by the places of their ends."""
    catch = EdgeCatch()
    catch.crossing = crossing_of(before[0], before[1], before[2], before[3])
    catch.kept = KEPT * thickness
    catch.weights = weights_of(catch.crossing.parts)
    return catch


@wp.func
def particle_there(before: FOUR, thickness: float):
    """Return the contact of a triangle and a particle, by the places of the corners and the particle."""
    catch = EdgeCatch()
    place = place_beside(before[3], before[0], before[1], before[2])
    crossing = Crossing()
    crossing.gap = wp.sqrt(place.squared)
    crossing.normal = wp.normalize(place.arm)
    catch.crossing = crossing
    catch.kept = KEPT * thickness
    catch.weights = wp.vec4(-place.weights[0], -place.weights[1], -place.weights[2], 1.0)
    return catch


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
def may_touch(t: Tables, catch: EdgeCatch, moving: FOUR):
    """Return whether two edges may touch in this substep."""
    speed = wp.length(catch.weights * moving)
    near = catch.crossing.gap < 2.0 * catch.kept + AHEAD * t.step_seconds * speed
    return near and wp.length_sq(catch.crossing.normal) > 0.0


@cache
def catching_function(features: Features) -> Any:
    """Return the function that measures two edges, or a particle and a triangle, as a substep begins."""
    thickness_between, _ = skin_functions(features)

    @wp.func
    def catch_edges(
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
        catch = edges_there(before, thickness_between(t, world, balloon, beside))
        catch.ends = ends
        fastest = wp.max(
            wp.max(wp.length(moving[0] - moving[2]), wp.length(moving[0] - moving[3])),
            wp.max(wp.length(moving[1] - moving[2]), wp.length(moving[1] - moving[3])),
        )
        clear = clear_substeps(t, balloon, beside, catch.crossing.gap, catch.kept, fastest)
        return catch, may_touch(t, catch, moving), clear

    @wp.func
    def catch_particle(
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
        catch = particle_there(before, thickness_between(t, world, own, other))
        catch.ends = ends
        area_vector = wp.cross(before[1] - before[0], before[2] - before[0])
        is_right = other == own or side_of(candidate) * wp.dot(catch.crossing.normal, area_vector) >= 0.0
        fastest = wp.max(
            wp.max(wp.length(moving[0] - moving[3]), wp.length(moving[1] - moving[3])),
            wp.length(moving[2] - moving[3]),
        )
        clear = clear_substeps(t, own, other, catch.crossing.gap, catch.kept, fastest)
        return catch, is_right and may_touch(t, catch, moving), clear

    @wp.func
    def catch_of(
        t: Tables, working: Working, world: wp.int32, pair: wp.vec2i, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return a listed pair at the start of the substep, whether it may touch in it, and for how many more not."""
        if pair[0] >= 0:
            return catch_edges(t, world, pair[0], pair[1], points, velocities)
        particle = -1 - pair[0]
        candidate = working.candidates[world, particle, pair[1]]
        return catch_particle(t, world, particle, candidate, points, velocities)

    return catch_of

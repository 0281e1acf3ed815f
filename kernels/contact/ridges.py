"""Faces and edges of balloons that meet ridges of obstacles and free bodies, where each piece of a substep is a launch:
a block a world. Those that are near push each other apart, all at once, a few times a substep, see `laws.ridges`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.catch import Catch
from balloon_warp.kernels.contact.ridge_poses import pair_friction_function, placing_function
from balloon_warp.kernels.contact.ridge_search import corners_of, near_in, ridge_search_function, start_in
from balloon_warp.kernels.contact.ridge_sums import add_impulse, add_to_body, take_impulse, take_of_body
from balloon_warp.kernels.laws.ridges import approach_allowed, rub_against, way_to_part
from balloon_warp.kernels.laws.rigid import spin_of
from balloon_warp.kernels.laws.touch import LEAST
from balloon_warp.kernels.loops.bodies import body_at, body_mass, pushed_on, put_body
from balloon_warp.kernels.loops.inertia import ease_function
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working

MOST_SWEEPS = wp.constant(24)
"""in a substep; where nothing comes too near any more it ends sooner"""
CAUGHT = wp.constant(1)
"""where the number of pairs stands that may meet in this substep, beside that of all that are near"""
SETTLED = wp.constant(0.02)
"""of the distance that is kept, by which they may come nearer in a substep"""


@cache
def catching_function(traits: Traits) -> Any:
    """The function that measures a pair as a substep begins."""
    place_of = placing_function(traits)
    friction_with = pair_friction_function(traits)

    @wp.func
    def catch_of(
        t: Tables, state: WorldState, working: Working, world: wp.int32, pair: wp.vec3i, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Of a pair: feature, ridge and solid."""
        catch = Catch()
        feature = t.ridges.features[pair[0]]
        placed = place_of(t, state, working, world, pair[2], end)
        catch.corners = wp.vec3i(corners_of(feature, 0), corners_of(feature, 1), corners_of(feature, 2))
        a = start_in(t, placed, catch.corners[0], points, velocities)
        b = start_in(t, placed, catch.corners[1], points, velocities)
        c = start_in(t, placed, catch.corners[2], points, velocities)
        near = near_in(t.ridges.ridges[pair[1]], feature, a, b, c)
        catch.solid = pair[2]
        catch.weights = near.weights
        catch.gap = near.gap
        if wp.length_sq(near.normal) > 0.0:
            catch.normal = wp.quat_rotate(placed.turn, near.normal)
            inside = near.weights[0] * a + near.weights[1] * b + near.weights[2] * c
            catch.arm = wp.quat_rotate(placed.turn, inside)
            catch.moving = placed.velocity + wp.cross(placed.spin, catch.arm)
            catch.friction = friction_with(t, world, catch.corners[0], placed.friction)
        return catch

    return catch_of


@cache
def pushing_functions(traits: Traits) -> tuple[Any, Any, Any]:
    """The functions that say how fast a pair comes together, how much lighter it is than its impulse, and that let it
    push."""
    ease_of_moving = ease_function(traits)

    @wp.func
    def beside(
        t: Tables, state: WorldState, working: Working, world: wp.int32, catch: Catch, velocities: wp.array[wp.vec3]
    ):
        """How the balloon moves there, beside the solid [m/s]."""
        moving = wp.vec3()
        for corner in range(3):
            moving += catch.weights[corner] * velocities[catch.corners[corner]]
        if wp.static(traits.bodies > 0):
            body = catch.solid - t.fixtures.solids.shape[0]
            if body >= 0:
                turn = working.body_start_turns[world, body]
                mass = body_mass(t, world, body)
                spin = spin_of(turn, t.bodies.eases[body], mass, state.body_momenta[world, body])
                return moving - state.body_velocities[world, body] - wp.cross(spin, catch.arm)
        return moving - catch.moving

    @wp.func
    def gain_along(t: Tables, working: Working, world: wp.int32, catch: Catch, along: wp.vec3):
        """How much faster the balloon's part moves there beside the solid's by 1 N s along a unit vector [1/kg]."""
        ease = float(0.0)
        for corner in range(3):
            particle = catch.corners[corner]
            share = float(working.ridge_shares[world, particle])
            weight = catch.weights[corner]
            ease += weight * weight * share * ease_of_moving(t, working, world, particle)
        gain = ease * along
        if wp.static(traits.bodies > 0):
            body = catch.solid - t.fixtures.solids.shape[0]
            if body >= 0:
                mass = body_mass(t, world, body)
                twist = spin_of(
                    working.body_start_turns[world, body], t.bodies.eases[body], mass, wp.cross(catch.arm, along)
                )
                share = float(working.ridge_body_shares[world, body])
                gain += share * (along / mass + wp.cross(twist, catch.arm))
        return gain

    @wp.func
    def push_pair(t: Tables, working: Working, world: wp.int32, catch: Catch, impulse: wp.vec3):
        """Give an impulse to the corners, and the opposite to a body."""
        for corner in range(3):
            if catch.weights[corner] > 0.0:
                add_impulse(working.ridge_quanta, world, catch.corners[corner], catch.weights[corner] * impulse)
        if wp.static(traits.bodies > 0):
            body = catch.solid - t.fixtures.solids.shape[0]
            if body >= 0:
                add_to_body(working.ridge_body_quanta, world, body, -impulse, wp.cross(catch.arm, -impulse))

    return beside, gain_along, push_pair


@cache
def sharing_functions(traits: Traits) -> tuple[Any, Any]:
    """The functions that count the contacts of particles and bodies, and that move these by all impulses."""
    ease_of_moving = ease_function(traits)

    @wp.func
    def count_in(t: Tables, working: Working, world: wp.int32, catch: Catch):
        for corner in range(3):
            if catch.weights[corner] > 0.0:
                wp.atomic_add(working.ridge_shares, world, catch.corners[corner], 1)
        if wp.static(traits.bodies > 0):
            body = catch.solid - t.fixtures.solids.shape[0]
            if body >= 0:
                wp.atomic_add(working.ridge_body_shares, world, body, 1)

    @wp.func
    def move_by_impulses(
        t: Tables, state: WorldState, working: Working, world: wp.int32, catch: Catch, speeds: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Move the corners, each by who comes first, which is the same for all of its sum.

        Args:
            speeds: 1, or 0 where impulses are moves without speed.
        """
        for corner in range(3):
            particle = catch.corners[corner]
            if catch.weights[corner] > 0.0:
                if wp.atomic_exch(working.ridge_shares, world, particle, 0) > 0:
                    impulse = take_impulse(working.ridge_quanta, world, particle)
                    gain = ease_of_moving(t, working, world, particle) * impulse
                    velocities[particle] = velocities[particle] + speeds * gain
                    points[particle] = points[particle] + wp.where(speeds > 0.0, t.step_seconds, 1.0) * gain
        if wp.static(traits.bodies > 0):
            body = catch.solid - t.fixtures.solids.shape[0]
            if body >= 0:
                if wp.atomic_exch(working.ridge_body_shares, world, body, 0) > 0:
                    push, twist = take_of_body(working.ridge_body_quanta, world, body)
                    rigid = body_at(t, state, working.body_starts, working.body_start_turns, world, body)
                    ways = push / rigid.mass
                    shift = (1.0 - speeds) * ways
                    put_body(state, world, pushed_on(t, rigid, speeds * ways, speeds * twist, shift))

    return count_in, move_by_impulses


@cache
def ridges_function(traits: Traits) -> Any:
    """The function by which faces leave ridges, once all have moved."""
    search_ridges = ridge_search_function(traits)
    catch_of = catching_function(traits)
    beside, gain_along, push_pair = pushing_functions(traits)
    count_in, move_by_impulses = sharing_functions(traits)

    @wp.func
    def find_pushed(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32,
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """How much too fast a pair comes together, of those that are a thread's, at most [m/s]; each is counted."""
        worst = float(0.0)
        for pair in range(thread, count, wp.block_dim()):
            catch = working.catches[world, pair]
            allowed = approach_allowed(catch.gap, t.ridges.kept, t.step_seconds)
            excess = -wp.dot(beside(t, state, working, world, catch, velocities), catch.normal) - allowed
            if excess > 0.0:
                count_in(t, working, world, catch)
                worst = wp.max(worst, excess)
            working.catches[world, pair].push = excess
        return worst

    @wp.func
    def push_apart(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32,
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Let those that are a thread's push, and rub."""
        for pair in range(thread, count, wp.block_dim()):
            catch = working.catches[world, pair]
            if catch.push > 0.0:
                along = gain_along(t, working, world, catch, catch.normal)
                push = catch.push / wp.max(wp.dot(along, catch.normal), LEAST)
                impulse = push * catch.normal
                if catch.friction > 0.0:
                    slide = beside(t, state, working, world, catch, velocities) + push * along
                    slide -= wp.dot(slide, catch.normal) * catch.normal
                    if wp.length_sq(slide) > 0.0:
                        ahead = wp.normalize(slide)
                        ease = wp.dot(gain_along(t, working, world, catch, ahead), ahead)
                        impulse += rub_against(slide, catch.normal, ease, catch.friction * push)
                push_pair(t, working, world, catch, impulse)

    @wp.func
    def move_all(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32,
        speeds: float, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        for pair in range(thread, count, wp.block_dim()):
            if working.catches[world, pair].push > 0.0:
                move_by_impulses(t, state, working, world, working.catches[world, pair], speeds, points, velocities)

    @wp.func
    def find_overlaps(t: Tables, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32):
        """How far those that are a thread's are to be moved apart, at most [m]; each is counted."""
        worst = float(0.0)
        for pair in range(thread, count, wp.block_dim()):
            catch = working.catches[world, pair]
            out = way_to_part(catch.gap, t.ridges.kept)
            if out > 0.0:
                count_in(t, working, world, catch)
                worst = wp.max(worst, out)
            working.catches[world, pair].push = out
        return worst

    @wp.func
    def move_apart(t: Tables, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32):
        for pair in range(thread, count, wp.block_dim()):
            catch = working.catches[world, pair]
            if catch.push > 0.0:
                along = gain_along(t, working, world, catch, catch.normal)
                push = catch.push / wp.max(wp.dot(along, catch.normal), LEAST)
                push_pair(t, working, world, catch, push * catch.normal)

    @wp.func
    def leave_ridges(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Of a world, by all threads of a block; soon done where nothing is near."""
        near, way = search_ridges(t, state, working, world, thread, end, points, velocities)
        if near > 0:
            if thread == 0:
                working.ridge_counts[world, CAUGHT] = 0
            block_barrier()
            for pair in range(thread, near, wp.block_dim()):
                catch = catch_of(t, state, working, world, working.ridge_pairs[world, pair], end, points, velocities)
                if wp.length_sq(catch.normal) > 0.0 and catch.gap < t.ridges.kept + way:
                    working.catches[world, wp.atomic_add(working.ridge_counts, world, CAUGHT, 1)] = catch
            block_barrier()
        count = working.ridge_counts[world, CAUGHT]
        if near > 0 and count > 0:
            sweep = wp.int32(0)
            while sweep < MOST_SWEEPS:
                sweep += 1
                mine = find_pushed(t, state, working, world, thread, count, velocities)
                worst = wp.tile_max(wp.tile(mine))[0]
                block_barrier()
                if worst > 0.0:
                    push_apart(t, state, working, world, thread, count, velocities)
                    block_barrier()
                    move_all(t, state, working, world, thread, count, 1.0, points, velocities)
                    block_barrier()
                if t.step_seconds * worst < SETTLED * t.ridges.kept:
                    sweep = MOST_SWEEPS
            mine = find_overlaps(t, working, world, thread, count)
            overlap = wp.tile_max(wp.tile(mine))[0]
            block_barrier()
            if overlap > 0.0:
                move_apart(t, working, world, thread, count)
                block_barrier()
                move_all(t, state, working, world, thread, count, 0.0, points, velocities)
                block_barrier()

    return leave_ridges

"""Contact of one feature of a balloon with a ridge: geometry, approach speed and response, see `laws.ridges`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.catch import Catch
from balloon_warp.kernels.contact.ridge_balls import ball_functions
from balloon_warp.kernels.contact.ridge_poses import body_of, placing_function, sphere_of
from balloon_warp.kernels.contact.ridge_push import BALL, BODY, Bearing, caught
from balloon_warp.kernels.contact.ridge_search import corners_of, start_in
from balloon_warp.kernels.contact.ridge_sums import add_impulse, add_to_body, take_impulse, take_of_body
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.rigid import spin_of
from balloon_warp.kernels.loops.bodies import body_at, body_mass, pushed_on, put_body
from balloon_warp.kernels.loops.friction import friction_on
from balloon_warp.kernels.loops.inertia import ease_function
from balloon_warp.kernels.tables import Tables, WorldState, sphere_mass, sphere_radius
from balloon_warp.kernels.working import Working


@cache
def catching_function(features: Features) -> Any:
    """Return the function that measures a pair as a substep begins."""
    place_of = placing_function(features)

    @wp.func
    def catch_of(
        t: Tables, state: WorldState, working: Working, world: wp.int32, number: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return the contact of a pair that is near: feature, ridge and solid."""
        pair = working.ridge_pairs[world, number]
        feature = t.ridges.features[pair[0]]
        placed = place_of(t, state, working, world, pair[2], end)
        corners = wp.vec3i(corners_of(feature, 0), corners_of(feature, 1), corners_of(feature, 2))
        a = start_in(t, placed, corners[0], points, velocities)
        b = start_in(t, placed, corners[1], points, velocities)
        c = start_in(t, placed, corners[2], points, velocities)
        catch = caught(placed, t.ridges.ridges[pair[1]], feature, a, b, c)
        catch.corners = corners
        catch.pair = number
        catch.solid = pair[2]
        if wp.length_sq(catch.normal) > 0.0:
            catch.friction = friction_on(t, world, t.particles.balloon[corners[0]], placed.thing)
        return catch

    return catch_of


@cache
def bearing_function(features: Features) -> Any:
    """Return the function of the masses that bear a contact in a sweep."""
    ease_of_moving = ease_function(features)

    @wp.func
    def bearing_of(t: Tables, working: Working, world: wp.int32, catch: Catch):
        bearing = Bearing()
        for corner in range(3):
            particle = catch.corners[corner]
            bearing.shares[corner] = float(working.ridge_shares[world, particle])
            bearing.eases[corner] = ease_of_moving(t, working, world, particle)
        if wp.static(features.bodies > 0):
            body = body_of(t, catch.solid)
            if body >= 0:
                bearing.kind = BODY
                bearing.share = float(working.ridge_body_shares[world, body])
                bearing.mass = body_mass(t, world, body)
                bearing.turn = working.body_start_turns[world, body]
                bearing.ease = t.bodies.eases[body]
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, catch.solid)
            if sphere >= 0:
                bearing.kind = BALL
                bearing.share = float(working.ridge_ball_shares[world, sphere])
                bearing.mass = sphere_mass(t.spheres, world, sphere)
                bearing.radius = sphere_radius(t.spheres, world, sphere)
        return bearing

    return bearing_of


@cache
def pushing_functions(features: Features) -> tuple[Any, Any]:
    """Return functions for the approach speed of a pair, and for its impulse."""
    velocity_of_ball, _ = ball_functions(features)

    @wp.func
    def beside(
        t: Tables, state: WorldState, working: Working, world: wp.int32, catch: Catch, velocities: wp.array[wp.vec3]
    ):
        """Return the balloon's velocity at the contact, relative to the solid [m/s]."""
        moving = wp.vec3()
        for corner in range(3):
            moving += catch.weights[corner] * velocities[catch.corners[corner]]
        if wp.static(features.bodies > 0):
            body = body_of(t, catch.solid)
            if body >= 0:
                turn = working.body_start_turns[world, body]
                mass = body_mass(t, world, body)
                spin = spin_of(turn, t.bodies.eases[body], mass, state.body_momenta[world, body])
                return moving - state.body_velocities[world, body] - wp.cross(spin, catch.arm)
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, catch.solid)
            if sphere >= 0:
                return moving - velocity_of_ball(state, world, sphere, catch.arm)
        return moving - catch.moving

    @wp.func
    def push_pair(t: Tables, working: Working, world: wp.int32, catch: Catch, impulse: wp.vec3):
        """Give an impulse to the corners, and the opposite to a body or a sphere."""
        for corner in range(3):
            if catch.weights[corner] > 0.0:
                add_impulse(working.ridge_quanta, world, catch.corners[corner], catch.weights[corner] * impulse)
        if wp.static(features.bodies > 0):
            body = body_of(t, catch.solid)
            if body >= 0:
                add_to_body(working.ridge_body_quanta, world, body, -impulse, wp.cross(catch.arm, -impulse))
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, catch.solid)
            if sphere >= 0:
                add_to_body(working.ridge_ball_quanta, world, sphere, -impulse, wp.cross(catch.arm, -impulse))

    return beside, push_pair


@cache
def sharing_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions that count the contacts of particles and bodies, and that apply all impulses to them."""
    ease_of_moving = ease_function(features)
    _, move_ball = ball_functions(features)

    @wp.func
    def count_in(t: Tables, working: Working, world: wp.int32, catch: Catch):
        for corner in range(3):
            if catch.weights[corner] > 0.0:
                wp.atomic_add(working.ridge_shares, world, catch.corners[corner], 1)
        if wp.static(features.bodies > 0):
            body = body_of(t, catch.solid)
            if body >= 0:
                wp.atomic_add(working.ridge_body_shares, world, body, 1)
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, catch.solid)
            if sphere >= 0:
                wp.atomic_add(working.ridge_ball_shares, world, sphere, 1)

    @wp.func
    def move_by_impulses(
        t: Tables, state: WorldState, working: Working, world: wp.int32, catch: Catch, speeds: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Move the corners, each by its whole sum of impulses; the first thread that comes does it.

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
        if wp.static(features.bodies > 0):
            body = body_of(t, catch.solid)
            if body >= 0:
                if wp.atomic_exch(working.ridge_body_shares, world, body, 0) > 0:
                    push, twist = take_of_body(working.ridge_body_quanta, world, body)
                    rigid = body_at(t, state, working.body_starts, working.body_start_turns, world, body)
                    ways = push / rigid.mass
                    shift = (1.0 - speeds) * ways
                    put_body(state, world, pushed_on(t, rigid, speeds * ways, speeds * twist, shift))
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, catch.solid)
            if sphere >= 0:
                if wp.atomic_exch(working.ridge_ball_shares, world, sphere, 0) > 0:
                    move_ball(t, state, working, world, sphere, speeds)

    return count_in, move_by_impulses

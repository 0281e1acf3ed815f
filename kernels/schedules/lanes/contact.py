"""Spheres, ground and corrections, eight lanes at a time. Touching is rare: only then is a lane looked at alone."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import (
    LANE_COUNT,
    Lanes,
    Lanes3,
    any_negative,
    of_lane,
    reach_along,
    set_lane,
    squared_length,
)
from balloon_warp.kernels.laws.contact import friction_on
from balloon_warp.kernels.laws.correction import excess, moves_of_ends
from balloon_warp.kernels.loops.fixture_poses import center_function
from balloon_warp.kernels.loops.fixtures import Around
from balloon_warp.kernels.loops.obstacles import obstacle_loop
from balloon_warp.kernels.schedules.lanes.layouts import Layout, of_item, places_of, put_item
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.spheres import sphere_in_state
from balloon_warp.kernels.tables import WorldState
from balloon_warp.kernels.traits import Traits

WIDER = wp.constant(1.1)
"""(a + b)^2 is at most 1.1 a^2 + 11 b^2: so that no root is needed to see who is near"""
A_STEP = wp.constant(11.0)


@wp.func
def add_to_state(state: Any, world: wp.int32, sphere: wp.int32, force: wp.vec3):
    """Add a force to those on a sphere, by the one thread of its world."""
    state.sphere_forces[world, sphere] += force


@cache
def touch_function(traits: Traits, layout: Layout) -> Any:
    """The function that asks whether any lane's point is below the ground, inside a sphere that it leaves alone, or
    near an obstacle."""
    LaneTables, LaneState, LaneOwn = lane_structs(layout)  # noqa: N806 - types
    height_column = traits.columns.places["ground_height"]
    places = places_of(layout)
    center_at = center_function(traits) if traits.stands_on_fixtures else None

    @wp.func
    def is_near_fixture(t: LaneTables, own: LaneOwn, fixture: wp.int32, time: float, point: Lanes3, velocity: Lanes3):
        """Whether any lane's point is, or was a step before, within an obstacle's reach, which may move meanwhile."""
        centers = Lanes3()
        for lane in range(LANE_COUNT):
            world = places.world(own.group, lane, t.world_count)
            centers = set_lane(centers, lane, center_at(t.all, world, fixture, time))
        reach = t.all.fixtures.solids[fixture].reach + t.all.fixtures.fastest * t.step_seconds
        steps = (A_STEP * t.step_seconds * t.step_seconds) * squared_length(velocity)
        gaps = squared_length(point - centers) - steps
        for lane in range(LANE_COUNT):
            gaps[lane] = gaps[lane] - WIDER * reach * reach
        return any_negative(gaps)

    @wp.func
    def touches_any(t: LaneTables, lanes: LaneState, own: LaneOwn, time: float, point: Lanes3, velocity: Lanes3):
        touches = bool(False)
        if wp.static(traits.ground):
            touches = any_negative(reach_along(point, t.up) - own.n[height_column])
        if wp.static(traits.penalties):
            for sphere in range(lanes.sphere_centers.shape[1]):
                gaps = squared_length(point - lanes.sphere_centers[own.group, sphere])
                touches = touches or any_negative(gaps - lanes.sphere_squared_radii[own.group, sphere])
        if wp.static(traits.stands_on_fixtures):
            for fixture in range(t.all.fixtures.solids.shape[0]):
                touches = touches or is_near_fixture(t, own, fixture, time, point, velocity)
        return touches

    return touches_any


@cache
def around_in_lanes(traits: Traits, layout: Layout) -> Any:
    """The function that says what a lane's particle has around it."""
    LaneTables, _, LaneOwn = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)
    named = ("ground_height", "ground_friction", "balloon_friction")
    height_column, ground_column, own_column = (traits.columns.places[name] for name in named)

    @wp.func
    def around_lane(t: LaneTables, own: LaneOwn, lane: wp.int32, time: float):
        """At the end of a step [s]."""
        around = Around()
        around.world = places.world(own.group, lane, t.world_count)
        around.particle = own.item
        if wp.static(not layout.worlds):
            around.particle = t.particles[LANE_COUNT * own.item + lane]
        around.ground_height = own.n[height_column][lane]
        around.friction = own.n[own_column][lane]
        around.ground_friction = friction_on(around.friction, own.n[ground_column][lane])
        around.time = time
        return around

    return around_lane


@cache
def leave_function(traits: Traits, layout: Layout) -> Any:
    """The function by which an item leaves obstacles."""
    LaneTables, LaneState, LaneOwn = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)
    touches_any = touch_function(traits, layout)
    leave_obstacles = obstacle_loop(traits, sphere_in_state, add_to_state)
    around_lane = around_in_lanes(traits, layout)

    @wp.func
    def leave_one_by_one(
        t: LaneTables,
        state: WorldState,
        own: LaneOwn,
        time: float,
        point: Lanes3,
        velocity: Lanes3,
        push: Lanes3,
    ):
        """Points and velocities outside."""
        for lane in range(t.lane_count):
            share = of_lane(own.share, lane)
            if share > 0.0 and places.is_other(own.group, lane, t.world_count):
                out, after = leave_obstacles(
                    t.all, state, around_lane(t, own, lane, time),
                    of_lane(point, lane), of_lane(velocity, lane), of_lane(push, lane),
                )  # fmt: skip
                point = set_lane(point, lane, out)
                velocity = set_lane(velocity, lane, after)
        return point, velocity

    @wp.func
    def leave(
        t: LaneTables,
        state: WorldState,
        lanes: LaneState,
        own: LaneOwn,
        time: float,
        point: Lanes3,
        velocity: Lanes3,
        push: Lanes3,
    ):
        """Points and velocities outside, and the spheres' forces; the time is that of the step's end."""
        if touches_any(t, lanes, own, time, point, velocity):
            out, after = leave_one_by_one(t, state, own, time, point, velocity, push)
            point = out
            velocity = after
        return point, velocity

    return leave


@cache
def correct_function(traits: Traits, layout: Layout) -> Any:
    """The function that shortens springs which are too long."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    limit_column = traits.columns.places.get("correction_limit", 0)

    @wp.func
    def may_be_too_long(d: Lanes3, rest_length: float, limits: Lanes):
        """Whether a spring may be too long in any of the worlds: without fail if it is, whatever the others are."""
        beyond = squared_length(d)
        for lane in range(LANE_COUNT):
            longest = (1.0 + limits[lane]) * rest_length
            beyond[lane] = 1.0001 * beyond[lane] - longest * longest
        return wp.max(beyond) > 0.0

    @wp.func
    def correct_in_worlds(t: LaneTables, lanes: LaneState, group: wp.int32, points: Any):
        """All sweeps over all springs, which stand in the order of their colors, in eight worlds."""
        limits = lanes.numbers[group, 0, limit_column]
        for _sweep in range(t.all.correction.sweeps):
            for spring in range(t.all.correction.particles.shape[0]):
                p = t.all.correction.particles[spring][0]
                q = t.all.correction.particles[spring][1]
                rest_length = t.all.correction.rest_lengths[spring]
                d = points[q] - points[p]
                if may_be_too_long(d, rest_length, limits):
                    moves_p = Lanes3()
                    moves_q = Lanes3()
                    for lane in range(LANE_COUNT):
                        too_long = excess(of_lane(d, lane), rest_length, limits[lane])
                        move_p, move_q = moves_of_ends(t.shares[p], t.shares[q], too_long)
                        moves_p = set_lane(moves_p, lane, move_p)
                        moves_q = set_lane(moves_q, lane, move_q)
                    points[p] = points[p] + moves_p
                    points[q] = points[q] + moves_q
                    lanes.velocities[group, p] = lanes.velocities[group, p] + moves_p / t.step_seconds
                    lanes.velocities[group, q] = lanes.velocities[group, q] + moves_q / t.step_seconds

    @wp.func
    def move_place(lanes: LaneState, group: wp.int32, points: Any, place: wp.int32, move: wp.vec3, step_seconds: float):
        """One particle of an octet."""
        points[place] = points[place] + wp.vec4(move[0], move[1], move[2], 0.0)
        for axis in range(3):
            lanes.velocities[group, place // LANE_COUNT][axis, place % LANE_COUNT] += move[axis] / step_seconds

    @wp.func
    def correct_in_world(t: LaneTables, lanes: LaneState, group: wp.int32, points: Any):
        """The same in one world."""
        limit = lanes.numbers[group, 0, limit_column][0]
        for _sweep in range(t.seen.correction.sweeps):
            for spring in range(t.seen.correction.particles.shape[0]):
                p = t.seen.correction.particles[spring][0]
                q = t.seen.correction.particles[spring][1]
                apart = points[q] - points[p]
                d = wp.vec3(apart[0], apart[1], apart[2])
                longest = (1.0 + limit) * t.seen.correction.rest_lengths[spring]
                if wp.length_sq(d) > longest * longest:
                    too_long = excess(d, t.seen.correction.rest_lengths[spring], limit)
                    share_p = t.shares[p // LANE_COUNT][p % LANE_COUNT]
                    share_q = t.shares[q // LANE_COUNT][q % LANE_COUNT]
                    move_p, move_q = moves_of_ends(share_p, share_q, too_long)
                    move_place(lanes, group, points, p, move_p, t.step_seconds)
                    move_place(lanes, group, points, q, move_q, t.step_seconds)

    return correct_in_worlds if layout.worlds else correct_in_world


@cache
def leave_all_function(traits: Traits, layout: Layout) -> Any:
    """The function that lets all particles leave obstacles, once all have moved."""
    LaneTables, LaneState, LaneOwn = lane_structs(layout)  # noqa: N806 - types
    leave = leave_function(traits, layout)

    @wp.func
    def leave_all(t: LaneTables, state: WorldState, lanes: LaneState, group: wp.int32, time: float, points: Any):
        """Every particle out of obstacles, where corrections or other contacts have left it."""
        for balloon in range(t.all.inflation_kind.shape[0]):
            for item in range(t.item_offsets[balloon], t.item_offsets[balloon + 1]):
                own = LaneOwn()
                own.group = group
                own.item = item
                own.balloon = balloon
                own.share = t.shares[item]
                own.n = lanes.numbers[group, balloon]
                push = Lanes3()
                if wp.static(traits.keeps_inflations):
                    push = lanes.inflations[group, item]
                out, after = leave(
                    t, state, lanes, own, time, of_item(points, item), lanes.velocities[group, item], push
                )
                put_item(points, item, out)
                lanes.velocities[group, item] = after

    return leave_all

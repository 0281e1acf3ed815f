"""Spheres and particles that exchange momentum, eight lanes at a time: all items are looked at together, and those that
are near a sphere then one by one, once for each time that the sphere asks."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import LANE_COUNT, any_negative, of_lane, set_lane, squared_length
from balloon_warp.kernels.laws.impulse import MOST_TURNS, NEAR, Press, is_met, is_settled
from balloon_warp.kernels.loops.touching import (
    answer_of_ball,
    answer_to_ball,
    ball_function,
    change_of_ball,
    press_on_ball,
    rub_on_ball,
    rubbed_ball,
    rubbed_point,
    shift_of_ball,
)
from balloon_warp.kernels.schedules.lanes.contact import A_STEP, WIDER
from balloon_warp.kernels.schedules.lanes.layouts import Layout, of_item, places_of, put_item
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.spheres import sphere_in_state
from balloon_warp.kernels.tables import WorldState
from balloon_warp.kernels.traits import Traits


@cache
def near_function(traits: Traits, layout: Layout) -> Any:
    """The function that finds the items near a sphere."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types

    @wp.func
    def find_near_items(t: LaneTables, lanes: LaneState, group: wp.int32, points: Any, sphere: wp.int32):
        """How many there are, in any lane, and perhaps a few more; their numbers into `near_items`."""
        center = lanes.sphere_centers[group, sphere]
        motion = lanes.sphere_motions[group, sphere]
        reach = (WIDER * NEAR * NEAR) * lanes.sphere_squared_radii[group, sphere]
        a_step = A_STEP * t.step_seconds * t.step_seconds
        count = wp.int32(0)
        for item in range(lanes.velocities.shape[1]):
            steps = a_step * squared_length(lanes.velocities[group, item] - motion)
            if any_negative(squared_length(of_item(points, item) - center) - reach - steps):
                lanes.near_items[group, count] = item
                count += 1
        return count

    return find_near_items


@cache
def world_function(traits: Traits, layout: Layout) -> Any:
    """The function by which a sphere and the items near it meet, in one world."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places_of_item = 1 if layout.worlds else LANE_COUNT
    mass_column, friction_column = (traits.columns.places[name] for name in ("mass", "balloon_friction"))
    ball_at = ball_function(traits, sphere_in_state)

    @wp.func
    def mass_in_lane(t: LaneTables, lanes: LaneState, group: wp.int32, item: wp.int32, lane: wp.int32):
        """Of a particle and what moves with it [kg]."""
        balloon = t.all.particles.balloon[t.particles[places_of_item * item]]
        masses = lanes.numbers[group, balloon, mass_column]
        if wp.static(traits.gas):
            masses = lanes.masses[group, balloon]
        return of_lane(t.shares[item], lane) * masses[lane]

    @wp.func
    def press(
        t: LaneTables,
        lanes: LaneState,
        group: wp.int32,
        points: Any,
        count: wp.int32,
        first_lane: wp.int32,
        end_lane: wp.int32,
        ball: Any,
        change: wp.vec3,
    ):
        """What the sphere bears if its velocity changes so."""
        total = Press()
        for near in range(count):
            item = lanes.near_items[group, near]
            point = of_item(points, item)
            velocity = lanes.velocities[group, item]
            for lane in range(first_lane, end_lane):
                mass = mass_in_lane(t, lanes, group, item, lane)
                if mass > 0.0:
                    total += press_on_ball(t.all, ball, change, mass, of_lane(point, lane), of_lane(velocity, lane))
        return total

    @wp.func
    def meet(
        t: LaneTables,
        state: WorldState,
        lanes: LaneState,
        group: wp.int32,
        points: Any,
        count: wp.int32,
        world: wp.int32,
        sphere: wp.int32,
        first_lane: wp.int32,
        end_lane: wp.int32,
    ):
        """The lanes are those that the world has."""
        ball = ball_at(t.all, state, state.sphere_spins, world, sphere)
        last = wp.vec3()
        pressed = press(t, lanes, group, points, count, first_lane, end_lane, ball, last)
        if is_met(pressed):
            change = change_of_ball(t.all, ball, pressed, last)
            turn = wp.int32(1)
            while turn < MOST_TURNS and not is_settled(change, last):
                last = change
                pressed = press(t, lanes, group, points, count, first_lane, end_lane, ball, last)
                change = change_of_ball(t.all, ball, pressed, last)
                turn += 1
            shift = shift_of_ball(t.all, ball, pressed)
            total = wp.spatial_vector()
            for near in range(count):
                item = lanes.near_items[group, near]
                point = of_item(points, item)
                velocity = lanes.velocities[group, item]
                for lane in range(first_lane, end_lane):
                    if of_lane(t.shares[item], lane) > 0.0:
                        start = of_lane(point, lane)
                        speed = of_lane(velocity, lane)
                        out, after = answer_to_ball(t.all, ball, last, change, shift, start, speed)
                        if wp.static(traits.spheres_rub):
                            mass = mass_in_lane(t, lanes, group, item, lane)
                            balloon = t.all.particles.balloon[t.particles[places_of_item * item]]
                            friction = lanes.numbers[group, balloon, friction_column]
                            rub = rub_on_ball(t.all, ball, pressed, last, change, mass, friction[lane], start, speed)
                            total += rub
                            out, after = rubbed_point(t.all, rub, mass, out, after)
                        point = set_lane(point, lane, out)
                        velocity = set_lane(velocity, lane, after)
                put_item(points, item, point)
                lanes.velocities[group, item] = velocity
            center, motion, force = answer_of_ball(t.all, ball, change, shift)
            if wp.static(traits.spheres_rub):
                center, motion, spin = rubbed_ball(t.all, ball, pressed, change, center, motion, total)
                state.sphere_spins[world, sphere] = spin
            state.sphere_positions[world, sphere] = center
            state.sphere_velocities[world, sphere] = motion
            state.sphere_forces[world, sphere] = force

    return meet


@cache
def touch_function(traits: Traits, layout: Layout) -> Any:
    """The function by which spheres and particles exchange momentum, sphere by sphere."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)
    find_near_items = near_function(traits, layout)
    meet = world_function(traits, layout)

    @wp.func
    def touch(t: LaneTables, state: WorldState, lanes: LaneState, group: wp.int32, points: Any):
        first = places.first_world(group)
        for sphere in range(lanes.sphere_centers.shape[1]):
            count = find_near_items(t, lanes, group, points, sphere)
            if count > 0:
                for place in range(places.worlds(group, t.world_count)):
                    first_lane = wp.int32(0)
                    end_lane = t.lane_count
                    if wp.static(layout.worlds):
                        first_lane = place
                        end_lane = place + 1
                    meet(t, state, lanes, group, points, count, first + place, sphere, first_lane, end_lane)

    return touch

"""Gas, eight lanes at a time: what is pumped, how balloons swell, the pressure that follows, and what flows."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import LANE_COUNT, Lanes, Lanes3, of_lane, reach_along, scaled, set_lane, times
from balloon_warp.kernels.clock import ramp_at
from balloon_warp.kernels.laws.gas import (
    Swelling,
    free_along,
    memory_of_rate,
    rate_beside_obstacles,
    swelling_of_particle,
)
from balloon_warp.kernels.loops.gas import flows_function, gas_mass_function, pump_function
from balloon_warp.kernels.loops.jets import jet_loop
from balloon_warp.kernels.loops.obstacles import course_function
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.phases.load import load_function, note_function
from balloon_warp.kernels.phases.move import response
from balloon_warp.kernels.schedules.lanes.contact import around_in_lanes, touch_function
from balloon_warp.kernels.schedules.lanes.layouts import Layout, places_of, view_of
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.spheres import sphere_in_state
from balloon_warp.kernels.tables import WorldState
from balloon_warp.kernels.traits import Traits

Swellings = wp.types.matrix(shape=(5, 8), dtype=wp.float32)
"""of balloons or particles, one a column; see `laws.gas`"""


@cache
def pump_in_lanes(traits: Traits, layout: Layout) -> Any:
    """The function that pumps gas."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)
    pump_gas = pump_function(traits)
    gas_mass = gas_mass_function(traits)
    mass_column = traits.columns.places["mass"]

    @wp.func
    def pump(t: LaneTables, state: WorldState, lanes: LaneState, group: wp.int32, time_in_frame: float, time: float):
        """What is pumped in or let out, and the balloons' masses with their gas."""
        first = places.first_world(group)
        for world in range(first, first + places.worlds(group, t.world_count)):
            pump_gas(t.all, state, world, time_in_frame, time)
        for lane in range(t.lane_count):
            world = places.world(group, lane, t.world_count)
            for balloon in range(t.all.inflation_kind.shape[0]):
                own = lanes.numbers[group, balloon, mass_column][lane]
                lanes.masses[group, balloon][lane] = own + gas_mass(t.all, state, world, balloon)

    return pump


@cache
def swell_in_lanes(traits: Traits, layout: Layout) -> Any:
    """The function that gives the parts of an item in its balloon's swelling, as `substep.swell` does of a particle."""
    LaneTables, LaneState, LaneOwn = lane_structs(layout)  # noqa: N806 - types
    course_beside_obstacles = course_function(traits, sphere_in_state)
    touches_any = touch_function(traits, layout)
    around_lane = around_in_lanes(traits, layout)
    damping_column = traits.columns.places["breathing_damping"]

    @wp.func
    def let_by_obstacles(t: LaneTables, state: WorldState, own: LaneOwn, time: float, point: Lanes3, course: Lanes3):
        """The velocities at which obstacles let particles move in a step, and their normals, zero where there are
        none."""
        normals = Lanes3()
        for lane in range(t.lane_count):
            if of_lane(own.share, lane) > 0.0:
                let, away = course_beside_obstacles(
                    t.all, state, around_lane(t, own, lane, time), of_lane(point, lane), of_lane(course, lane)
                )
                course = set_lane(course, lane, let)
                normals = set_lane(normals, lane, away)
        return course, normals

    @wp.func
    def swell(
        t: LaneTables,
        state: WorldState,
        lanes: LaneState,
        own: LaneOwn,
        time: float,
        masses: Lanes,
        arm: Lanes3,
        point: Lanes3,
        old_velocity: Lanes3,
        velocity: Lanes3,
        area_vector: Lanes3,
    ):
        """Under the old load; the velocity is that without inflation."""
        heights = reach_along(point, t.up)
        pushes = lanes.loads[own.group, own.balloon] + times(lanes.rises[own.group, own.balloon], heights)
        gains = response(masses, t.step_seconds)
        course = velocity + scaled(area_vector, times(gains, pushes))
        normals = Lanes3()
        if wp.static(traits.obstacles):
            if touches_any(t, lanes, own, time, point + scaled(course, t.step_seconds), course):
                let, away = let_by_obstacles(t, state, own, time, point, course)
                course = let
                normals = away
        if wp.static(traits.breathes_on):
            dampings = own.n[damping_column]
            memories = Lanes()
            for lane in range(LANE_COUNT):
                memories[lane] = memory_of_rate(dampings[lane])
            course = course - scaled(old_velocity, memories)
        parts = Swellings()
        for lane in range(LANE_COUNT):
            along = of_lane(area_vector, lane)
            free = along
            if wp.static(traits.obstacles):
                free = free_along(along, of_lane(normals, lane))
            rate = rate_beside_obstacles(along, free, of_lane(course, lane), gains[lane], pushes[lane])
            part = swelling_of_particle(
                of_lane(arm, lane), along, free, rate, gains[lane], of_lane(own.share, lane), heights[lane]
            )
            for number in range(5):
                parts[number, lane] = part[number]
        return parts

    return swell


@cache
def jet_in_lanes(traits: Traits, layout: Layout) -> Any:
    """The function that gives an item's part of its balloon's thrust."""
    LaneTables, LaneState, LaneOwn = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)
    jet_of_particle = jet_loop(traits, places.seen)
    read_numbers = numbers_reader(traits.columns)

    @wp.func
    def jet(t: LaneTables, lanes: LaneState, own: LaneOwn, points: Any, point: Lanes3, time: float):
        """Force [N]; the edges around necks are known by places."""
        force = Lanes3()
        heights = reach_along(point, t.up)
        for lane in range(t.lane_count):
            weight = of_lane(t.neck_weights[own.item], lane)
            if weight > 0.0:
                load = wp.vec2(lanes.loads[own.group, own.balloon][lane], lanes.rises[own.group, own.balloon][lane])
                n = read_numbers(t.all, places.world(own.group, lane, t.world_count), own.balloon)
                of_particle = jet_of_particle(
                    t.seen.necks, view_of(points, lane), weight, own.balloon, load, heights[lane], time, n
                )
                force = set_lane(force, lane, of_particle)
        return force

    return jet


@cache
def load_in_lanes(traits: Traits, layout: Layout) -> tuple[Any, Any]:
    """The functions that find a balloon's load in each world, and that take all loads into the lanes, with what flows
    by them."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)
    load_of_balloon = load_function(traits)
    note_load = note_function(traits)
    let_gases_flow = flows_function(traits)
    read_numbers = numbers_reader(traits.columns)

    @wp.func
    def load_of_world(
        t: LaneTables, state: WorldState, world: wp.int32, balloon: wp.int32, swelling: Swelling, time_in_frame: float
    ):
        """The load at height 0 and its rise, noted in the state."""
        load = load_of_balloon(
            t.all.inflation_kind[balloon], ramp_at(state, world, balloon, time_in_frame), swelling,
            float(state.gas_amounts[world, balloon]), float(state.free_volumes[world, balloon]), t.step_seconds,
            read_numbers(t.all, world, balloon),
        )  # fmt: skip
        note_load(state, world, balloon, load)

    @wp.func
    def find_load(
        t: LaneTables,
        state: WorldState,
        group: wp.int32,
        balloon: wp.int32,
        swellings: Swellings,
        time_in_frame: float,
    ):
        """Into the state."""
        first = places.first_world(group)
        for place in range(places.worlds(group, t.world_count)):
            swelling = Swelling()
            for number in range(5):
                if wp.static(layout.worlds):
                    swelling[number] = swellings[number, place]
                else:
                    total = float(0.0)
                    for lane in range(LANE_COUNT):
                        total += swellings[number, lane]
                    swelling[number] = total
            load_of_world(t, state, first + place, balloon, swelling, time_in_frame)

    @wp.func
    def take_loads(t: LaneTables, state: WorldState, lanes: LaneState, group: wp.int32, time: float):
        """Of all balloons, with what flows by them."""
        if wp.static(traits.gas_flows):
            first = places.first_world(group)
            for world in range(first, first + places.worlds(group, t.world_count)):
                let_gases_flow(t.all, state, world, time)
        for lane in range(t.lane_count):
            world = places.world(group, lane, t.world_count)
            for balloon in range(t.all.inflation_kind.shape[0]):
                load = state.inflation_loads[world, balloon]
                lanes.loads[group, balloon][lane] = load[0]
                lanes.rises[group, balloon][lane] = load[1]

    return find_load, take_loads

"""From the state into the lanes, when a frame begins, and back when it ends."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import LANE_COUNT, Lanes3, of_lane, set_lane
from balloon_warp.kernels.contact.free_frames import FREE
from balloon_warp.kernels.schedules.lanes.layouts import Layout, of_item, places_of, put_item
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.tables import WorldState, row_of_world, sphere_radius
from balloon_warp.kernels.traits import Traits


@cache
def read_function(traits: Traits, layout: Layout) -> tuple[Any, Any]:
    """The functions that read a frame's beginning, and that show velocities to neighbors."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)
    split = traits.columns.balloon_width

    @wp.func
    def read_balloons(t: LaneTables, state: WorldState, lanes: LaneState, group: wp.int32):
        """Parameters, and what is keyframed."""
        for lane in range(t.lane_count):
            world = places.world(group, lane, t.world_count)
            of_balloons = row_of_world(world, t.all.balloon_numbers.shape[0])
            of_world = row_of_world(world, t.all.world_numbers.shape[0])
            for balloon in range(t.all.inflation_kind.shape[0]):
                for column in range(t.all.balloon_numbers.shape[2]):
                    lanes.numbers[group, balloon, column][lane] = t.all.balloon_numbers[of_balloons, balloon, column]
                for column in range(t.all.world_numbers.shape[1]):
                    lanes.numbers[group, balloon, split + column][lane] = t.all.world_numbers[of_world, column]
                lanes.ramp_begins[group, balloon][lane] = state.inflation_ramp[world, balloon][0]
                lanes.ramp_slopes[group, balloon][lane] = state.inflation_ramp[world, balloon][1]
                lanes.loads[group, balloon][lane] = state.inflation_loads[world, balloon][0]
                lanes.rises[group, balloon][lane] = state.inflation_loads[world, balloon][1]

    @wp.func
    def particle_in_lane(t: LaneTables, item: wp.int32, lane: wp.int32):
        """The particle that a lane holds; what fills up an octet holds the one at its beginning."""
        if wp.static(layout.worlds):
            return item
        else:
            return wp.where(
                t.particles[LANE_COUNT * item + lane] >= 0,
                t.particles[LANE_COUNT * item + lane],
                t.particles[LANE_COUNT * item],
            )

    @wp.func
    def read_lanes(t: LaneTables, state: WorldState, lanes: LaneState, group: wp.int32):
        """What a frame begins with."""
        read_balloons(t, state, lanes, group)
        points = lanes.points[group]
        for item in range(lanes.velocities.shape[1]):
            point = Lanes3()
            velocity = Lanes3()
            for lane in range(t.lane_count):
                world = places.world(group, lane, t.world_count)
                particle = particle_in_lane(t, item, lane)
                point = set_lane(point, lane, state.points[world, particle])
                velocity = set_lane(velocity, lane, state.velocities[world, particle])
            put_item(points, item, point)
            lanes.velocities[group, item] = velocity
        if wp.static(traits.spheres > 0):
            for sphere in range(lanes.sphere_squared_radii.shape[1]):
                for lane in range(t.lane_count):
                    radius = sphere_radius(t.all.spheres, places.world(group, lane, t.world_count), sphere)
                    lanes.sphere_squared_radii[group, sphere][lane] = radius * radius

    @wp.func
    def show_velocities(t: LaneTables, lanes: LaneState, group: wp.int32):
        """As they are before a substep."""
        shown = lanes.shown_velocities[group]
        for item in range(lanes.velocities.shape[1]):
            put_item(shown, item, lanes.velocities[group, item])

    return read_lanes, show_velocities


@cache
def write_function(traits: Traits, layout: Layout) -> Any:
    """The function that writes a frame's end."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)

    @wp.func
    def write_lanes(t: LaneTables, state: WorldState, lanes: LaneState, group: wp.int32, points: Any):
        """What a frame ends with."""
        for item in range(lanes.velocities.shape[1]):
            point = of_item(points, item)
            velocity = lanes.velocities[group, item]
            for lane in range(t.lane_count):
                particle = item
                if wp.static(not layout.worlds):
                    particle = t.particles[LANE_COUNT * item + lane]
                world = places.world(group, lane, t.world_count)
                ends = particle >= 0 and places.is_other(group, lane, t.world_count)
                if wp.static(traits.frames == "free"):
                    ends = ends and lanes.free.verdicts[world] == FREE
                if ends:
                    state.points[world, particle] = of_lane(point, lane)
                    state.velocities[world, particle] = of_lane(velocity, lane)

    return write_lanes

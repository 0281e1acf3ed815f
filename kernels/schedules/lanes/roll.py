"""Spheres that move, and meet each other, in each of eight worlds."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import LANE_COUNT, Lanes3, set_lane
from balloon_warp.kernels.loops.colliding import colliding_function, path_in_arrays, paths_of, put_in_arrays
from balloon_warp.kernels.loops.rolling import course_of, rolling_function
from balloon_warp.kernels.schedules.lanes.layouts import Layout, places_of
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.tables import WorldState, row_of_world, sphere_mass
from balloon_warp.kernels.traits import Traits


@cache
def roll_function(traits: Traits, layout: Layout) -> Any:
    """The function that moves spheres, which may meet each other."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)
    split = traits.columns.balloon_width
    gravity, height, restitution = (
        traits.columns.places[name] - split for name in ("gravity", "ground_height", "ground_restitution")
    )
    roll_by_a_step = rolling_function(traits)
    collide = colliding_function(traits, path_in_arrays, put_in_arrays)[0] if traits.spheres_meet else None

    @wp.func
    def roll_sphere(t: LaneTables, state: WorldState, lanes: LaneState, world: wp.int32, end: float, sphere: wp.int32):
        """One sphere by one substep, under the contacts since the last, which are then cleared."""
        row = row_of_world(world, t.all.world_numbers.shape[0])
        before = course_of(
            state.sphere_positions[world, sphere], state.sphere_velocities[world, sphere],
            state.sphere_spins[world, sphere],
        )  # fmt: skip
        around = wp.vec3(
            t.all.world_numbers[row, gravity], t.all.world_numbers[row, height], t.all.world_numbers[row, restitution]
        )
        pushed = state.sphere_forces[world, sphere] / sphere_mass(t.all.spheres, world, sphere)
        if wp.static(traits.keeps_starts):
            lanes.sphere_starts[world, sphere] = before.position
        course = roll_by_a_step(t.all, world, sphere, end, before, pushed, around)
        state.sphere_positions[world, sphere] = course.position
        state.sphere_velocities[world, sphere] = course.velocity
        if wp.static(traits.spheres_rub):
            state.sphere_spins[world, sphere] = course.spin
        state.sphere_forces[world, sphere] = wp.vec3()

    @wp.func
    def roll(t: LaneTables, state: WorldState, lanes: LaneState, group: wp.int32, end: float):
        """Every sphere by a substep that ends at a time; its center, and where it is asked for its velocity, into the
        lanes."""
        first = places.first_world(group)
        for place in range(places.worlds(group, t.world_count)):
            for sphere in range(lanes.sphere_centers.shape[1]):
                roll_sphere(t, state, lanes, first + place, end, sphere)
            if wp.static(traits.spheres_meet):
                paths = paths_of(lanes.sphere_starts, state.sphere_positions, state.sphere_velocities)
                collide(t.all, paths, state.sphere_spins, first + place, end)
        for sphere in range(lanes.sphere_centers.shape[1]):
            centers = Lanes3()
            for lane in range(LANE_COUNT):
                center = state.sphere_positions[places.world(group, lane, t.world_count), sphere]
                centers = set_lane(centers, lane, center)
            lanes.sphere_centers[group, sphere] = centers
            if wp.static(traits.impulses):
                motions = Lanes3()
                for lane in range(LANE_COUNT):
                    motion = state.sphere_velocities[places.world(group, lane, t.world_count), sphere]
                    motions = set_lane(motions, lane, motion)
                lanes.sphere_motions[group, sphere] = motions

    return roll

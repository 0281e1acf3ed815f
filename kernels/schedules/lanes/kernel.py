"""The schedules `lanes` and `octets`: a thread advances eight worlds, or one, by a whole frame, eight lanes at a time.
For the CPU."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import Lanes, Lanes3, larger, times
from balloon_warp.kernels.laws.inflation import NORMAL_FORCE
from balloon_warp.kernels.loops.net_force import net_force_function
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phases.inflate import inflation_of
from balloon_warp.kernels.phases.move import drift_of, kick, response
from balloon_warp.kernels.schedules.lanes.contact import (
    correct_function,
    leave_all_function,
    leave_function,
)
from balloon_warp.kernels.schedules.lanes.free import free_functions
from balloon_warp.kernels.schedules.lanes.gas import jet_in_lanes, load_in_lanes, pump_in_lanes, swell_in_lanes
from balloon_warp.kernels.schedules.lanes.hinges import bend_function
from balloon_warp.kernels.schedules.lanes.layouts import Layout, of_item, one_of_item, put_item
from balloon_warp.kernels.schedules.lanes.loops import lane_loops
from balloon_warp.kernels.schedules.lanes.membranes import stretch_function
from balloon_warp.kernels.schedules.lanes.refresh import refresh_function
from balloon_warp.kernels.schedules.lanes.roll import roll_function
from balloon_warp.kernels.schedules.lanes.state import read_function, write_function
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.schedules.lanes.touch import touch_function
from balloon_warp.kernels.schedules.lanes.wear import peaks_functions
from balloon_warp.kernels.tables import WorldState
from balloon_warp.kernels.traits import Traits


@cache
def own_function(traits: Traits, layout: Layout) -> Any:
    """The function that reads what an item knows of itself."""
    LaneTables, LaneState, LaneOwn = lane_structs(layout)  # noqa: N806 - types

    @wp.func
    def own_of(t: LaneTables, lanes: LaneState, group: wp.int32, balloon: wp.int32, item: wp.int32):
        own = LaneOwn()
        own.group = group
        own.item = item
        own.balloon = balloon
        own.kind = t.all.inflation_kind[balloon]
        own.share = t.shares[item]
        own.n = lanes.numbers[group, balloon]
        own.mass = times(own.share, own.n[wp.static(traits.columns.places["mass"])])
        return own

    return own_of


@cache
def gas_steps(traits: Traits, layout: Layout) -> Any:
    """The function that takes the items of all balloons as far as their loads."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    own_of = own_function(traits, layout)
    net_force = net_force_function(traits, lane_loops(traits, layout))
    swell = swell_in_lanes(traits, layout)
    find_load, take_loads = load_in_lanes(traits, layout)
    jet = jet_in_lanes(traits, layout) if traits.jets else None
    Swellings = wp.types.matrix(shape=(5, 8), dtype=wp.float32)  # noqa: N806 - a type

    @wp.func
    def pull_and_swell_one(
        t: LaneTables,
        state: WorldState,
        lanes: LaneState,
        group: wp.int32,
        balloon: wp.int32,
        points: Any,
        time: float,
        time_in_frame: float,
    ):
        """Every item of a balloon as far as its free velocity; then the balloon's load."""
        origin = one_of_item(points, t.item_offsets[balloon])
        swellings = Swellings()
        kind = t.all.inflation_kind[balloon]
        for item in range(t.item_offsets[balloon], t.item_offsets[balloon + 1]):
            own = own_of(t, lanes, group, balloon, item)
            point = of_item(points, item)
            velocity = lanes.velocities[group, item]
            force, area_vector, _facing = net_force(
                t, points, lanes.shown_velocities[group], own, item, point, velocity, time
            )
            if wp.static(jet is not None):
                force += jet(t, lanes, own, points, point, time)
            masses = times(own.share, lanes.masses[group, balloon])
            free = kick(velocity, force, response(masses, t.step_seconds))
            lanes.free_velocities[group, item] = free
            lanes.area_vectors[group, item] = area_vector
            if kind != NORMAL_FORCE:
                end = time + t.step_seconds
                swellings += swell(
                    t, state, lanes, own, end, masses, point - origin, point, velocity, free, area_vector
                )
        if kind != NORMAL_FORCE:
            find_load(t, state, group, balloon, swellings, time_in_frame)

    @wp.func
    def pull_and_swell(
        t: LaneTables,
        state: WorldState,
        lanes: LaneState,
        group: wp.int32,
        points: Any,
        time: float,
        time_in_frame: float,
    ):
        """Every item as far as its free velocity, and the loads of all balloons."""
        for balloon in range(t.all.inflation_kind.shape[0]):
            pull_and_swell_one(t, state, lanes, group, balloon, points, time, time_in_frame)
        take_loads(t, state, lanes, group, time)

    return pull_and_swell


@cache
def particle_steps(traits: Traits, layout: Layout) -> Any:
    """The function that takes the items of a balloon through a substep, or where there is gas through what is left."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    own_of = own_function(traits, layout)
    net_force = net_force_function(traits, lane_loops(traits, layout)) if not traits.gas else None
    inflation = inflation_of(traits)
    drift = drift_of(traits)
    leave = leave_function(traits, layout) if traits.leaves_at_once else None
    squared_speed = free_functions(traits, layout)[1]

    @wp.func
    def push_and_move(
        t: LaneTables,
        state: WorldState,
        lanes: LaneState,
        group: wp.int32,
        balloon: wp.int32,
        points: Any,
        new_points: Any,
        time: float,
        time_in_frame: float,
    ):
        """Every item of a balloon through what is left of the substep."""
        k_normal = lanes.ramp_begins[group, balloon] + lanes.ramp_slopes[group, balloon] * time_in_frame
        pressure = k_normal
        rise = Lanes()
        if wp.static(traits.gas):
            pressure = lanes.loads[group, balloon]
            rise = lanes.rises[group, balloon]
        for item in range(t.item_offsets[balloon], t.item_offsets[balloon + 1]):
            own = own_of(t, lanes, group, balloon, item)
            point = of_item(points, item)
            old_velocity = lanes.velocities[group, item]
            velocity = old_velocity
            masses = own.mass
            force = Lanes3()
            area_vector = Lanes3()
            if wp.static(traits.gas):
                velocity = lanes.free_velocities[group, item]
                area_vector = lanes.area_vectors[group, item]
                masses = times(own.share, lanes.masses[group, balloon])
            else:
                pull, area, _facing = net_force(
                    t, points, lanes.shown_velocities[group], own, item, point, old_velocity, time
                )
                force = pull
                area_vector = area
            aim = area_vector
            if wp.static(traits.aims):
                aim = lanes.aims[group, item]
            push = inflation(own.kind, k_normal, pressure, rise, t.up, point, aim, area_vector)
            velocity = kick(velocity, force + push, response(masses, t.step_seconds))
            point = drift(point, old_velocity, velocity, t.step_seconds)
            if wp.static(traits.keeps_inflations):
                lanes.inflations[group, item] = push
            if wp.static(traits.leaves_at_once):
                out, after = leave(t, state, lanes, own, time + t.step_seconds, point, velocity, push)
                point = out
                velocity = after
            if wp.static(traits.frames == "free"):
                lanes.fastest[group] = larger(
                    lanes.fastest[group], squared_speed(t, of_item(points, item), point, velocity)
                )
            lanes.velocities[group, item] = velocity
            put_item(new_points, item, point)

    return push_and_move


@cache
def lanes_kernel(traits: Traits, layout: Layout) -> Any:
    """The kernel that advances groups of worlds, or worlds."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    read_lanes, show_velocities = read_function(traits, layout)
    write_lanes = write_function(traits, layout)
    push_and_move = particle_steps(traits, layout)
    # What a scene does not have is not made: a function takes Warp some milliseconds.
    refresh_aims = refresh_function(traits, layout) if traits.aims else None
    roll = roll_function(traits, layout) if traits.spheres else None
    bend = bend_function(traits, layout) if traits.has("hinge") else None
    stretch = stretch_function(traits, layout) if traits.membranes else None
    pump = pump_in_lanes(traits, layout) if traits.gas else None
    pull_and_swell = gas_steps(traits, layout) if traits.gas else None
    correct = correct_function(traits, layout) if traits.corrected else None
    touch = touch_function(traits, layout) if traits.impulses else None
    leave_all = leave_all_function(traits, layout) if traits.leaves_together else None
    read_peaks, write_peaks = peaks_functions(traits, layout) if traits.softens else (None, None)
    any_free, _, note_hurried_worlds = free_functions(traits, layout)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def advance_lanes(
        # model
        t: LaneTables,
        first_group: wp.int32,
        # state in and out
        state: WorldState,
        lanes: LaneState,
    ):
        """A thread a group: one frame."""
        group = first_group + wp.tid()
        if wp.static(traits.frames == "free"):
            if not any_free(t, lanes, group):
                return
        read_lanes(t, state, lanes, group)
        if wp.static(read_peaks is not None):
            read_peaks(t, state, lanes, group)
        points = lanes.points[group]
        new_points = lanes.other_points[group]
        for substep in range(t.all.substeps):
            if substep % 2 == 1:
                points = lanes.other_points[group]
                new_points = lanes.points[group]
            else:
                points = lanes.points[group]
                new_points = lanes.other_points[group]
            time_in_frame = float(substep) * t.step_seconds
            time = float(state.frame[0]) * t.all.frame_seconds + time_in_frame
            if wp.static(traits.aims):
                if wp.static(traits.fresh_normals) or substep == 0:
                    refresh_aims(t, lanes, group, points)
            if wp.static(traits.spheres > 0):
                roll(t, state, lanes, group, time + t.step_seconds)
            if wp.static(traits.looks_at_velocities):
                show_velocities(t, lanes, group)
            if wp.static(traits.has("hinge")):
                bend(t, group, points)
            if wp.static(stretch is not None):
                stretch(t, lanes, group, points)
            if wp.static(traits.gas):
                pump(t, state, lanes, group, time_in_frame, time)
                pull_and_swell(t, state, lanes, group, points, time, time_in_frame)
            for balloon in range(t.all.inflation_kind.shape[0]):
                push_and_move(t, state, lanes, group, balloon, points, new_points, time, time_in_frame)
            if wp.static(traits.corrected):
                correct(t, lanes, group, new_points)
            if wp.static(traits.impulses):
                touch(t, state, lanes, group, new_points)
            if wp.static(traits.leaves_together):
                leave_all(t, state, lanes, group, time + t.step_seconds, new_points)
        if wp.static(traits.frames == "free"):
            note_hurried_worlds(t, lanes, group)
        write_lanes(t, state, lanes, group, new_points)
        if wp.static(write_peaks is not None):
            write_peaks(t, state, lanes, group)

    return advance_lanes

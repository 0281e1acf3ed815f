"""Kernel that runs sweeps over contacts backwards, after it has done them again."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.ground_stops import forget_stops, keep_stops, note_stop, stops_function
from balloon_warp.kernels.adjoints.particle_sums import weighing_function
from balloon_warp.kernels.adjoints.ridge_balls import keep_balls, restore_balls
from balloon_warp.kernels.adjoints.sweeps import (
    FINDS,
    PARTS,
    PUSHES,
    SweepBack,
    SweepBars,
    keep_course,
    stage_function,
    take_pairs,
)
from balloon_warp.kernels.contact.kind import sweep_listing
from balloon_warp.kernels.contact.sweeps import marking_functions, pushing_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_block, block_barrier
from balloon_warp.kernels.working import Working


@cache
def sweeping_function(back: SweepBack, every: Features) -> Any:
    """Return the function that does the sweeps again, keeps the velocities before each, and returns their number."""
    features, most_sweeps = back.of.seen(every), back.of.most(every)
    mark_pushed, _ = marking_functions(features)
    push_all = pushing_function(features, note_stop)

    @wp.func
    def sweep_again(
        t: Tables, state: WorldState, working: Working, bars: SweepBars, world: wp.int32, thread: wp.int32,
        count: wp.int32, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        sweep = wp.int32(0)
        again = count > 0
        while again and sweep < most_sweeps:
            keep_balls(state, bars, world, thread, sweep)
            keep_course(working, bars, world, thread, count, sweep, velocities)
            forget_stops(working, world, thread, count)
            again = any_in_block(mark_pushed(t, state, working, world, thread, count, velocities))
            push_all(t, state, working, world, thread, points, velocities, 1.0)
            keep_stops(working, bars, world, thread, count, sweep)
            sweep += 1
        return sweep

    return sweep_again


@cache
def sweeps_back_kernel(back: SweepBack, every: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that runs the sweeps of a kind of contacts backwards.

    Args:
        columns: of the numbers that are derived by.
    """
    features = back.of.seen(every)
    list_all, sweep_again = sweep_listing(back.of, every, True), sweeping_function(back, every)
    mark_pushed, mark_overlaps = marking_functions(features)
    part_all, stops_back = pushing_function(features, note_stop), stops_function(features, columns)
    stage_back, weigh_back = stage_function(back, every), weighing_function(features, columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def turn_sweeps_back(
        t: Tables, state: WorldState, working: Working, time_in_frame: float, first_points: wp.array2d[wp.vec3],
        all_points: wp.array2d[wp.vec3], all_velocities: wp.array2d[wp.vec3], bars: SweepBars,
    ):  # fmt: skip
        """Turn the derivatives by the state after contacts into those by the state before; a block a world.

        Args:
            state: whose spheres are as they came to contacts, and are moved again.
            first_points: Places before contacts.
            all_points: The same, which are moved again.
        """
        world, thread = wp.tid()
        end = time_in_frame + t.step_seconds
        points = first_points[world]
        velocities = all_velocities[world]
        count, overlaps = list_all(t, state, working, world, thread, end, all_points[world], velocities)
        sweeps = sweep_again(t, state, working, bars, world, thread, count, all_points[world], velocities)
        if overlaps:
            if wp.static(features.ground):
                mark_overlaps(t, working, world, thread, count)
                block_barrier()
                forget_stops(working, world, thread, count)
                part_all(t, state, working, world, thread, all_points[world], velocities, 0.0)
                keep_stops(working, bars, world, thread, count, sweeps)
                stops_back(t, working, bars, world, thread, count, sweeps, 0.0)
            mark_overlaps(t, working, world, thread, count)
            block_barrier()
            stage_back(t, state, working, bars, world, thread, count, PARTS, 0, end, points)
        while sweeps > 0:
            sweeps -= 1
            restore_balls(state, bars, world, thread, sweeps)
            stops_back(t, working, bars, world, thread, count, sweeps, 1.0)
            mark_pushed(t, state, working, world, thread, count, bars.courses[sweeps][world])
            block_barrier()
            stage_back(t, state, working, bars, world, thread, count, PUSHES, sweeps, end, points)
        if count > 0:
            stage_back(t, state, working, bars, world, thread, count, FINDS, 0, end, points)
            if thread == 0:
                take_pairs(bars, world)
            for particle in range(thread, t.particles.balloon.shape[0], wp.block_dim()):
                weigh_back(t, working, bars, world, particle)

    return turn_sweeps_back

"""Kernel that runs edges that meet backwards, after it has let them meet again."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.crossings import (
    FINDS,
    PARTS,
    PUSHES,
    EdgeBars,
    keep_course,
    stage_function,
    take_pairs,
)
from balloon_warp.kernels.adjoints.ground_stops import forget_stops, keep_stops, note_stop, stops_function
from balloon_warp.kernels.adjoints.particle_sums import weighing_function
from balloon_warp.kernels.contact.edges import (
    MOST_SWEEPS,
    catching_all_function,
    mark_overlaps,
    mark_pushed,
    pushing_all_function,
)
from balloon_warp.kernels.contact.list_lengths import PAIRS
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import any_in_block, block_barrier
from balloon_warp.kernels.working import Working


@cache
def sweeping_function(features: Features) -> Any:
    """Return the function that lets edges meet again, keeps how fast they are, and returns the number of sweeps."""
    push_all = pushing_all_function(features, note_stop)

    @wp.func
    def sweep_again(
        t: Tables, working: Working, bars: EdgeBars, world: wp.int32, thread: wp.int32, count: wp.int32,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        sweep = wp.int32(0)
        again = count > 0
        while again and sweep < MOST_SWEEPS:
            keep_course(working, bars, world, thread, count, sweep, velocities)
            forget_stops(working, world, thread, count)
            again = any_in_block(mark_pushed(t, working, world, thread, count, velocities))
            push_all(t, working, world, thread, points, velocities, 1.0)
            keep_stops(working, bars, world, thread, count, sweep)
            sweep += 1
        return sweep

    return sweep_again


@cache
def crossings_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that runs meeting edges backwards.

    Args:
        columns: of the numbers that are derived by.
    """
    catch_all, sweep_again = catching_all_function(features, leaves_out=False), sweeping_function(features)
    part_all, stops_back = pushing_all_function(features, note_stop), stops_function(features, columns)
    stage_back, weigh_back = stage_function(features), weighing_function(features, columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def turn_crossings_back(
        t: Tables, working: Working, first_points: wp.array2d[wp.vec3], all_points: wp.array2d[wp.vec3],
        all_velocities: wp.array2d[wp.vec3], bars: EdgeBars,
    ):  # fmt: skip
        """Turn the derivatives by the state after edges meet into those by the state before; a block a world.

        Args:
            first_points: Places before edges meet.
            all_points: The same, which are moved again.
        """
        world, thread = wp.tid()
        if working.list_lengths[world, PAIRS] > 0:
            velocities = all_velocities[world]
            count, overlap = catch_all(t, working, world, thread, all_points[world], velocities)
            sweeps = sweep_again(t, working, bars, world, thread, count, all_points[world], velocities)
            if overlap:
                mark_overlaps(working, world, thread, count)
                block_barrier()
                if wp.static(features.ground):
                    forget_stops(working, world, thread, count)
                    part_all(t, working, world, thread, all_points[world], velocities, 0.0)
                    keep_stops(working, bars, world, thread, count, sweeps)
                    stops_back(t, working, bars, world, thread, count, sweeps, 0.0)
                    mark_overlaps(working, world, thread, count)
                block_barrier()
                stage_back(t, working, bars, world, thread, count, PARTS, 0, first_points[world])
            while sweeps > 0:
                sweeps -= 1
                stops_back(t, working, bars, world, thread, count, sweeps, 1.0)
                mark_pushed(t, working, world, thread, count, bars.courses[sweeps][world])
                block_barrier()
                stage_back(t, working, bars, world, thread, count, PUSHES, sweeps, first_points[world])
            if count > 0:
                stage_back(t, working, bars, world, thread, count, FINDS, 0, first_points[world])
                if thread == 0:
                    take_pairs(bars, world)
                for particle in range(thread, t.particles.balloon.shape[0], wp.block_dim()):
                    weigh_back(t, working, bars, world, particle)

    return turn_crossings_back

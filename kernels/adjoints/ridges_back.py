"""Kernel that runs faces that meet ridges backwards, after it has let them meet again."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.particle_sums import weighing_function
from balloon_warp.kernels.adjoints.ridge_balls import keep_balls, restore_balls
from balloon_warp.kernels.adjoints.ridges import FINDS, PARTS, PUSHES, RidgeBars, keep_course, stage_function
from balloon_warp.kernels.contact.ridges import (
    MOST_SWEEPS,
    catching_all_function,
    parting_functions,
    pushing_all_function,
    sweeping_functions,
)
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working


@cache
def ridges_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that runs faces that meet ridges backwards.

    Args:
        columns: of the numbers that are derived by.
    """
    catch_all, push_all = catching_all_function(features), pushing_all_function(features)
    find_pushed, find_overlaps = sweeping_functions(features)[0], parting_functions(features)[0]
    stage_back, weigh_back = stage_function(features), weighing_function(features, columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def turn_ridges_back(
        t: Tables, state: WorldState, working: Working, time_in_frame: float, first_points: wp.array2d[wp.vec3],
        all_points: wp.array2d[wp.vec3], all_velocities: wp.array2d[wp.vec3], bars: RidgeBars,
    ):  # fmt: skip
        """Turn the derivatives by the state after faces meet ridges into those by the state before; a block a world.

        Args:
            state: whose spheres are as they came to ridges, and are moved again.
            first_points: Places before faces meet ridges.
            all_points: The same, which are moved again.
        """
        world, thread = wp.tid()
        end = time_in_frame + t.step_seconds
        points = first_points[world]
        velocities = all_velocities[world]
        count = catch_all(t, state, working, world, thread, end, all_points[world], velocities)
        if count > 0:
            sweeps = wp.int32(0)
            again = bool(True)
            while again and sweeps < MOST_SWEEPS:
                keep_balls(state, bars, world, thread, sweeps)
                keep_course(working, bars, world, thread, count, sweeps, velocities)
                again = push_all(t, state, working, world, thread, count, all_points[world], velocities)
                sweeps += 1
            find_overlaps(t, working, world, thread, count)
            block_barrier()
            stage_back(t, state, working, bars, world, thread, count, PARTS, 0, end, points)
            while sweeps > 0:
                sweeps -= 1
                restore_balls(state, bars, world, thread, sweeps)
                find_pushed(t, state, working, world, thread, count, bars.courses[sweeps][world])
                block_barrier()
                stage_back(t, state, working, bars, world, thread, count, PUSHES, sweeps, end, points)
            stage_back(t, state, working, bars, world, thread, count, FINDS, 0, end, points)
            for particle in range(thread, t.particles.balloon.shape[0], wp.block_dim()):
                weigh_back(t, working, bars, world, particle)

    return turn_ridges_back

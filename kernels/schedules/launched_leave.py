"""Those particles leave obstacles that were put off when all moved, see `later`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.obstacles import around_function, standing_function
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.schedules.later import turn_of
from balloon_warp.kernels.schedules.launched import Working
from balloon_warp.kernels.substep import end_of_step
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@cache
def leave_later_kernel(traits: Traits, fast_math: bool = False) -> Any:
    """The kernel by which they do."""
    _, read_own = own_functions(traits.columns, traits.balloons)
    around_own = around_function(traits)
    stand = standing_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options={**OPTIONS, "fast_math": fast_math})
    def leave_later(
        # model
        t: Tables,
        threads: wp.int32,
        time_in_frame: float,
        # state in and out
        state: WorldState,
        working: Working,
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
    ):
        """Some threads a world."""
        world, thread = wp.tid()
        turn = turn_of(t, time_in_frame)
        if thread == 0:
            working.later_counts[world, 1 - turn] = 0
        for place in range(thread, working.later_counts[world, turn], threads):
            particle = working.later[world, place]
            own = read_own(t, world, particle)
            around = around_own(own, end_of_step(t, state.frame, time_in_frame))
            point, velocity = stand(t, around, points[world, particle], velocities[world, particle])
            points[world, particle] = point
            velocities[world, particle] = velocity

    return leave_later

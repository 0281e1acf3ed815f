"""Those particles end their substep that were put off when all moved, see `later`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.schedules.later import later_functions, turn_of
from balloon_warp.kernels.schedules.launched import inertia_function
from balloon_warp.kernels.schedules.working import Working
from balloon_warp.kernels.substep import end_of_step, response
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@cache
def end_later_kernel(traits: Traits, fast_math: bool = False) -> Any:
    """The kernel by which they do."""
    _, read_own = own_functions(traits.columns, traits.balloons)
    inertia = inertia_function(traits)
    _, _, end_later = later_functions(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options={**OPTIONS, "fast_math": fast_math})
    def end_those_put_off(
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
            gain = response(inertia(working, own), t.step_seconds)
            point, velocity = end_later(
                t, working, own, gain, end_of_step(t, state.frame, time_in_frame), points[world, particle],
                velocities[world, particle],
            )  # fmt: skip
            points[world, particle] = point
            velocities[world, particle] = velocity

    return end_those_put_off

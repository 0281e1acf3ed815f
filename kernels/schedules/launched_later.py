"""Those particles end their substep that were put off when all moved, see `later`.

Where a particle moves it is noted whether it may stand on something, and where contacts are found whether they push it.
Each block goes through the notes of so many particles, and makes a list of those that are put off, for its threads.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.schedules.later import later_functions
from balloon_warp.kernels.schedules.launched import inertia_function
from balloon_warp.kernels.schedules.notes import eight_bytes_in, list_marked
from balloon_warp.kernels.schedules.warps import block_barrier, count_at, put_count, shared_words
from balloon_warp.kernels.schedules.working import Working
from balloon_warp.kernels.substep import end_of_step, response
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits

PARTICLES_OF_BLOCK = wp.constant(512)
"""of all worlds; a whole number of eights, as so many notes are read at once"""


@cache
def end_later_kernel(traits: Traits, fast_math: bool = False) -> Any:
    """The kernel by which they do."""
    _, read_own = own_functions(traits.columns, traits.balloons)
    inertia = inertia_function(traits)
    _, from_where, end_later = later_functions(traits)
    words = shared_words("put off", 1 + int(PARTICLES_OF_BLOCK))

    @wp.func
    def notes_of_eight(working: Working, first: wp.int32):
        """Bytes that are not 0 where particles are put off, from one on."""
        notes = wp.uint64(0)
        if wp.static(traits.stands):
            notes = eight_bytes_in(working.near_solids, first)
        if wp.static(traits.pushes_come_last):
            notes = notes | eight_bytes_in(working.touched, first)
        return notes

    @wp.func
    def list_those(working: Working, first: wp.int32, thread: wp.int32):
        """Of a block's particles from a first on, counted through all worlds; and how many they are."""
        if thread == 0:
            put_count(words(), 0, 0)
        block_barrier()
        for eight in range(8 * thread, PARTICLES_OF_BLOCK, 8 * wp.block_dim()):
            list_marked(words(), notes_of_eight(working, first + eight), first + eight)
        block_barrier()
        return count_at(words(), 0)

    @wp.kernel(module="unique", enable_backward=False, module_options={**OPTIONS, "fast_math": fast_math})
    def end_those_put_off(
        # model
        t: Tables,
        time_in_frame: float,
        # state in and out
        state: WorldState,
        working: Working,
        # state in
        old_points: wp.array2d[wp.vec3],
        # state in and out
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
    ):
        """A block so many particles."""
        block, thread = wp.tid()
        first = block * PARTICLES_OF_BLOCK
        particles = points.shape[1]
        count = list_those(working, first, thread)
        for place in range(thread, count, wp.block_dim()):
            number = count_at(words(), 1 + place)
            world = number // particles
            particle = number % particles
            own = read_own(t, world, particle)
            point, velocity = end_later(
                t, working, own, response(inertia(working, own), t.step_seconds),
                end_of_step(t, state.frame, time_in_frame),
                from_where(old_points[world, particle], points[world, particle]), velocities[world, particle],
            )  # fmt: skip
            points[world, particle] = point
            velocities[world, particle] = velocity

    return end_those_put_off

"""A particle's substep: it sums its forces, moves, and leaves obstacles. No float atomics.

`gather` sums over a particle's springs, strings, hinges and faces; `scatter` takes what their threads have added up.
One launch does all of a substep, unless particles have to wait for each other: then one goes as far as their free
velocities, and another on from there.
"""

from functools import cache
from typing import Any, Literal

import warp as wp

from balloon_warp.kernels.loops.jets import hole_jet_loop, jet_loop
from balloon_warp.kernels.loops.net_force import Loops, net_force_function, scalar_loops
from balloon_warp.kernels.memory import put_vector_in, vector_at, vector_in
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.schedules.launched import inertia_function, pushing_function
from balloon_warp.kernels.schedules.pushes import take_pushes
from balloon_warp.kernels.schedules.working import Working
from balloon_warp.kernels.substep import kick, response, time_of
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits

MOST_REGISTERS = 128
"""of a thread, so that a multiprocessor has two blocks of 256 where particles meet obstacles, too"""
FEW_REGISTERS = 64
"""where these are put off: enough for springs, and a multiprocessor has four"""


@cache
def gathering_loops(traits: Traits) -> Loops:
    """Over all that acts on a particle."""
    return scalar_loops(traits, vector_at)


@cache
def summed_loops(traits: Traits) -> Loops:
    """What others have added up: forces of springs, strings, hinges and faces, and area vectors."""

    @wp.func
    def summed_force(
        t: Tables, points: Any, velocities: Any, own: Any, working: Working, point: Any, velocity: Any, time: float
    ):
        """[N]"""
        return working.forces[own.world, own.number]

    @wp.func
    def summed_area_vector(t: Tables, points: Any, own: Any, working: Working, point: Any):
        """[m^2]"""
        return working.area_vectors[own.world, own.number]

    return scalar_loops(traits, vector_at, summed_force, summed_area_vector)._replace(others=None)


@cache
def advance_kernel(
    traits: Traits,
    loops: Loops | None,
    until: Literal["forces", "free velocities", "end"] = "end",
    fast_math: bool = False,
    puts_off: bool = False,
) -> Any:
    """The kernel that advances particles.

    Args:
        loops: over what acts on a particle; None where free velocities already have all of it but the inflation.
        until: how far. Forces are all but the inflation's; free velocities are those that they give.
        puts_off: whether those are put off that contacts push or that may meet an obstacle, see `later`.
    """
    _, read_own = own_functions(traits.columns, traits.balloons)
    net_force = net_force_function(traits, loops) if loops else None
    inertia = inertia_function(traits)
    push_and_move = pushing_function(traits, puts_off)
    jet = jet_loop(traits, vector_at) if traits.jets else None
    jet_of_holes = hole_jet_loop(vector_at) if traits.bursts else None

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=FEW_REGISTERS if puts_off and not traits.membranes else MOST_REGISTERS,
        module_options={**OPTIONS, "fast_math": fast_math},
    )
    def advance_particles(
        # model
        t: Tables,
        time_in_frame: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # state in and out
        state: WorldState,
        working: Working,
        free_velocities: wp.array2d[wp.vec3],
        # state out
        new_points: wp.array2d[wp.vec3],
        new_velocities: wp.array2d[wp.vec3],
    ):
        """A thread a (world, particle); the spheres have moved already. Where a particle looks at its neighbors'
        points or velocities, the new ones are not in the place of the old."""
        world, particle = wp.tid()
        own = read_own(t, world, particle)
        point = vector_in(points, world, particle)
        velocity = vector_in(velocities, world, particle)
        free_velocity = velocity
        force = wp.vec3()
        area_vector = wp.vec3()
        if wp.static(net_force is not None):
            time = time_of(t, state.frame, time_in_frame)
            pull, area, _facing = net_force(t, points[world], velocities[world], own, working, point, velocity, time)
            force = pull
            area_vector = area
            if wp.static(traits.touches and not traits.pushes_come_last and until != "forces"):
                force += take_pushes(working, world, particle)
            if wp.static(jet is not None):
                force += jet(
                    t.necks, points[world], t.necks.weights[particle], own.balloon,
                    state.inflation_loads[world, own.balloon], wp.dot(point, t.up), time, own.n,
                )  # fmt: skip
            if wp.static(jet_of_holes is not None):
                if state.bursts[world, own.balloon][1] > 0.0:
                    force += jet_of_holes(t, points[world], own, state.inflation_loads[world, own.balloon], point)
        else:
            free_velocity = free_velocities[world, particle]
            if wp.static(traits.pressures):
                area_vector = working.area_vectors[world, particle]
        if wp.static(until == "end"):
            new_point, new_velocity = push_and_move(
                t, state, working, own, inertia(working, own), force, area_vector, point, velocity, free_velocity,
                time_in_frame,
            )  # fmt: skip
            put_vector_in(new_points, world, particle, new_point)
            put_vector_in(new_velocities, world, particle, new_velocity)
        else:
            if wp.static(traits.measures_areas):
                working.area_vectors[world, particle] = area_vector
            if wp.static(until == "forces"):
                working.forces[world, particle] = force
            else:
                free_velocities[world, particle] = kick(
                    velocity, force, response(inertia(working, own), t.step_seconds)
                )

    return advance_particles

"""The `gather` schedule: a thread a particle, which sums its forces, moves, and leaves obstacles. No float atomics."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.net_force import net_force_function, scalar_loops
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.schedules.launched import Working, inertia_function, pushing_function
from balloon_warp.kernels.substep import kick, time_of
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@cache
def advance_kernel(traits: Traits) -> Any:
    """The kernel that advances particles by a substep, where no gas makes them wait for each other."""
    _, read_own = own_functions(traits.columns)
    net_force = net_force_function(traits, scalar_loops(traits, vector_at))
    push_and_move = pushing_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fast_math": True})
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
        # state out
        new_points: wp.array2d[wp.vec3],
        new_velocities: wp.array2d[wp.vec3],
    ):
        """A thread a (world, particle); the spheres have moved already. `new_points` is not `points`, and
        `new_velocities` is not `velocities` where a particle looks at its neighbors'."""
        world, particle = wp.tid()
        own = read_own(t, world, particle)
        point = points[world, particle]
        velocity = velocities[world, particle]
        time = time_of(t, state.frame, time_in_frame)
        force, area_vector = net_force(t, points[world], velocities[world], own, own.number, point, velocity, time)
        new_point, new_velocity = push_and_move(
            t, state, working, own, own.mass, force, area_vector, point, velocity, velocity, time_in_frame
        )
        new_points[world, particle] = new_point
        new_velocities[world, particle] = new_velocity

    return advance_particles


@cache
def pull_kernel(traits: Traits) -> Any:
    """The kernel that begins a substep: all forces but the inflation."""
    _, read_own = own_functions(traits.columns)
    net_force = net_force_function(traits, scalar_loops(traits, vector_at))
    inertia = inertia_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fast_math": True})
    def pull_particles(
        # model
        t: Tables,
        time_in_frame: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        state: WorldState,
        # out
        working: Working,
        new_velocities: wp.array2d[wp.vec3],
    ):
        """A thread a (world, particle): its velocity without the inflation, and its area vector."""
        world, particle = wp.tid()
        own = read_own(t, world, particle)
        point = points[world, particle]
        velocity = velocities[world, particle]
        time = time_of(t, state.frame, time_in_frame)
        force, area_vector = net_force(t, points[world], velocities[world], own, own.number, point, velocity, time)
        working.area_vectors[world, particle] = area_vector
        new_velocities[world, particle] = kick(velocity, force, inertia(working, own), t.step_seconds)

    return pull_particles


@cache
def force_kernel(traits: Traits) -> Any:
    """The kernel that shows forces: all but the inflation's, and the area vectors."""
    _, read_own = own_functions(traits.columns)
    net_force = net_force_function(traits, scalar_loops(traits, vector_at))

    @wp.kernel(module="unique", enable_backward=False)
    def sum_forces(
        # model
        t: Tables,
        time_in_frame: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        frame: wp.array[wp.int32],
        # out
        area_vectors: wp.array2d[wp.vec3],
        forces: wp.array2d[wp.vec3],
    ):
        """A thread a (world, particle)."""
        world, particle = wp.tid()
        own = read_own(t, world, particle)
        point = points[world, particle]
        velocity = velocities[world, particle]
        time = time_of(t, frame, time_in_frame)
        force, area_vector = net_force(t, points[world], velocities[world], own, own.number, point, velocity, time)
        if wp.static(traits.measures_areas):
            area_vectors[world, particle] = area_vector
        forces[world, particle] = force

    return sum_forces

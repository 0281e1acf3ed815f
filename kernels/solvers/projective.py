"""Fast simulation of mass-spring systems (Liu et al. 2013): backward Euler by local and global steps.

A substep h seeks the displacements u that minimize

    g(u) = sum_p (m + h c) |u - w|^2 / (2 h^2) + E(x + u)

where E is the energy of springs and strings, c the damping, and w the displacement that there would be without them.
The local step projects each spring on its rest length: its vector d becomes L d/|d|. The global step then solves the
linear system (M + h C + h^2 L) u = (M + h C) w + h^2 (pull of the projections), whose matrix A never changes. Here it
is solved for the increment, which float32 resolves better,

    A du = (m + h c) (w - u) + h^2 F(x + u)

since k (L d/|d| - d) is the force of a spring: the local step is Hooke's law, at the particles of the last iteration. A
slack string has itself as projection, so it has no force either. Each iteration lowers g, whatever h is.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contiguous import vector_at
from balloon_warp.kernels.gather import leaving_obstacles
from balloon_warp.kernels.inflation import inflation_force
from balloon_warp.kernels.motion import lift
from balloon_warp.kernels.pull import pull_of_strings, spring_puller
from balloon_warp.kernels.tables import (
    BodyTable,
    ObstacleTable,
    SpringTable,
    StringTable,
    particle_damping,
    particle_mass,
    row_of_world,
)
from balloon_warp.kernels.traits import Traits


@wp.func
def inertia(bodies: BodyTable, world: wp.int32, particle: wp.int32, step_seconds: float):
    """m + h c [kg]: what holds a particle back in a step of h, damping included; 0 for a fixed particle."""
    return particle_mass(bodies, world, particle) + step_seconds * particle_damping(bodies, world, particle)


@wp.func
def inflation_of(
    bodies: BodyTable,
    inflation_aims: wp.array2d[wp.vec3],
    inflation_ramp: wp.array2d[wp.vec2],
    world: wp.int32,
    particle: wp.int32,
    time_in_frame: float,
):
    """The inflation force on a particle [N]."""
    ramp = inflation_ramp[world, bodies.balloon[particle]]
    return inflation_force(ramp[0] + ramp[1] * time_in_frame, inflation_aims[world, particle])


@wp.kernel(enable_backward=False)
def foresee_displacements(
    # model
    bodies: BodyTable,
    step_seconds: float,
    time_in_frame: float,
    # state in
    inflation_aims: wp.array2d[wp.vec3],
    inflation_ramp: wp.array2d[wp.vec2],
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # state out
    free_displacements: wp.array2d[wp.vec3],
    displacements: wp.array2d[wp.vec3],
    trial_points: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): w, where the iterations begin."""
    world, particle = wp.tid()
    free = wp.vec3()
    mass = particle_mass(bodies, world, particle)
    if mass > 0.0:
        gravity = bodies.gravity[row_of_world(world, bodies.gravity.shape[0])]
        helium = bodies.helium[row_of_world(world, bodies.helium.shape[0]), bodies.balloon[particle]]
        inflation = inflation_of(bodies, inflation_aims, inflation_ramp, world, particle, time_in_frame)
        impulse = mass * velocities[world, particle] + step_seconds * (
            lift(mass, gravity, helium) * bodies.up + inflation
        )
        free = (step_seconds / inertia(bodies, world, particle, step_seconds)) * impulse
    free_displacements[world, particle] = free
    displacements[world, particle] = free
    trial_points[world, particle] = points[world, particle] + free


@cache
def local_step_kernel(traits: Traits) -> Any:
    """The kernel of the local step."""
    pull_of_springs = spring_puller(traits, vector_at)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fast_math": True})
    def find_residuals(
        # model
        bodies: BodyTable,
        springs: SpringTable,
        strings: StringTable,
        step_seconds: float,
        # state in
        free_displacements: wp.array2d[wp.vec3],
        displacements: wp.array2d[wp.vec3],
        trial_points: wp.array2d[wp.vec3],
        # state out
        residuals: wp.array2d[wp.vec3],
    ):
        """A thread a (world, particle): minus h^2 times the slope of g [kg m]."""
        world, particle = wp.tid()
        residual = wp.vec3()
        inert = inertia(bodies, world, particle, step_seconds)
        if bodies.mass_share[particle] > 0.0:
            point = trial_points[world, particle]
            displacement = displacements[world, particle]  # no velocities are needed: no spring is viscous
            pull = pull_of_springs(
                springs,
                trial_points[world],
                0,
                displacements[world],
                point,
                displacement,
                world,
                bodies.balloon[particle],
                particle,
            )
            pull += pull_of_strings(strings, point, world, particle)
            lag = free_displacements[world, particle] - displacement
            residual = inert * lag + step_seconds * step_seconds * pull
        residuals[world, particle] = residual

    return find_residuals


@wp.kernel(enable_backward=False)
def apply_increments(
    # state in
    points: wp.array2d[wp.vec3],
    increments: wp.array2d[wp.vec3],
    # state in and out
    displacements: wp.array2d[wp.vec3],
    # state out
    trial_points: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): what the global step found."""
    world, particle = wp.tid()
    displacement = displacements[world, particle] + increments[world, particle]
    displacements[world, particle] = displacement
    trial_points[world, particle] = points[world, particle] + displacement


@cache
def ending_kernel(impulses: bool) -> Any:
    """The kernel that ends a substep."""
    leave_obstacles = leaving_obstacles(impulses)

    @wp.kernel(module="unique", enable_backward=False)
    def take_displacements(
        # model
        bodies: BodyTable,
        obstacles: ObstacleTable,
        step_seconds: float,
        time_in_frame: float,
        # state in
        inflation_aims: wp.array2d[wp.vec3],
        inflation_ramp: wp.array2d[wp.vec2],
        sphere_positions: wp.array2d[wp.vec3],
        sphere_velocities: wp.array2d[wp.vec3],
        displacements: wp.array2d[wp.vec3],
        # state in and out
        points: wp.array2d[wp.vec3],
        # state out
        velocities: wp.array2d[wp.vec3],
        sphere_forces: wp.array3d[wp.int64],
    ):
        """A thread a (world, particle): the substep ends, and contacts follow; the spheres have moved already."""
        world, particle = wp.tid()
        point = points[world, particle] + displacements[world, particle]
        velocity = displacements[world, particle] / step_seconds
        if bodies.mass_share[particle] > 0.0:
            inflation = inflation_of(bodies, inflation_aims, inflation_ramp, world, particle, time_in_frame)
            point, velocity = leave_obstacles(
                bodies, obstacles, sphere_positions, sphere_velocities, sphere_forces, step_seconds, world, particle,
                point, velocity, inflation,
            )  # fmt: skip
        points[world, particle] = point
        velocities[world, particle] = velocity

    return take_displacements

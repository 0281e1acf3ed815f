"""Forces on a particle by itself, and the step from forces to motion."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.inflation import NORMAL_FORCE, inflation_force


@wp.func
def lift(mass: float, gravity: float, helium: float):
    """Force along the up axis [N] of gravity [m/s^2] and helium [N/kg]."""
    return mass * (helium - gravity)


@wp.func
def body_force(mass: float, gravity: float, helium: float, damping: float, up: wp.vec3, velocity: wp.vec3):
    """Gravity [m/s^2] and helium [N/kg] along the up axis, and damping [N s/m] against the velocity."""
    return lift(mass, gravity, helium) * up - damping * velocity


@wp.func
def response(mass: float, step_seconds: float):
    """Velocity gained in a step for each newton [m/s/N]; a particle without mass is fixed."""
    return wp.where(mass > 0.0, step_seconds / mass, 0.0)


@wp.func
def advance_symplectic(point: wp.vec3, velocity: wp.vec3, force: wp.vec3, mass: float, step_seconds: float):
    """Point and velocity after a step of symplectic Euler, in the order of the paper's listing: a = F/m, v += h a,
    x += h v."""
    velocity += response(mass, step_seconds) * force
    return point + step_seconds * velocity, velocity


@wp.func
def advance_forward(point: wp.vec3, velocity: wp.vec3, force: wp.vec3, mass: float, step_seconds: float):
    """Point and velocity after a step of forward Euler, both from the old ones: x += h v, then v += h F/m."""
    return point + step_seconds * velocity, velocity + response(mass, step_seconds) * force


def euler_step(forward: bool) -> Any:
    """The function that takes a particle a step further."""
    return advance_forward if forward else advance_symplectic


@wp.kernel
def set_body_forces(
    # model
    particle_balloon: wp.array[wp.int32],
    particle_mass_share: wp.array[float],
    mass: wp.array2d[float],
    helium: wp.array2d[float],
    damping: wp.array2d[float],
    gravity: wp.array[float],
    inflation_kind: wp.array[wp.int32],
    up: wp.vec3,
    time_in_frame: float,
    # state in
    velocities: wp.array2d[wp.vec3],
    inflation_aims: wp.array2d[wp.vec3],
    inflation_ramp: wp.array2d[wp.vec2],
    # state out
    forces: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): gravity, helium, damping, inflation by normal forces. Overwrites `forces`; the
    others add to it."""
    world, particle = wp.tid()
    balloon = particle_balloon[particle]
    share = particle_mass_share[particle]
    ramp = inflation_ramp[world, balloon]
    body = body_force(
        share * mass[world % mass.shape[0], balloon],
        gravity[world % gravity.shape[0]],
        helium[world % helium.shape[0], balloon],
        share * damping[world % damping.shape[0], balloon],
        up,
        velocities[world, particle],
    )
    if inflation_kind[balloon] == NORMAL_FORCE:
        body += inflation_force(ramp[0] + ramp[1] * time_in_frame, inflation_aims[world, particle])
    forces[world, particle] = body


@cache
def euler_kernel(forward: bool) -> Any:
    """The kernel that integrates."""
    advance = euler_step(forward)

    @wp.kernel(module="unique")
    def integrate_euler(
        # model
        particle_balloon: wp.array[wp.int32],
        particle_mass_share: wp.array[float],
        mass: wp.array2d[float],
        step_seconds: float,
        # state in
        forces: wp.array2d[wp.vec3],
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # state out
        new_points: wp.array2d[wp.vec3],
        new_velocities: wp.array2d[wp.vec3],
    ):
        """A thread a (world, particle)."""
        world, particle = wp.tid()
        particle_mass = particle_mass_share[particle] * mass[world % mass.shape[0], particle_balloon[particle]]
        point, velocity = advance(
            points[world, particle], velocities[world, particle], forces[world, particle], particle_mass, step_seconds
        )
        new_points[world, particle] = point
        new_velocities[world, particle] = velocity

    return integrate_euler

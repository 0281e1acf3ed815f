"""Pressure, gas and air in the `gather` schedule. A substep goes in two halves, and between them the gas is weighed."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.air import has_pressure, load_of_balloon, swelling_beside_obstacles, volume_origin
from balloon_warp.kernels.gas import VOLUME, Swelling, face_volume, inflation_of_kind
from balloon_warp.kernels.gather import leaving_obstacles
from balloon_warp.kernels.motion import response
from balloon_warp.kernels.tables import (
    AirTable,
    BodyTable,
    FaceTable,
    ObstacleTable,
    particle_mass,
)


@wp.kernel(enable_backward=False)
def start_particles(
    # model
    bodies: BodyTable,
    step_seconds: float,
    # state in
    forces: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # state out
    new_velocities: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): its velocity, without the inflation. `bodies` have the mass of their gas here."""
    world, particle = wp.tid()
    mass = particle_mass(bodies, world, particle)
    gained = response(mass, step_seconds) * forces[world, particle]
    new_velocities[world, particle] = velocities[world, particle] + gained


@wp.kernel(enable_backward=False)
def weigh_gases(
    # model
    bodies: BodyTable,
    faces: FaceTable,
    obstacles: ObstacleTable,
    air: AirTable,
    time_in_frame: float,
    step_seconds: float,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    inflation_aims: wp.array2d[wp.vec3],
    inflation_ramp: wp.array2d[wp.vec2],
    gas_amounts: wp.array2d[wp.float64],
    sphere_positions: wp.array2d[wp.vec3],
    # state in and out
    inflation_loads: wp.array2d[wp.vec2],
    # state out
    pressures: wp.array2d[float],
):
    """A block a (world, balloon): its swelling, summed in the same order every time, and the load that follows.

    `bodies` have the mass of their gas here.
    """
    world, balloon, lane = wp.tid()
    part = Swelling()
    if has_pressure(air, balloon):
        origin = volume_origin(faces, points[world], 0, balloon)
        for face in range(faces.balloon_offsets[balloon] + lane, faces.balloon_offsets[balloon + 1], wp.block_dim()):
            part[VOLUME] += face_volume(
                points[world], 0, faces.particles, faces.offsets[face], faces.offsets[face + 1], origin
            )
        for particle in range(
            air.balloon_particles[balloon] + lane, air.balloon_particles[balloon + 1], wp.block_dim()
        ):
            part += swelling_beside_obstacles(
                bodies,
                obstacles,
                sphere_positions[world],
                world,
                points[world, particle],
                velocities[world, particle],
                particle_mass(bodies, world, particle),
                bodies.mass_share[particle],
                inflation_aims[world, particle],
                inflation_loads[world, balloon],
                step_seconds,
            )
    swelling = wp.tile_sum(wp.tile(part, preserve_type=True))[0]
    if lane == 0 and has_pressure(air, balloon):
        load = load_of_balloon(
            air,
            bodies,
            inflation_ramp[world, balloon],
            gas_amounts[world, balloon],
            swelling,
            world,
            balloon,
            time_in_frame,
            step_seconds,
        )
        pressures[world, balloon] = load[0]
        inflation_loads[world, balloon] = wp.vec2(load[1], load[2])


@cache
def finishing_kernel(impulses: bool) -> Any:
    """The kernel that ends a substep."""
    leave_obstacles = leaving_obstacles(impulses)

    @wp.kernel(module="unique", enable_backward=False)
    def finish_particles(
        # model
        bodies: BodyTable,
        obstacles: ObstacleTable,
        air: AirTable,
        forward_euler: bool,
        corrected: bool,
        step_seconds: float,
        time_in_frame: float,
        # state in
        inflation_aims: wp.array2d[wp.vec3],
        inflation_ramp: wp.array2d[wp.vec2],
        inflation_loads: wp.array2d[wp.vec2],
        sphere_positions: wp.array2d[wp.vec3],
        sphere_velocities: wp.array2d[wp.vec3],
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # state in and out
        new_velocities: wp.array2d[wp.vec3],
        # state out
        new_points: wp.array2d[wp.vec3],
        sphere_forces: wp.array3d[wp.int64],
    ):
        """A thread a (world, particle): the inflation, the movement, and obstacles. `bodies` have the mass of their
        gas."""
        world, particle = wp.tid()
        balloon = bodies.balloon[particle]
        point = points[world, particle]
        ramp = inflation_ramp[world, balloon]
        inflation = inflation_of_kind(
            air.kind[balloon],
            ramp[0] + ramp[1] * time_in_frame,
            inflation_loads[world, balloon],
            wp.dot(point, bodies.up),
            inflation_aims[world, particle],
        )
        mass = particle_mass(bodies, world, particle)
        velocity = new_velocities[world, particle] + response(mass, step_seconds) * inflation
        point += step_seconds * wp.where(forward_euler, velocities[world, particle], velocity)
        if mass > 0.0 and not corrected:
            point, velocity = leave_obstacles(
                bodies, obstacles, sphere_positions, sphere_velocities, sphere_forces, step_seconds, world, particle,
                point, velocity, inflation,
            )  # fmt: skip
        new_velocities[world, particle] = velocity
        new_points[world, particle] = point

    return finish_particles

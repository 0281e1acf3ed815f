"""The `block` schedule's kernel for worlds of any size that fits in shared memory: springs are read every substep."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.air import has_pressure, inertia_of_particle, load_of_balloon
from balloon_warp.kernels.block import count_frame_in_block, refresh_aims
from balloon_warp.kernels.block_air import (
    begin_gas,
    gas_row,
    inflation_in_air,
    keep_load,
    next_gas,
    part_of_volume,
    start_particle,
)
from balloon_warp.kernels.block_contact import (
    SphereForces,
    begin_sphere_forces,
    clear_sphere_force,
    end_spheres,
    meeting_obstacles,
    moved_sphere,
    row_of,
    were_touched,
)
from balloon_warp.kernels.contiguous import vector_of_tile
from balloon_warp.kernels.correction import correction_limit, excess, moves_of_ends
from balloon_warp.kernels.gas import VOLUME, Swelling, inflation_of_kind
from balloon_warp.kernels.health import HealthTable, look_at_particle
from balloon_warp.kernels.inflation import inflation_force
from balloon_warp.kernels.motion import body_force, euler_step, response
from balloon_warp.kernels.pull import pull_of_strings, spring_puller
from balloon_warp.kernels.tables import (
    AirTable,
    BodyTable,
    CorrectionTable,
    FaceTable,
    ObstacleTable,
    SpringTable,
    StringTable,
    WaterTable,
    WorldState,
    ground_height,
    particle_damping,
    particle_mass,
    row_of_world,
)
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.water import water_force

MAX_REGISTERS = 64
"""for blocks of 1,024 threads"""


@cache
def streaming_kernel(capacity: int, sphere_capacity: int, traits: Traits, fresh_normals: bool) -> Any:
    """A kernel for worlds of up to so many particles and spheres; on the CPU, a block is one thread."""
    buffers = 2 * capacity
    pull_of_springs = spring_puller(traits, vector_of_tile)
    advance = euler_step(traits.forward_euler)
    meet_obstacles = meeting_obstacles(traits.impulses)
    Spheres = wp.types.matrix(shape=(sphere_capacity, 3), dtype=wp.float32)  # noqa: N806 - a type

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=MAX_REGISTERS,
        module_options={"fast_math": True},
    )
    def advance_streaming(
        # model
        bodies: BodyTable,
        strings: StringTable,
        obstacles: ObstacleTable,
        faces: FaceTable,
        springs: SpringTable,
        water: WaterTable,
        air: AirTable,
        correction: CorrectionTable,
        health: HealthTable,
        substeps: wp.int32,
        step_seconds: float,
        # state in and out
        state: WorldState,
        sphere_forces: SphereForces,
        # memory
        other_velocities: wp.array2d[wp.vec3],
        gas_rows: wp.array2d[wp.float64],
    ):
        """A block a world: one frame."""
        world, lane = wp.tid()
        count = state.points.shape[1]
        sphere_count = state.sphere_positions.shape[1]
        threads = wp.block_dim()
        gravity = bodies.gravity[row_of_world(world, bodies.gravity.shape[0])]
        height = ground_height(obstacles, world)
        rounds = (count + threads - 1) // threads
        colors = correction.color_offsets.shape[0] - 1
        points = wp.tile_zeros(shape=buffers, dtype=wp.vec3, storage="shared")
        if lane == 0:
            begin_sphere_forces(state, sphere_forces, world)
            if wp.static(traits.in_air):
                begin_gas(air, state, gas_rows, world, step_seconds)
        centers = Spheres()
        motions = Spheres()
        for sphere in range(sphere_count):
            centers[sphere] = state.sphere_positions[world, sphere]
            motions[sphere] = state.sphere_velocities[world, sphere]
        for turn in range(rounds):
            particle = wp.min(turn * threads + lane, count - 1)
            wp.tile_scatter_masked(points, particle, state.points[world, particle], turn * threads + lane < count)
        touched_before = bool(False)
        first = wp.int32(0)
        velocities = state.velocities[world]
        new_velocities = state.velocities[world]
        for substep in range(substeps):
            if substep == 0 or wp.static(fresh_normals):
                refresh_aims(bodies, faces, air, state, points, first, world, lane)
            touched = were_touched(sphere_forces.stamps[world], substep - 1)
            for sphere in range(sphere_count):
                center, motion = moved_sphere(
                    bodies, obstacles, sphere_forces, touched, world, sphere, substep,
                    row_of(centers, sphere), row_of(motions, sphere), step_seconds,
                )  # fmt: skip
                centers[sphere] = center
                motions[sphere] = motion
                if wp.static(traits.in_air):
                    state.sphere_positions[world, sphere] = center  # the same by all threads
                if touched_before and lane == 0:
                    clear_sphere_force(sphere_forces, world, sphere, substep - 2)
            touched_before = touched
            time_in_frame = float(substep) * step_seconds
            if wp.static(traits.keeps_velocities):
                if substep % 2 == 1:
                    velocities = other_velocities[world]
                    new_velocities = state.velocities[world]
                else:
                    velocities = state.velocities[world]
                    new_velocities = other_velocities[world]
            if wp.static(traits.in_air):
                amounts = gas_rows[gas_row(world, substep)]
                for balloon in range(state.inflation_ramp.shape[1]):
                    begin = air.balloon_particles[balloon]
                    own = air.balloon_particles[balloon + 1] - begin
                    part = Swelling()
                    for particle in range(begin + lane, begin + own, threads):
                        point = points[first + particle]
                        velocity = velocities[particle]
                        pull = pull_of_springs(
                            springs, points, first, velocities, point, velocity, world, balloon, particle
                        )
                        if wp.static(traits.in_water):
                            pull += water_force(
                                water, faces, bodies, points, first, world, particle, velocity, step_seconds
                            )
                        part += start_particle(
                            bodies, strings, obstacles, faces, air, state, points, first, world, particle,
                            velocity, pull, amounts, new_velocities, step_seconds,
                        )  # fmt: skip
                    load = wp.vec3()
                    if has_pressure(air, balloon):
                        part[VOLUME] = part_of_volume(faces, points, first, balloon, lane)
                        swelling = wp.tile_sum(wp.tile(part, preserve_type=True))
                        load = load_of_balloon(
                            air, bodies, state.inflation_ramp[world, balloon], amounts[balloon], swelling[0],
                            world, balloon, time_in_frame, step_seconds,
                        )  # fmt: skip
                    if lane == 0:
                        keep_load(state, world, balloon, load)
                        if balloon == state.inflation_ramp.shape[1] - 1:
                            next_gas(air, state, gas_rows, world, substep, time_in_frame + step_seconds, step_seconds)
                    for turn in range((own + threads - 1) // threads):
                        active = turn * threads + lane < own
                        particle = begin + wp.min(turn * threads + lane, own - 1)
                        mass = inertia_of_particle(bodies, air, amounts, world, particle)
                        point = points[first + particle]
                        inflation = inflation_in_air(bodies, air, state, world, particle, point, load, time_in_frame)
                        velocity = new_velocities[particle] + response(mass, step_seconds) * inflation
                        if wp.static(traits.forward_euler):
                            point += step_seconds * velocities[particle]
                        else:
                            point += step_seconds * velocity
                        if wp.static(not traits.corrected) and mass > 0.0:
                            point, velocity = meet_obstacles(
                                bodies, obstacles, sphere_forces, sphere_count, centers, motions, height, step_seconds,
                                world, substep, particle, mass, point, velocity, inflation, active,
                            )  # fmt: skip
                        if active:
                            new_velocities[particle] = velocity
                        wp.tile_scatter_masked(points, capacity - first + particle, point, active)
            else:
                for turn in range(rounds):
                    active = turn * threads + lane < count
                    particle = wp.min(turn * threads + lane, count - 1)
                    balloon = bodies.balloon[particle]
                    mass = particle_mass(bodies, world, particle)
                    point = points[first + particle]
                    velocity = velocities[particle]
                    ramp = state.inflation_ramp[world, balloon]
                    k_normal = ramp[0] + ramp[1] * time_in_frame
                    inflation = inflation_force(k_normal, state.inflation_aims[world, particle])
                    body = body_force(
                        mass,
                        gravity,
                        bodies.helium[row_of_world(world, bodies.helium.shape[0]), balloon],
                        particle_damping(bodies, world, particle),
                        bodies.up,
                        velocity,
                    )
                    pull = pull_of_springs(
                        springs, points, first, velocities, point, velocity, world, balloon, particle
                    )
                    pull += pull_of_strings(strings, point, world, particle)
                    if wp.static(traits.in_water):
                        pull += water_force(
                            water, faces, bodies, points, first, world, particle, velocity, step_seconds
                        )
                    point, velocity = advance(point, velocity, body + inflation + pull, mass, step_seconds)
                    if wp.static(not traits.corrected) and mass > 0.0:
                        point, velocity = meet_obstacles(
                            bodies, obstacles, sphere_forces, sphere_count, centers, motions, height, step_seconds,
                            world, substep, particle, mass, point, velocity, inflation, active,
                        )  # fmt: skip
                    if active:
                        new_velocities[particle] = velocity
                    wp.tile_scatter_masked(points, capacity - first + particle, point, active)
            first = capacity - first
            if wp.static(traits.corrected):
                for color_of_sweep in range(correction.sweeps * colors):
                    color = color_of_sweep % colors
                    end = correction.color_offsets[color + 1]
                    for begin in range(correction.color_offsets[color], end, threads):
                        active = begin + lane < end
                        spring = wp.min(begin + lane, end - 1)
                        ends = correction.particles[spring]
                        p = ends[0]
                        q = ends[1]
                        d = points[first + q] - points[first + p]
                        too_long = excess(d, correction.rest_lengths[spring], correction_limit(correction, world))
                        move_p, move_q = moves_of_ends(bodies, ends, too_long)
                        if active:
                            new_velocities[p] = new_velocities[p] + move_p / step_seconds
                            new_velocities[q] = new_velocities[q] + move_q / step_seconds
                        wp.tile_scatter_masked(points, first + p, points[first + p] + move_p, active)
                        wp.tile_scatter_masked(points, first + q, points[first + q] + move_q, active)
                for turn in range(rounds):
                    active = turn * threads + lane < count
                    particle = wp.min(turn * threads + lane, count - 1)
                    point = points[first + particle]
                    if active and bodies.mass_share[particle] > 0.0:
                        mass = particle_mass(bodies, world, particle)
                        if wp.static(traits.in_air):
                            mass = inertia_of_particle(bodies, air, gas_rows[gas_row(world, substep)], world, particle)
                        balloon = bodies.balloon[particle]
                        ramp = state.inflation_ramp[world, balloon]
                        inflation = inflation_of_kind(
                            air.kind[balloon],
                            ramp[0] + ramp[1] * time_in_frame,
                            state.inflation_loads[world, balloon],
                            wp.dot(point, bodies.up),
                            state.inflation_aims[world, particle],
                        )
                        point, velocity = meet_obstacles(
                            bodies, obstacles, sphere_forces, sphere_count, centers, motions, height, step_seconds,
                            world, substep, particle, mass, point, new_velocities[particle], inflation, active,
                        )  # fmt: skip
                        new_velocities[particle] = velocity
                    wp.tile_scatter_masked(points, first + particle, point, active)
        for particle in range(lane, count, threads):
            point = points[first + particle]
            state.points[world, particle] = point
            look_at_particle(bodies, health, state.first_bad, world, particle, point, points, first)
            if wp.static(traits.keeps_velocities):
                state.velocities[world, particle] = new_velocities[particle]
        count_frame_in_block(state, world, lane)
        if lane == 0:
            end_spheres(health, state, sphere_forces, centers, motions, world, substeps - 1)

    return advance_streaming

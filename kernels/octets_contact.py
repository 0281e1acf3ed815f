"""Spheres and ground beside eight particles of one world. Touching is rare: only then is each particle looked at by
itself."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact import collide, leave_ground, leave_sphere, move_sphere, penalty_force
from balloon_warp.kernels.inflation import inflation_force
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3, column, set_column
from balloon_warp.kernels.octets_state import RAMP_BEGIN, RAMP_SLOPE, OctetState
from balloon_warp.kernels.tables import (
    BodyTable,
    ObstacleTable,
    WorldState,
    ground_friction,
    ground_height,
    ground_restitution,
    particle_mass,
    row_of_world,
    sphere_part,
)


@wp.func
def move_world_spheres(
    bodies: BodyTable,
    obstacles: ObstacleTable,
    state: WorldState,
    world: wp.int32,
    step_seconds: float,
):
    """Each sphere of a world by one substep, under the forces since the last, which are then cleared."""
    for sphere in range(state.sphere_positions.shape[1]):
        position, velocity = move_sphere(
            state.sphere_positions[world, sphere],
            state.sphere_velocities[world, sphere],
            state.sphere_forces[world, sphere]
            / obstacles.sphere_mass[row_of_world(world, obstacles.sphere_mass.shape[0]), sphere],
            obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere],
            bodies.gravity[row_of_world(world, bodies.gravity.shape[0])],
            bodies.up,
            ground_height(obstacles, world),
            ground_restitution(obstacles, world),
            step_seconds,
        )
        state.sphere_positions[world, sphere] = position
        state.sphere_velocities[world, sphere] = velocity
        state.sphere_forces[world, sphere] = wp.vec3()


@wp.func
def is_any_inside(points: Lanes3, center: wp.vec3, radius: float):
    """Whether any of eight particles is inside a sphere."""
    squared_distances = Lanes()
    for lane in range(LANE_COUNT):
        squared_distances[lane] = wp.length_sq(column(points, lane) - center)
    return wp.min(squared_distances) < radius * radius


@wp.func
def is_any_below(points: Lanes3, up: wp.vec3, height: float):
    """Whether any of eight particles is below the ground."""
    heights = Lanes()
    for lane in range(LANE_COUNT):
        heights[lane] = wp.dot(column(points, lane), up)
    return wp.min(heights) < height


@cache
def touching_any(spheres: bool) -> Any:
    """The function that asks whether there is an obstacle to leave, without looking for spheres if there are none."""

    @wp.func
    def is_any_touching(
        bodies: BodyTable, obstacles: ObstacleTable, state: WorldState, world: wp.int32, points: Lanes3
    ):
        """Whether any of eight particles is inside a sphere or below the ground."""
        touching = is_any_below(points, bodies.up, ground_height(obstacles, world))
        if wp.static(spheres):
            for sphere in range(state.sphere_positions.shape[1]):
                radius = obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere]
                touching = touching or is_any_inside(points, state.sphere_positions[world, sphere], radius)
        return touching

    return is_any_touching


@cache
def leaving_obstacles(spheres: bool, impulses: bool) -> Any:
    """The function that leaves obstacles, by either rule for spheres."""

    @wp.func
    def leave_obstacles(
        bodies: BodyTable,
        obstacles: ObstacleTable,
        state: WorldState,
        octets: OctetState,
        world: wp.int32,
        octet: wp.int32,
        step_seconds: float,
        time_in_frame: float,
        points: Lanes3,
        velocities: Lanes3,
    ):
        """Points and velocities of eight particles once each that is free to move is out of spheres and ground."""
        numbers = octets.numbers[world, octet]
        first = LANE_COUNT * octet
        for particle in range(first, wp.min(first + LANE_COUNT, state.points.shape[1])):
            lane = particle - first
            if bodies.mass_share[particle] > 0.0:
                point = column(points, lane)
                velocity = column(velocities, lane)
                if wp.static(spheres):
                    for sphere in range(state.sphere_positions.shape[1]):
                        point, stopped, outward = leave_sphere(
                            point,
                            velocity,
                            state.sphere_positions[world, sphere],
                            state.sphere_velocities[world, sphere],
                            obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere],
                            bodies.up,
                        )
                        if wp.length_sq(outward) > 0.0:
                            if wp.static(impulses):
                                mass = particle_mass(bodies, world, particle)
                                part = sphere_part(bodies, obstacles, world, particle, sphere)
                                velocity, push = collide(mass, part, velocity, stopped, step_seconds)
                            else:
                                k_normal = numbers[RAMP_BEGIN][lane] + numbers[RAMP_SLOPE][lane] * time_in_frame
                                inflation = inflation_force(k_normal, column(octets.aims[world, octet], lane))
                                row = row_of_world(world, obstacles.sphere_penalty.shape[0])
                                velocity = stopped
                                push = penalty_force(obstacles.sphere_penalty[row, sphere], inflation, outward)
                            state.sphere_forces[world, sphere] += push
                point, velocity = leave_ground(
                    point, velocity, bodies.up, ground_height(obstacles, world), ground_friction(obstacles, world)
                )
                points = set_column(points, lane, point)
                velocities = set_column(velocities, lane, velocity)
        return points, velocities

    return leave_obstacles

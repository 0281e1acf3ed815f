"""Spheres and ground in eight worlds side by side. Touching is rare: only then is each world looked at by itself."""

import warp as wp

from balloon_warp.kernels.contact import collide, leave_ground, leave_sphere, move_sphere, penalty_force
from balloon_warp.kernels.lanes_air import inflation_in_lane
from balloon_warp.kernels.lanes_state import INERTIA, MASS, LaneState, LaneTraits, world_of
from balloon_warp.kernels.lanes_types import (
    LANE_COUNT,
    Lanes3,
    any_negative,
    column,
    parts_along,
    set_column,
    squared_lengths,
)
from balloon_warp.kernels.tables import (
    AirTable,
    BodyTable,
    ObstacleTable,
    WorldState,
    ground_friction,
    ground_height,
    ground_restitution,
    row_of_world,
    sphere_part,
)


@wp.func
def move_sphere_lanes(
    bodies: BodyTable,
    obstacles: ObstacleTable,
    state: WorldState,
    lanes: LaneState,
    group: wp.int32,
    step_seconds: float,
):
    """Each sphere of each world by one substep, and its center into the lanes."""
    for sphere in range(state.sphere_positions.shape[1]):
        for lane in range(LANE_COUNT):
            world = group * LANE_COUNT + lane
            if world < state.points.shape[0]:
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
                for axis in range(3):
                    lanes.sphere_centers[group, sphere][axis, lane] = position[axis]


@wp.func
def touches_sphere(lanes: LaneState, group: wp.int32, sphere: wp.int32, point: Lanes3):
    """Whether a particle is inside a sphere in any of the worlds."""
    gaps = squared_lengths(point - lanes.sphere_centers[group, sphere]) - lanes.sphere_squared_radii[group, sphere]
    return any_negative(gaps)


@wp.func
def touches_ground(lanes: LaneState, group: wp.int32, up: wp.vec3, point: Lanes3):
    """Whether a particle is below the ground in any of the worlds."""
    return any_negative(parts_along(point, up) - lanes.ground_heights[group])


@wp.func
def leave_sphere_lanes(
    traits: LaneTraits,
    bodies: BodyTable,
    air: AirTable,
    obstacles: ObstacleTable,
    state: WorldState,
    lanes: LaneState,
    points: wp.array[Lanes3],
    group: wp.int32,
    particle: wp.int32,
    sphere: wp.int32,
    step_seconds: float,
    time_in_frame: float,
):
    """A particle out of a sphere, world by world."""
    for lane in range(LANE_COUNT):
        world = group * LANE_COUNT + lane
        if world < state.points.shape[0]:
            velocity = column(lanes.velocities[group, particle], lane)
            point, stopped, outward = leave_sphere(
                column(points[particle], lane),
                velocity,
                state.sphere_positions[world, sphere],
                state.sphere_velocities[world, sphere],
                obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere],
                bodies.up,
            )
            if wp.length_sq(outward) > 0.0:
                numbers = lanes.balloons[group, bodies.balloon[particle]]
                push = wp.vec3()
                if traits.impulses:
                    mass = bodies.mass_share[particle] * numbers[wp.where(traits.in_air, INERTIA, MASS)][lane]
                    part = sphere_part(bodies, obstacles, world, particle, sphere)
                    velocity, push = collide(mass, part, velocity, stopped, step_seconds)
                else:
                    inflation = inflation_in_lane(
                        air, bodies.balloon[particle], numbers, lane, time_in_frame,
                        wp.dot(column(points[particle], lane), bodies.up), column(lanes.aims[group, particle], lane),
                    )  # fmt: skip
                    penalty = obstacles.sphere_penalty[row_of_world(world, obstacles.sphere_penalty.shape[0]), sphere]
                    velocity = stopped
                    push = penalty_force(penalty, inflation, outward)
                state.sphere_forces[world, sphere] += push
                points[particle] = set_column(points[particle], lane, point)
                lanes.velocities[group, particle] = set_column(lanes.velocities[group, particle], lane, velocity)


@wp.func
def leave_ground_lanes(
    bodies: BodyTable,
    obstacles: ObstacleTable,
    state: WorldState,
    lanes: LaneState,
    points: wp.array[Lanes3],
    group: wp.int32,
    particle: wp.int32,
):
    """A particle up to the ground, world by world."""
    for lane in range(LANE_COUNT):
        world = world_of(state, group, lane)
        point, velocity = leave_ground(
            column(points[particle], lane),
            column(lanes.velocities[group, particle], lane),
            bodies.up,
            ground_height(obstacles, world),
            ground_friction(obstacles, world),
        )
        points[particle] = set_column(points[particle], lane, point)
        lanes.velocities[group, particle] = set_column(lanes.velocities[group, particle], lane, velocity)


@wp.func
def leave_obstacle_lanes(
    traits: LaneTraits,
    bodies: BodyTable,
    air: AirTable,
    obstacles: ObstacleTable,
    state: WorldState,
    lanes: LaneState,
    points: wp.array[Lanes3],
    group: wp.int32,
    step_seconds: float,
    time_in_frame: float,
):
    """Every particle that is free to move, out of spheres and ground."""
    for particle in range(points.shape[0]):
        if bodies.mass_share[particle] > 0.0:
            for sphere in range(state.sphere_positions.shape[1]):
                if touches_sphere(lanes, group, sphere, points[particle]):
                    leave_sphere_lanes(
                        traits, bodies, air, obstacles, state, lanes, points, group, particle, sphere,
                        step_seconds, time_in_frame,
                    )  # fmt: skip
            if touches_ground(lanes, group, bodies.up, points[particle]):
                leave_ground_lanes(bodies, obstacles, state, lanes, points, group, particle)

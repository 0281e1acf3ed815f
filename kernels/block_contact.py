"""Spheres and ground in the `block` schedule's kernel for worlds of any size. A particle that touches is rare."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact import collide, leave_ground, leave_sphere, move_sphere, penalty_force
from balloon_warp.kernels.fixed_point import add_quanta, set_quanta, total_newtons
from balloon_warp.kernels.health import HealthTable, look_at_sphere
from balloon_warp.kernels.tables import (
    BodyTable,
    ObstacleTable,
    WorldState,
    ground_friction,
    ground_height,
    ground_restitution,
    row_of_world,
    sphere_part,
)

FORCE_ROWS = 3
"""rows of the spheres' forces in a world: a substep adds to one, reads that of the last, and clears that of the next"""


@wp.func
def row_of(spheres: Any, sphere: wp.int32):
    """The vector of one sphere."""
    return wp.vec3(spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2])


@wp.func
def force_row(world: wp.int32, substep: wp.int32):
    """Where the forces on spheres of a substep are summed."""
    return FORCE_ROWS * world + (substep + FORCE_ROWS) % FORCE_ROWS


@wp.struct
class SphereForces:
    """Forces on the spheres in the substeps of a frame."""

    totals: wp.array3d[wp.int64]
    """see `fixed_point`, shape (FORCE_ROWS * world_count, sphere_count, 3)"""
    stamps: wp.array2d[wp.int32]
    """the last substep in which something was added to a row, shape (world_count, FORCE_ROWS)"""


@wp.func
def begin_sphere_forces(state: WorldState, forces: SphereForces, world: wp.int32):
    """By one thread, before the first substep: the forces since the spheres last moved."""
    for sphere in range(state.sphere_positions.shape[1]):
        set_quanta(forces.totals, force_row(world, -1), sphere, state.sphere_forces[world, sphere])
        set_quanta(forces.totals, force_row(world, 0), sphere, wp.vec3())
        set_quanta(forces.totals, force_row(world, 1), sphere, wp.vec3())
    forces.stamps[world, FORCE_ROWS - 1] = -1
    forces.stamps[world, 0] = -FORCE_ROWS
    forces.stamps[world, 1] = -FORCE_ROWS


@wp.func
def were_touched(stamps: wp.array[wp.int32], substep: wp.int32):
    """Whether a particle touched a sphere of the world in a substep that is over."""
    return stamps[(substep + FORCE_ROWS) % FORCE_ROWS] == substep


@wp.func
def clear_sphere_force(forces: SphereForces, world: wp.int32, sphere: wp.int32, substep: wp.int32):
    """By one thread: a row that all threads have read."""
    set_quanta(forces.totals, force_row(world, substep), sphere, wp.vec3())


@wp.func
def add_sphere_force(forces: SphereForces, world: wp.int32, sphere: wp.int32, substep: wp.int32, force: wp.vec3):
    """What a particle that left a sphere adds to the sphere's forces of this substep."""
    add_quanta(forces.totals, force_row(world, substep), sphere, force)
    forces.stamps[world, substep % FORCE_ROWS] = substep


@wp.func
def sphere_radius(obstacles: ObstacleTable, world: wp.int32, sphere: wp.int32):
    """[m]"""
    return obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere]


@wp.func
def meet_ground(
    obstacles: ObstacleTable, world: wp.int32, point: wp.vec3, velocity: wp.vec3, up: wp.vec3, height: float
):
    """A particle up to the ground; most are above and go on at once."""
    if wp.dot(point, up) >= height:
        return point, velocity
    new_point, new_velocity = leave_ground(point, velocity, up, height, ground_friction(obstacles, world))
    return new_point, new_velocity


@cache
def meeting_obstacles(impulses: bool) -> Any:
    """The function that leaves obstacles, by either rule for spheres."""

    @wp.func
    def meet_sphere(
        bodies: BodyTable,
        obstacles: ObstacleTable,
        forces: SphereForces,
        center: wp.vec3,
        sphere_velocity: wp.vec3,
        step_seconds: float,
        world: wp.int32,
        sphere: wp.int32,
        substep: wp.int32,
        particle: wp.int32,
        mass: float,
        point: wp.vec3,
        velocity: wp.vec3,
        inflation: wp.vec3,
        active: bool,
    ):
        """A particle out of a sphere, which gets its force; most are outside and go on at once."""
        radius = sphere_radius(obstacles, world, sphere)
        if wp.length_sq(point - center) >= radius * radius:
            return point, velocity
        new_point, new_velocity, outward = leave_sphere(point, velocity, center, sphere_velocity, radius, bodies.up)
        if active:
            push = wp.vec3()
            if wp.static(impulses):
                part = sphere_part(bodies, obstacles, world, particle, sphere)
                new_velocity, push = collide(mass, part, velocity, new_velocity, step_seconds)
            else:
                penalty = obstacles.sphere_penalty[row_of_world(world, obstacles.sphere_penalty.shape[0]), sphere]
                push = penalty_force(penalty, inflation, outward)
            add_sphere_force(forces, world, sphere, substep, push)
        return new_point, new_velocity

    @wp.func
    def meet_obstacles(
        bodies: BodyTable,
        obstacles: ObstacleTable,
        forces: SphereForces,
        sphere_count: wp.int32,
        centers: Any,
        motions: Any,
        height: float,
        step_seconds: float,
        world: wp.int32,
        substep: wp.int32,
        particle: wp.int32,
        mass: float,
        point: wp.vec3,
        velocity: wp.vec3,
        inflation: wp.vec3,
        active: bool,
    ):
        """A particle out of every sphere, and above the ground."""
        for sphere in range(sphere_count):
            point, velocity = meet_sphere(
                bodies, obstacles, forces, row_of(centers, sphere), row_of(motions, sphere), step_seconds,
                world, sphere, substep, particle, mass, point, velocity, inflation, active,
            )  # fmt: skip
        point, velocity = meet_ground(obstacles, world, point, velocity, bodies.up, height)
        return point, velocity

    return meet_obstacles


@wp.func
def acceleration_by_touch(
    obstacles: ObstacleTable,
    forces: SphereForces,
    touched: bool,
    world: wp.int32,
    sphere: wp.int32,
    substep: wp.int32,
):
    """Acceleration of a sphere by the contacts of a substep [m/s^2]; most have none."""
    if not touched:
        return wp.vec3()
    mass = obstacles.sphere_mass[row_of_world(world, obstacles.sphere_mass.shape[0]), sphere]
    return total_newtons(forces.totals, force_row(world, substep), sphere) / mass


@wp.func
def moved_sphere(
    bodies: BodyTable,
    obstacles: ObstacleTable,
    forces: SphereForces,
    touched: bool,
    world: wp.int32,
    sphere: wp.int32,
    substep: wp.int32,
    center: wp.vec3,
    motion: wp.vec3,
    step_seconds: float,
):
    """Center and velocity of a sphere in this substep, under the contacts of the last."""
    new_center, new_motion = move_sphere(
        center,
        motion,
        acceleration_by_touch(obstacles, forces, touched, world, sphere, substep - 1),
        sphere_radius(obstacles, world, sphere),
        bodies.gravity[row_of_world(world, bodies.gravity.shape[0])],
        bodies.up,
        ground_height(obstacles, world),
        ground_restitution(obstacles, world),
        step_seconds,
    )
    return new_center, new_motion


@wp.func
def end_spheres(
    health: HealthTable,
    state: WorldState,
    forces: SphereForces,
    centers: Any,
    motions: Any,
    world: wp.int32,
    last_substep: wp.int32,
):
    """By one thread, after the last substep: the spheres into the state, and a look at them."""
    for sphere in range(state.sphere_positions.shape[1]):
        look_at_sphere(health, state.first_bad, world, state.points.shape[1], sphere, row_of(centers, sphere))
        state.sphere_positions[world, sphere] = row_of(centers, sphere)
        state.sphere_velocities[world, sphere] = row_of(motions, sphere)
        state.sphere_forces[world, sphere] = total_newtons(forces.totals, force_row(world, last_substep), sphere)

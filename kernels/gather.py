"""The `gather` schedule: a thread a particle, which sums its forces, moves, and leaves obstacles. No float atomics."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.air import area_vector_of_particle, drag_in_air, has_pressure
from balloon_warp.kernels.contact import collide, leave_ground, leave_sphere, move_sphere, penalty_force
from balloon_warp.kernels.contiguous import vector_at
from balloon_warp.kernels.fixed_point import add_quanta, set_quanta, total_newtons
from balloon_warp.kernels.gas import inflation_of_kind
from balloon_warp.kernels.inflation import inflation_force
from balloon_warp.kernels.motion import body_force, euler_step
from balloon_warp.kernels.pull import pull_of_strings, spring_puller
from balloon_warp.kernels.tables import (
    AirTable,
    BodyTable,
    FaceTable,
    ObstacleTable,
    SpringTable,
    StringTable,
    WaterTable,
    ground_friction,
    ground_height,
    ground_restitution,
    particle_damping,
    particle_mass,
    row_of_world,
    sphere_part,
)
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.water import water_force


@wp.func
def net_force(
    bodies: BodyTable,
    strings: StringTable,
    world: wp.int32,
    particle: wp.int32,
    point: wp.vec3,
    velocity: wp.vec3,
    mass: float,
    inflation: wp.vec3,
    pull: wp.vec3,
):
    """All forces on a particle but those of contacts [N]; `pull` is that of its springs, and of water and air."""
    balloon = bodies.balloon[particle]
    body = body_force(
        mass,
        bodies.gravity[row_of_world(world, bodies.gravity.shape[0])],
        bodies.helium[row_of_world(world, bodies.helium.shape[0]), balloon],
        particle_damping(bodies, world, particle),
        bodies.up,
        velocity,
    )
    return body + inflation + pull + pull_of_strings(strings, point, world, particle)


@cache
def leaving_obstacles(impulses: bool) -> Any:
    """The function that leaves obstacles, by either rule for spheres."""

    @wp.func
    def leave_obstacles(
        bodies: BodyTable,
        obstacles: ObstacleTable,
        sphere_positions: wp.array2d[wp.vec3],
        sphere_velocities: wp.array2d[wp.vec3],
        sphere_forces: wp.array3d[wp.int64],
        step_seconds: float,
        world: wp.int32,
        particle: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
        inflation: wp.vec3,
    ):
        """A particle that moves, out of every sphere, which gets its force, then above the ground."""
        for sphere in range(sphere_positions.shape[1]):
            radius = obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere]
            point, stopped, outward = leave_sphere(
                point, velocity, sphere_positions[world, sphere], sphere_velocities[world, sphere], radius, bodies.up
            )
            if wp.length_sq(outward) > 0.0:
                if wp.static(impulses):
                    mass = particle_mass(bodies, world, particle)
                    part = sphere_part(bodies, obstacles, world, particle, sphere)
                    velocity, push = collide(mass, part, velocity, stopped, step_seconds)
                else:
                    penalty = obstacles.sphere_penalty[row_of_world(world, obstacles.sphere_penalty.shape[0]), sphere]
                    velocity = stopped
                    push = penalty_force(penalty, inflation, outward)
                add_quanta(sphere_forces, world, sphere, push)
        point, velocity = leave_ground(
            point, velocity, bodies.up, ground_height(obstacles, world), ground_friction(obstacles, world)
        )
        return point, velocity

    return leave_obstacles


@cache
def force_kernel(traits: Traits) -> Any:
    """The kernel that finds all forces but the inflation's."""
    pull_of_springs = spring_puller(traits, vector_at)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fast_math": True})
    def sum_forces(
        # model
        bodies: BodyTable,
        springs: SpringTable,
        strings: StringTable,
        water: WaterTable,
        faces: FaceTable,
        air: AirTable,
        step_seconds: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # state out
        inflation_aims: wp.array2d[wp.vec3],
        forces: wp.array2d[wp.vec3],
    ):
        """A thread a (world, particle). The aim, too, where it is the area vector."""
        world, particle = wp.tid()
        mass = particle_mass(bodies, world, particle)
        point = points[world, particle]
        velocity = velocities[world, particle]
        pull = pull_of_springs(
            springs, points[world], 0, velocities[world], point, velocity, world, bodies.balloon[particle], particle
        )
        if wp.static(traits.in_water):
            pull += water_force(water, faces, bodies, points[world], 0, world, particle, velocity, step_seconds)
        if wp.static(traits.in_air):
            area_vector = area_vector_of_particle(faces, points[world], 0, particle)
            pull += drag_in_air(air, world, bodies.balloon[particle], area_vector, velocity)
            if has_pressure(air, bodies.balloon[particle]):
                inflation_aims[world, particle] = area_vector
        forces[world, particle] = net_force(bodies, strings, world, particle, point, velocity, mass, wp.vec3(), pull)

    return sum_forces


@cache
def meeting_kernel(impulses: bool) -> Any:
    """The kernel that lets particles leave obstacles after a correction."""
    leave_obstacles = leaving_obstacles(impulses)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fast_math": True})
    def meet_obstacles(
        # model
        bodies: BodyTable,
        obstacles: ObstacleTable,
        air: AirTable,
        step_seconds: float,
        time_in_frame: float,
        # state in
        inflation_aims: wp.array2d[wp.vec3],
        inflation_ramp: wp.array2d[wp.vec2],
        inflation_loads: wp.array2d[wp.vec2],
        sphere_positions: wp.array2d[wp.vec3],
        sphere_velocities: wp.array2d[wp.vec3],
        # state in and out
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        sphere_forces: wp.array3d[wp.int64],
    ):
        """A thread a (world, particle): out of obstacles, after a correction."""
        world, particle = wp.tid()
        if bodies.mass_share[particle] > 0.0:
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
            point, velocity = leave_obstacles(
                bodies, obstacles, sphere_positions, sphere_velocities, sphere_forces, step_seconds, world, particle,
                point, velocities[world, particle], inflation,
            )  # fmt: skip
            points[world, particle] = point
            velocities[world, particle] = velocity

    return meet_obstacles


@cache
def particle_kernel(traits: Traits) -> Any:
    """The kernel that advances the particles."""
    pull_of_springs = spring_puller(traits, vector_at)
    advance = euler_step(traits.forward_euler)
    leave_obstacles = leaving_obstacles(traits.impulses)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fast_math": True})
    def advance_particles(
        # model
        bodies: BodyTable,
        springs: SpringTable,
        strings: StringTable,
        obstacles: ObstacleTable,
        water: WaterTable,
        faces: FaceTable,
        step_seconds: float,
        time_in_frame: float,
        # state in
        inflation_aims: wp.array2d[wp.vec3],
        inflation_ramp: wp.array2d[wp.vec2],
        sphere_positions: wp.array2d[wp.vec3],
        sphere_velocities: wp.array2d[wp.vec3],
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # state out
        new_points: wp.array2d[wp.vec3],
        new_velocities: wp.array2d[wp.vec3],
        sphere_forces: wp.array3d[wp.int64],
    ):
        """A thread a (world, particle): one substep; the spheres have moved already. `new_points` is not `points`, and
        `new_velocities` is not `velocities` where a particle looks at its neighbors'. Where points are corrected, they
        are so before they meet obstacles, by `meeting_kernel`."""
        world, particle = wp.tid()
        mass = particle_mass(bodies, world, particle)
        velocity = velocities[world, particle]
        ramp = inflation_ramp[world, bodies.balloon[particle]]
        inflation = inflation_force(ramp[0] + ramp[1] * time_in_frame, inflation_aims[world, particle])
        point = points[world, particle]
        pull = pull_of_springs(
            springs, points[world], 0, velocities[world], point, velocity, world, bodies.balloon[particle], particle
        )
        if wp.static(traits.in_water):
            pull += water_force(water, faces, bodies, points[world], 0, world, particle, velocity, step_seconds)
        force = net_force(bodies, strings, world, particle, point, velocity, mass, inflation, pull)
        point, velocity = advance(point, velocity, force, mass, step_seconds)
        if wp.static(not traits.corrected) and mass > 0.0:
            point, velocity = leave_obstacles(
                bodies, obstacles, sphere_positions, sphere_velocities, sphere_forces, step_seconds, world, particle,
                point, velocity, inflation,
            )  # fmt: skip
        new_velocities[world, particle] = velocity
        new_points[world, particle] = point

    return advance_particles


@wp.kernel(enable_backward=False)
def move_gathered_spheres(
    # model
    bodies: BodyTable,
    obstacles: ObstacleTable,
    step_seconds: float,
    # state in and out
    sphere_positions: wp.array2d[wp.vec3],
    sphere_velocities: wp.array2d[wp.vec3],
    sphere_forces: wp.array3d[wp.int64],
):
    """A thread a (world, sphere): one substep under the forces since the last, which are then cleared."""
    world, sphere = wp.tid()
    position, velocity = move_sphere(
        sphere_positions[world, sphere],
        sphere_velocities[world, sphere],
        total_newtons(sphere_forces, world, sphere)
        / obstacles.sphere_mass[row_of_world(world, obstacles.sphere_mass.shape[0]), sphere],
        obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere],
        bodies.gravity[row_of_world(world, bodies.gravity.shape[0])],
        bodies.up,
        ground_height(obstacles, world),
        ground_restitution(obstacles, world),
        step_seconds,
    )
    sphere_positions[world, sphere] = position
    sphere_velocities[world, sphere] = velocity
    set_quanta(sphere_forces, world, sphere, wp.vec3())


@wp.kernel(enable_backward=False)
def read_sphere_forces(
    # state in
    sphere_forces: wp.array2d[wp.vec3],
    # state out
    sphere_quanta: wp.array3d[wp.int64],
):
    """A thread a (world, sphere): from newtons to whole numbers."""
    world, sphere = wp.tid()
    set_quanta(sphere_quanta, world, sphere, sphere_forces[world, sphere])


@wp.kernel(enable_backward=False)
def write_sphere_forces(
    # state in
    sphere_quanta: wp.array3d[wp.int64],
    # state out
    sphere_forces: wp.array2d[wp.vec3],
):
    """A thread a (world, sphere): from whole numbers to newtons."""
    world, sphere = wp.tid()
    sphere_forces[world, sphere] = total_newtons(sphere_quanta, world, sphere)

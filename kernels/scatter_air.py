"""Pressure, gas and air in the `scatter` schedule: a thread a face or a particle, with atomic adds.

`bodies` have the mass of their gas here, which moves along with them.
"""

import warp as wp

from balloon_warp.kernels.air import (
    drag_in_air,
    has_pressure,
    load_of_balloon,
    swelling_beside_obstacles,
    volume_origin,
)
from balloon_warp.kernels.gas import Swelling, area_vector_in_face, face_volume
from balloon_warp.kernels.motion import response
from balloon_warp.kernels.tables import AirTable, BodyTable, FaceTable, ObstacleTable, particle_mass


@wp.kernel(enable_backward=False)
def add_faces_to_swelling(
    # model
    faces: FaceTable,
    # state in
    points: wp.array2d[wp.vec3],
    # state out
    area_vectors: wp.array2d[wp.vec3],
    swellings: wp.array2d[Swelling],
):
    """A thread a (world, face): its parts of its particles' area vectors, and of its balloon's volume."""
    world, face = wp.tid()
    begin = faces.offsets[face]
    end = faces.offsets[face + 1]
    balloon = faces.balloon[face]
    origin = volume_origin(faces, points[world], 0, balloon)
    volume = face_volume(points[world], 0, faces.particles, begin, end, origin)
    wp.atomic_add(swellings, world, balloon, Swelling(volume, 0.0, 0.0, 0.0, 0.0))
    for corner in range(begin, end):
        particle = faces.particles[corner]
        repeated = bool(False)
        for earlier in range(begin, corner):
            repeated = repeated or faces.particles[earlier] == particle
        if not repeated:
            part = area_vector_in_face(points[world], 0, faces.particles, begin, end, particle, points[world, particle])
            wp.atomic_add(area_vectors, world, particle, part)


@wp.kernel(enable_backward=False)
def add_drag_and_swelling(
    # model
    bodies: BodyTable,
    air: AirTable,
    obstacles: ObstacleTable,
    step_seconds: float,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    sphere_positions: wp.array2d[wp.vec3],
    area_vectors: wp.array2d[wp.vec3],
    inflation_loads: wp.array2d[wp.vec2],
    # state out
    forces: wp.array2d[wp.vec3],
    swellings: wp.array2d[Swelling],
):
    """A thread a (world, particle): the last force but the pressure, then its part of its balloon's swelling."""
    world, particle = wp.tid()
    balloon = bodies.balloon[particle]
    area_vector = area_vectors[world, particle]
    velocity = velocities[world, particle]
    force = forces[world, particle] + drag_in_air(air, world, balloon, area_vector, velocity)
    forces[world, particle] = force
    mass = particle_mass(bodies, world, particle)
    part = swelling_beside_obstacles(
        bodies,
        obstacles,
        sphere_positions[world],
        world,
        points[world, particle],
        velocity + response(mass, step_seconds) * force,
        mass,
        bodies.mass_share[particle],
        area_vector,
        inflation_loads[world, balloon],
        step_seconds,
    )
    wp.atomic_add(swellings, world, balloon, part)


@wp.kernel(enable_backward=False)
def find_loads(
    # model
    bodies: BodyTable,
    air: AirTable,
    time_in_frame: float,
    step_seconds: float,
    # state in
    inflation_ramp: wp.array2d[wp.vec2],
    gas_amounts: wp.array2d[wp.float64],
    swellings: wp.array2d[Swelling],
    # state out
    inflation_loads: wp.array2d[wp.vec2],
    pressures: wp.array2d[float],
):
    """A thread a (world, balloon)."""
    world, balloon = wp.tid()
    if has_pressure(air, balloon):
        load = load_of_balloon(
            air,
            bodies,
            inflation_ramp[world, balloon],
            gas_amounts[world, balloon],
            swellings[world, balloon],
            world,
            balloon,
            time_in_frame,
            step_seconds,
        )
        pressures[world, balloon] = load[0]
        inflation_loads[world, balloon] = wp.vec2(load[1], load[2])


@wp.kernel(enable_backward=False)
def add_pressure_forces(
    # model
    bodies: BodyTable,
    air: AirTable,
    # state in
    points: wp.array2d[wp.vec3],
    area_vectors: wp.array2d[wp.vec3],
    inflation_loads: wp.array2d[wp.vec2],
    # state out
    forces: wp.array2d[wp.vec3],
    inflation_aims: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): pressure times area vector, which is its aim from then on."""
    world, particle = wp.tid()
    balloon = bodies.balloon[particle]
    if has_pressure(air, balloon):
        load = inflation_loads[world, balloon]
        area_vector = area_vectors[world, particle]
        forces[world, particle] += (load[0] + load[1] * wp.dot(points[world, particle], bodies.up)) * area_vector
        inflation_aims[world, particle] = area_vector

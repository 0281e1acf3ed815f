"""Gas and air as the schedules meet them: amounts that flow, loads on balloons, drag on particles."""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact import above_ground, out_of_sphere
from balloon_warp.kernels.gas import (
    GAS,
    PRESSURE,
    Swelling,
    air_drag,
    area_vector_in_face,
    dry_air_density,
    gas_load,
    molar_volume,
    swelling_of_particle,
    tube_flow,
)
from balloon_warp.kernels.motion import response
from balloon_warp.kernels.tables import (
    AirTable,
    BodyTable,
    FaceTable,
    ObstacleTable,
    ground_height,
    particle_mass,
    row_of_world,
)


@wp.func
def area_vector_of_particle(faces: FaceTable, points: Any, first: wp.int32, particle: wp.int32):
    """Gradient of the volume with respect to a particle's place [m^2]; particle p stands at `points[first + p]`."""
    point = points[first + particle]
    area_vector = 0.0 * point
    for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
        face = faces.around_particles[incidence]
        area_vector = area_vector + area_vector_in_face(
            points, first, faces.particles, faces.offsets[face], faces.offsets[face + 1], particle, point
        )
    return area_vector


@wp.func
def volume_origin(faces: FaceTable, points: Any, first: wp.int32, balloon: wp.int32):
    """A point of the balloon's own, about which its volume is taken: that keeps float32's digits."""
    return points[first + faces.particles[faces.offsets[faces.balloon_offsets[balloon]]]]


@wp.func
def has_pressure(air: AirTable, balloon: wp.int32):
    """Whether a balloon's aims are its area vectors."""
    return air.kind[balloon] == PRESSURE or air.kind[balloon] == GAS


@wp.func
def air_pressure(air: AirTable, world: wp.int32):
    """[Pa]"""
    return air.pressure[row_of_world(world, air.pressure.shape[0])]


@wp.func
def air_temperature(air: AirTable, world: wp.int32):
    """[K]"""
    return air.temperature[row_of_world(world, air.temperature.shape[0])]


@wp.func
def air_density(air: AirTable, world: wp.int32):
    """[kg/m^3]"""
    density = air.density[row_of_world(world, air.density.shape[0])]
    if density < 0.0:
        return dry_air_density(air_pressure(air, world), air_temperature(air, world))
    return density


@wp.func
def gas_mass(air: AirTable, amounts: wp.array[wp.float64], world: wp.int32, balloon: wp.int32):
    """Of what is in a balloon [kg]."""
    return float(amounts[balloon]) * air.molar_mass[row_of_world(world, air.molar_mass.shape[0]), balloon]


@wp.func
def inertia_of_particle(
    bodies: BodyTable, air: AirTable, amounts: wp.array[wp.float64], world: wp.int32, particle: wp.int32
):
    """Its mass and its share of the gas, which moves along [kg]; 0 for a fixed particle."""
    gas = gas_mass(air, amounts, world, bodies.balloon[particle])
    return particle_mass(bodies, world, particle) + bodies.mass_share[particle] * gas


@wp.func
def drag_in_air(air: AirTable, world: wp.int32, balloon: wp.int32, area_vector: wp.vec3, velocity: wp.vec3):
    """Force of the air on a particle [N]."""
    return air_drag(
        air_density(air, world),
        air.drag_coefficient[row_of_world(world, air.drag_coefficient.shape[0]), balloon],
        air.wind[row_of_world(world, air.wind.shape[0])],
        area_vector,
        velocity,
    )


@wp.func
def move_gas(
    air: AirTable,
    inflation_ramp: wp.array[wp.vec2],
    pressures: wp.array[float],
    amounts: wp.array[wp.float64],
    world: wp.int32,
    time_in_frame: float,
    step_seconds: float,
):
    """By one thread of a world, whose rows the arrays are: what is pumped, and flows through tubes, in a substep."""
    for balloon in range(air.kind.shape[0]):
        if air.kind[balloon] == GAS:
            ramp = inflation_ramp[balloon]
            pumped = step_seconds * (ramp[0] + ramp[1] * (time_in_frame + 0.5 * step_seconds))
            amounts[balloon] = wp.max(amounts[balloon] + wp.float64(pumped), wp.float64(0.0))
    for tube in range(air.tube_balloons.shape[0]):
        first = air.tube_balloons[tube][0]
        second = air.tube_balloons[tube][1]
        flow = tube_flow(
            air.tube_conductance[row_of_world(world, air.tube_conductance.shape[0]), tube],
            wp.vec2(pressures[first], pressures[second]),
            wp.vec2(float(amounts[first]), float(amounts[second])),
            air.gamma[row_of_world(world, air.gamma.shape[0]), first],
            air_pressure(air, world),
            step_seconds,
        )
        amounts[first] = wp.max(amounts[first] - wp.float64(flow), wp.float64(0.0))
        amounts[second] = wp.max(amounts[second] + wp.float64(flow), wp.float64(0.0))


@wp.func
def outside_obstacles(
    obstacles: ObstacleTable, sphere_positions: wp.array[wp.vec3], world: wp.int32, up: wp.vec3, point: wp.vec3
):
    """Where obstacles let a point go, and the normal of the last one that it met there, zero if none."""
    normal = wp.vec3()
    for sphere in range(sphere_positions.shape[0]):
        radius = obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere]
        point, normal = out_of_sphere(point, normal, sphere_positions[sphere], radius, up)
    point, normal = above_ground(point, normal, up, ground_height(obstacles, world))
    return point, normal


@wp.func
def velocity_beside_obstacles(
    obstacles: ObstacleTable,
    sphere_positions: wp.array[wp.vec3],
    world: wp.int32,
    up: wp.vec3,
    point: wp.vec3,
    velocity: wp.vec3,
    step_seconds: float,
):
    """The velocity at which obstacles let a particle move in a step, and their normal, zero if it meets none."""
    end = point + step_seconds * velocity
    outside, normal = outside_obstacles(obstacles, sphere_positions, world, up, end)
    return velocity + (outside - end) / step_seconds, normal


@wp.func
def swelling_beside_obstacles(
    bodies: BodyTable,
    obstacles: ObstacleTable,
    sphere_positions: wp.array[wp.vec3],
    world: wp.int32,
    point: wp.vec3,
    velocity: wp.vec3,
    mass: float,
    share: float,
    area_vector: wp.vec3,
    load: wp.vec2,
    step_seconds: float,
):
    """A particle's part of its balloon's swelling, under the old load; the velocity is that without inflation."""
    height = wp.dot(point, bodies.up)
    push = load[0] + load[1] * height
    velocity += response(mass, step_seconds) * push * area_vector
    normal = wp.vec3()
    if mass > 0.0:
        velocity, normal = velocity_beside_obstacles(
            obstacles, sphere_positions, world, bodies.up, point, velocity, step_seconds
        )
    return swelling_of_particle(area_vector, velocity, normal, mass, share, height, push, step_seconds)


@wp.func
def load_of_balloon(
    air: AirTable,
    bodies: BodyTable,
    ramp: wp.vec2,
    amount: wp.float64,
    swelling: Swelling,
    world: wp.int32,
    balloon: wp.int32,
    time_in_frame: float,
    step_seconds: float,
):
    """Pressure above the air's at the center of mass [Pa], at height 0, and its rise with height [Pa/m]."""
    if air.kind[balloon] == PRESSURE:
        given = ramp[0] + ramp[1] * time_in_frame
        return wp.vec3(given, given, 0.0)
    return gas_load(
        swelling,
        air_pressure(air, world),
        air_density(air, world),
        float(amount),
        molar_volume(air_pressure(air, world), air_temperature(air, world)),
        air.molar_mass[row_of_world(world, air.molar_mass.shape[0]), balloon],
        air.gamma[row_of_world(world, air.gamma.shape[0]), balloon],
        bodies.gravity[row_of_world(world, bodies.gravity.shape[0])],
        step_seconds,
    )


@wp.kernel(enable_backward=False)
def move_gases(
    # model
    bodies: BodyTable,
    air: AirTable,
    time_in_frame: float,
    step_seconds: float,
    # state in
    inflation_ramp: wp.array2d[wp.vec2],
    pressures: wp.array2d[float],
    # state in and out
    gas_amounts: wp.array2d[wp.float64],
    # state out
    masses: wp.array2d[float],
):
    """A thread a world: what is pumped, what flows through tubes, and the masses of the balloons with their gas."""
    world = wp.tid()
    move_gas(air, inflation_ramp[world], pressures[world], gas_amounts[world], world, time_in_frame, step_seconds)
    for balloon in range(masses.shape[1]):
        own = bodies.mass[row_of_world(world, bodies.mass.shape[0]), balloon]
        masses[world, balloon] = own + gas_mass(air, gas_amounts[world], world, balloon)

"""Pressure, gas and air in the `block` schedule.

Amounts of gas change while threads still read them: each world has two rows of them, of which a substep reads one, and
its first thread fills the other for the next.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.air import (
    area_vector_of_particle,
    drag_in_air,
    has_pressure,
    inertia_of_particle,
    move_gas,
    swelling_beside_obstacles,
    volume_origin,
)
from balloon_warp.kernels.gas import face_volume, inflation_of_kind
from balloon_warp.kernels.gather import net_force
from balloon_warp.kernels.motion import response
from balloon_warp.kernels.tables import (
    AirTable,
    BodyTable,
    FaceTable,
    ObstacleTable,
    StringTable,
    WorldState,
    particle_mass,
)

GAS_ROWS = 2


@wp.func
def gas_row(world: wp.int32, substep: wp.int32):
    """Where the amounts of gas of a substep stand."""
    return GAS_ROWS * world + substep % GAS_ROWS


@wp.func
def begin_gas(air: AirTable, state: WorldState, gas_rows: wp.array2d[wp.float64], world: wp.int32, step_seconds: float):
    """By one thread: the amounts of the first substep."""
    for balloon in range(air.kind.shape[0]):
        gas_rows[gas_row(world, 0), balloon] = state.gas_amounts[world, balloon]
    amounts = gas_rows[gas_row(world, 0)]
    move_gas(air, state.inflation_ramp[world], state.pressures[world], amounts, world, 0.0, step_seconds)


@wp.func
def next_gas(
    air: AirTable,
    state: WorldState,
    gas_rows: wp.array2d[wp.float64],
    world: wp.int32,
    substep: wp.int32,
    next_time_in_frame: float,
    step_seconds: float,
):
    """By one thread: the amounts of the substep after this one, and those of this one as the state's."""
    for balloon in range(air.kind.shape[0]):
        amount = gas_rows[gas_row(world, substep), balloon]
        state.gas_amounts[world, balloon] = amount
        gas_rows[gas_row(world, substep + 1), balloon] = amount
    amounts = gas_rows[gas_row(world, substep + 1)]
    move_gas(air, state.inflation_ramp[world], state.pressures[world], amounts, world, next_time_in_frame, step_seconds)


@wp.func
def keep_load(state: WorldState, world: wp.int32, balloon: wp.int32, load: wp.vec3):
    """By one thread: pressure and load, as the state's."""
    state.pressures[world, balloon] = load[0]
    state.inflation_loads[world, balloon] = wp.vec2(load[1], load[2])


@wp.func
def start_particle(
    bodies: BodyTable,
    strings: StringTable,
    obstacles: ObstacleTable,
    faces: FaceTable,
    air: AirTable,
    state: WorldState,
    points: Any,
    first: wp.int32,
    world: wp.int32,
    particle: wp.int32,
    velocity: wp.vec3,
    pull: wp.vec3,
    amounts: wp.array[wp.float64],
    new_velocities: wp.array[wp.vec3],
    step_seconds: float,
):
    """A particle's velocity without the inflation, and its aim, into memory; its part of the balloon's swelling."""
    balloon = bodies.balloon[particle]
    point = points[first + particle]
    area_vector = area_vector_of_particle(faces, points, first, particle)
    if has_pressure(air, balloon):
        state.inflation_aims[world, particle] = area_vector
    drag = drag_in_air(air, world, balloon, area_vector, velocity)
    mass = particle_mass(bodies, world, particle)
    force = net_force(bodies, strings, world, particle, point, velocity, mass, drag, pull)
    inertia = inertia_of_particle(bodies, air, amounts, world, particle)
    new_velocity = velocity + response(inertia, step_seconds) * force
    new_velocities[particle] = new_velocity
    return swelling_beside_obstacles(
        bodies,
        obstacles,
        state.sphere_positions[world],
        world,
        point,
        new_velocity,
        inertia,
        bodies.mass_share[particle],
        area_vector,
        state.inflation_loads[world, balloon],
        step_seconds,
    )


@wp.func
def part_of_volume(faces: FaceTable, points: Any, first: wp.int32, balloon: wp.int32, lane: wp.int32):
    """One thread's part of a balloon's volume [m^3]."""
    origin = volume_origin(faces, points, first, balloon)
    part = float(0.0)
    for face in range(faces.balloon_offsets[balloon] + lane, faces.balloon_offsets[balloon + 1], wp.block_dim()):
        part += face_volume(points, first, faces.particles, faces.offsets[face], faces.offsets[face + 1], origin)
    return part


@wp.func
def inflation_in_air(
    bodies: BodyTable,
    air: AirTable,
    state: WorldState,
    world: wp.int32,
    particle: wp.int32,
    point: wp.vec3,
    load: wp.vec3,
    time_in_frame: float,
):
    """Force of the inflation on a particle [N], under its balloon's load."""
    balloon = bodies.balloon[particle]
    ramp = state.inflation_ramp[world, balloon]
    return inflation_of_kind(
        air.kind[balloon],
        ramp[0] + ramp[1] * time_in_frame,
        wp.vec2(load[1], load[2]),
        wp.dot(point, bodies.up),
        state.inflation_aims[world, particle],
    )

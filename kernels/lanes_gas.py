"""Gas in eight worlds side by side: what flows, how balloons swell, and the pressure that follows."""

import warp as wp

from balloon_warp.kernels.air import gas_mass, load_of_balloon, move_gas, velocity_beside_obstacles
from balloon_warp.kernels.gas import (
    HEIGHT,
    RATE,
    RESPONSE,
    RESPONSE_HEIGHT,
    Swelling,
    swelling_of_particle,
)
from balloon_warp.kernels.lanes_contact import touches_ground, touches_sphere
from balloon_warp.kernels.lanes_state import (
    INERTIA,
    LOAD,
    LOAD_RISE,
    MASS,
    RAMP_BEGIN,
    RAMP_SLOPE,
    SWELLING,
    LaneState,
    world_of,
)
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3, column, lanes_scaled, parts_along, set_column
from balloon_warp.kernels.motion import response
from balloon_warp.kernels.tables import AirTable, BodyTable, ObstacleTable, WorldState


@wp.func
def move_gas_lanes(
    air: AirTable, state: WorldState, lanes: LaneState, group: wp.int32, time_in_frame: float, step_seconds: float
):
    """What is pumped, and flows through tubes; the balloons' masses with their gas."""
    for lane in range(LANE_COUNT):
        world = group * LANE_COUNT + lane
        if world < state.points.shape[0]:
            amounts = state.gas_amounts[world]
            move_gas(
                air, state.inflation_ramp[world], state.pressures[world], amounts, world, time_in_frame, step_seconds
            )
    for lane in range(LANE_COUNT):
        world = world_of(state, group, lane)
        amounts = state.gas_amounts[world]
        for balloon in range(air.kind.shape[0]):
            gas = gas_mass(air, amounts, world, balloon)
            lanes.balloons[group, balloon, INERTIA][lane] = lanes.balloons[group, balloon, MASS][lane] + gas


@wp.func
def begin_swelling_lanes(state: WorldState, numbers: wp.array[Lanes], group: wp.int32, balloon: wp.int32):
    """No particles' parts so far; and the load before, under which they move."""
    for number in range(5):
        numbers[SWELLING + number] = Lanes()
    for lane in range(LANE_COUNT):
        load = state.inflation_loads[world_of(state, group, lane), balloon]
        numbers[LOAD][lane] = load[0]
        numbers[LOAD_RISE][lane] = load[1]


@wp.func
def meets_obstacle(lanes: LaneState, group: wp.int32, up: wp.vec3, point: Lanes3):
    """Whether a point is inside a sphere, or below the ground, in any of the worlds."""
    meets = touches_ground(lanes, group, up, point)
    for sphere in range(lanes.sphere_squared_radii.shape[1]):
        meets = meets or touches_sphere(lanes, group, sphere, point)
    return meets


@wp.func
def velocity_beside_obstacle_lanes(
    bodies: BodyTable,
    obstacles: ObstacleTable,
    state: WorldState,
    group: wp.int32,
    point: Lanes3,
    velocity: Lanes3,
    step_seconds: float,
):
    """The velocities at which obstacles let a particle move in a step, and their normals, zero in worlds without."""
    normal = Lanes3()
    for lane in range(LANE_COUNT):
        world = world_of(state, group, lane)
        along, away = velocity_beside_obstacles(
            obstacles,
            state.sphere_positions[world],
            world,
            bodies.up,
            column(point, lane),
            column(velocity, lane),
            step_seconds,
        )
        velocity = set_column(velocity, lane, along)
        normal = set_column(normal, lane, away)
    return velocity, normal


@wp.func
def add_particle_to_swelling(
    bodies: BodyTable,
    obstacles: ObstacleTable,
    state: WorldState,
    lanes: LaneState,
    numbers: wp.array[Lanes],
    group: wp.int32,
    balloon: wp.int32,
    share: float,
    point: Lanes3,
    area_vector: Lanes3,
    velocity: Lanes3,
    step_seconds: float,
):
    """A particle's part of its balloon's swelling in each world, into `numbers`."""
    inertia = numbers[INERTIA]
    loads = numbers[LOAD]
    rises = numbers[LOAD_RISE]
    heights = parts_along(point, bodies.up)
    pushes = Lanes()
    gains = Lanes()
    for lane in range(LANE_COUNT):
        pushes[lane] = loads[lane] + rises[lane] * heights[lane]
        gains[lane] = response(share * inertia[lane], step_seconds) * pushes[lane]
    velocity = velocity + lanes_scaled(area_vector, gains)
    normal = Lanes3()
    if share > 0.0 and meets_obstacle(lanes, group, bodies.up, point + step_seconds * velocity):
        velocity, normal = velocity_beside_obstacle_lanes(
            bodies, obstacles, state, group, point, velocity, step_seconds
        )
    responses = numbers[SWELLING + RESPONSE]
    rates = numbers[SWELLING + RATE]
    height_sums = numbers[SWELLING + HEIGHT]
    response_heights = numbers[SWELLING + RESPONSE_HEIGHT]
    for lane in range(LANE_COUNT):
        part = swelling_of_particle(
            column(area_vector, lane),
            column(velocity, lane),
            column(normal, lane),
            share * inertia[lane],
            share,
            heights[lane],
            pushes[lane],
            step_seconds,
        )
        responses[lane] += part[RESPONSE]
        rates[lane] += part[RATE]
        height_sums[lane] += part[HEIGHT]
        response_heights[lane] += part[RESPONSE_HEIGHT]
    numbers[SWELLING + RESPONSE] = responses
    numbers[SWELLING + RATE] = rates
    numbers[SWELLING + HEIGHT] = height_sums
    numbers[SWELLING + RESPONSE_HEIGHT] = response_heights


@wp.func
def find_load_lanes(
    air: AirTable,
    bodies: BodyTable,
    state: WorldState,
    numbers: wp.array[Lanes],
    group: wp.int32,
    balloon: wp.int32,
    time_in_frame: float,
    step_seconds: float,
):
    """A balloon's pressure and load in each world, from its swelling, into `numbers` and the state."""
    for lane in range(LANE_COUNT):
        world = world_of(state, group, lane)
        swelling = Swelling()
        for number in range(5):
            swelling[number] = numbers[SWELLING + number][lane]
        ramp = wp.vec2(numbers[RAMP_BEGIN][lane], numbers[RAMP_SLOPE][lane])
        amount = state.gas_amounts[world, balloon]
        load = load_of_balloon(air, bodies, ramp, amount, swelling, world, balloon, time_in_frame, step_seconds)
        numbers[LOAD][lane] = load[1]
        numbers[LOAD_RISE][lane] = load[2]
        if group * LANE_COUNT + lane < state.points.shape[0]:
            state.pressures[world, balloon] = load[0]
            state.inflation_loads[world, balloon] = wp.vec2(load[1], load[2])

"""Pressure, gas and air in eight worlds side by side."""

import warp as wp

from balloon_warp.kernels.air import (
    drag_in_air,
    gas_mass,
    load_of_balloon,
    move_gas,
    swelling_beside_obstacles,
    volume_origin,
)
from balloon_warp.kernels.gas import (
    HEIGHT,
    RATE,
    RESPONSE,
    RESPONSE_HEIGHT,
    VOLUME,
    Swelling,
    cone_volume,
    inflation_of_kind,
)
from balloon_warp.kernels.inflation import face_area_vector, face_center
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
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3, column, set_column
from balloon_warp.kernels.tables import AirTable, BodyTable, FaceTable, ObstacleTable, WorldState


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
def drag_lanes(air: AirTable, state: WorldState, group: wp.int32, balloon: wp.int32, area: Lanes3, velocity: Lanes3):
    """Force of the air on a particle in each world [N]."""
    force = Lanes3()
    for lane in range(LANE_COUNT):
        world = world_of(state, group, lane)
        force = set_column(force, lane, drag_in_air(air, world, balloon, column(area, lane), column(velocity, lane)))
    return force


@wp.func
def add_particle_to_swelling(
    bodies: BodyTable,
    obstacles: ObstacleTable,
    state: WorldState,
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
    for lane in range(LANE_COUNT):
        world = world_of(state, group, lane)
        part = swelling_beside_obstacles(
            bodies,
            obstacles,
            state.sphere_positions[world],
            world,
            column(point, lane),
            column(velocity, lane),
            share * numbers[INERTIA][lane],
            share,
            column(area_vector, lane),
            state.inflation_loads[world, balloon],
            step_seconds,
        )
        numbers[SWELLING + RESPONSE][lane] += part[RESPONSE]
        numbers[SWELLING + RATE][lane] += part[RATE]
        numbers[SWELLING + HEIGHT][lane] += part[HEIGHT]
        numbers[SWELLING + RESPONSE_HEIGHT][lane] += part[RESPONSE_HEIGHT]


@wp.func
def add_volume_to_swelling(faces: FaceTable, points: wp.array[Lanes3], numbers: wp.array[Lanes], balloon: wp.int32):
    """A balloon's volume in each world, into `numbers`."""
    origin = volume_origin(faces, points, 0, balloon)
    volumes = Lanes()
    for face in range(faces.balloon_offsets[balloon], faces.balloon_offsets[balloon + 1]):
        begin = faces.offsets[face]
        end = faces.offsets[face + 1]
        center = face_center(points, 0, faces.particles, begin, end)
        area_vector = face_area_vector(points, 0, faces.particles, begin, end, center)
        arm = center - origin
        for lane in range(LANE_COUNT):
            volumes[lane] += cone_volume(column(arm, lane), column(area_vector, lane))
    numbers[SWELLING + VOLUME] = volumes


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


@wp.func
def inflation_in_lane(
    air: AirTable, balloon: wp.int32, numbers: wp.array[Lanes], lane: wp.int32, time_in_frame: float, height: float,
    aim: wp.vec3,
):  # fmt: skip
    """Force of the inflation on a particle in one world [N]."""
    return inflation_of_kind(
        air.kind[balloon],
        numbers[RAMP_BEGIN][lane] + numbers[RAMP_SLOPE][lane] * time_in_frame,
        wp.vec2(numbers[LOAD][lane], numbers[LOAD_RISE][lane]),
        height,
        aim,
    )

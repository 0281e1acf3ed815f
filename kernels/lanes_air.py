"""Area vectors, drag in air and inflation in eight worlds side by side."""

import warp as wp

from balloon_warp.kernels.air import air_density
from balloon_warp.kernels.gas import area_vector_at_corner, drag_pressure, inflation_of_kind, push_of_kind
from balloon_warp.kernels.inflation import face_area_vector, face_center
from balloon_warp.kernels.lanes_state import (
    AIR_DENSITY,
    DRAG_COEFFICIENT,
    LOAD,
    LOAD_RISE,
    RAMP_BEGIN,
    RAMP_SLOPE,
    WIND,
    LaneState,
    world_of,
)
from balloon_warp.kernels.lanes_types import (
    LANE_COUNT,
    Lanes,
    Lanes3,
    dot_products,
    lanes_scaled,
    parts_along,
    squared_lengths,
)
from balloon_warp.kernels.tables import AirTable, FaceTable, WorldState, row_of_world


@wp.func
def read_air_lanes(air: AirTable, state: WorldState, lanes: LaneState, group: wp.int32):
    """Into the lanes, the air of each world."""
    for lane in range(LANE_COUNT):
        world = world_of(state, group, lane)
        wind = air.wind[row_of_world(world, air.wind.shape[0])]
        for balloon in range(air.kind.shape[0]):
            drag_coefficient = air.drag_coefficient[row_of_world(world, air.drag_coefficient.shape[0]), balloon]
            lanes.balloons[group, balloon, AIR_DENSITY][lane] = air_density(air, world)
            lanes.balloons[group, balloon, DRAG_COEFFICIENT][lane] = drag_coefficient
            for axis in range(3):
                lanes.balloons[group, balloon, WIND + axis][lane] = wind[axis]


@wp.func
def measure_balloon_lanes(
    faces: FaceTable,
    points: wp.array[Lanes3],
    balloon: wp.int32,
    first_particle: wp.int32,
    last_particle: wp.int32,
    # out
    area_vectors: wp.array[Lanes3],
):
    """The area vectors of a balloon's particles, face by face, and its volume in each world."""
    for particle in range(first_particle, last_particle):
        area_vectors[particle] = Lanes3()
    origin = points[first_particle]
    volumes = Lanes()
    for face in range(faces.balloon_offsets[balloon], faces.balloon_offsets[balloon + 1]):
        begin = faces.offsets[face]
        end = faces.offsets[face + 1]
        corners = float(end - begin)
        center = face_center(points, 0, faces.particles, begin, end)
        area_vector = face_area_vector(points, 0, faces.particles, begin, end, center)
        volumes += dot_products(center - origin, area_vector) / 3.0
        double_area = 2.0 * area_vector
        before = points[faces.particles[end - 1]]
        particle = faces.particles[begin]
        here = points[particle]
        for corner in range(begin, end):
            after_corner = corner + 1
            if after_corner == end:
                after_corner = begin
            next_particle = faces.particles[after_corner]
            after = points[next_particle]
            area_vectors[particle] = area_vectors[particle] + area_vector_at_corner(
                double_area, after - before, corners * (center - here), corners
            )
            before = here
            here = after
            particle = next_particle
    return volumes


@wp.func
def wind_lanes(numbers: wp.array[Lanes]):
    """Velocity of the air in each world [m/s]."""
    east = numbers[WIND]
    up = numbers[WIND + 1]
    south = numbers[WIND + 2]
    wind = Lanes3()
    for lane in range(LANE_COUNT):
        wind[0, lane] = east[lane]
        wind[1, lane] = up[lane]
        wind[2, lane] = south[lane]
    return wind


@wp.func
def drag_lanes(numbers: wp.array[Lanes], area_vector: Lanes3, velocity: Lanes3):
    """Force of the air on a particle in each world [N]."""
    densities = numbers[AIR_DENSITY]
    coefficients = numbers[DRAG_COEFFICIENT]
    fluxes = dot_products(velocity - wind_lanes(numbers), area_vector)
    squared_areas = squared_lengths(area_vector)
    pressures = Lanes()
    for lane in range(LANE_COUNT):
        pressures[lane] = drag_pressure(densities[lane], coefficients[lane], fluxes[lane], squared_areas[lane])
    return lanes_scaled(area_vector, pressures)


@wp.func
def inflation_lanes(
    kind: wp.int32, numbers: wp.array[Lanes], time_in_frame: float, up: wp.vec3, point: Lanes3, aim: Lanes3
):
    """Force of the inflation on a particle in each world [N]."""
    begin = numbers[RAMP_BEGIN]
    slope = numbers[RAMP_SLOPE]
    loads = numbers[LOAD]
    rises = numbers[LOAD_RISE]
    heights = parts_along(point, up)
    pushes = Lanes()
    for lane in range(LANE_COUNT):
        k_normal = begin[lane] + slope[lane] * time_in_frame
        pushes[lane] = push_of_kind(kind, k_normal, wp.vec2(loads[lane], rises[lane]), heights[lane])
    return lanes_scaled(aim, pushes)


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

"""The state of eight worlds side by side: read from the worlds at the start of a frame, written back at its end."""

import warp as wp

from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3, column
from balloon_warp.kernels.tables import (
    BodyTable,
    ObstacleTable,
    SpringTable,
    WorldState,
    ground_height,
    row_of_world,
    spring_constant,
    spring_viscosity,
    spring_yield,
)

# What a balloon has in `LaneState.balloons`: a number in each world.
MASS = wp.constant(3)  # 0, 1 and 2 are the spring constants of the kinds
HELIUM = wp.constant(4)
DAMPING = wp.constant(5)
GRAVITY = wp.constant(6)
RAMP_BEGIN = wp.constant(7)
RAMP_SLOPE = wp.constant(8)
VISCOSITY = wp.constant(9)
YIELD_STRETCH = wp.constant(10)
INERTIA = wp.constant(11)  # the mass, and that of the gas
LOAD = wp.constant(12)
LOAD_RISE = wp.constant(13)
SWELLING = wp.constant(14)  # five numbers, as in `gas`
CORRECTION_LIMIT = wp.constant(19)
TORSION = wp.constant(20)
AIR_DENSITY = wp.constant(21)
DRAG_COEFFICIENT = wp.constant(22)
WIND = wp.constant(23)  # its three components
BALLOON_NUMBERS = 26


@wp.struct
class LaneTraits:
    """What the scene uses: see `kernels.traits.Traits`."""

    fresh_normals: bool
    rubber: bool
    in_air: bool
    forward_euler: bool
    impulses: bool


@wp.struct
class LaneState:
    """Working memory, a row for each group of eight worlds."""

    points: wp.array2d[Lanes3]
    other_points: wp.array2d[Lanes3]
    velocities: wp.array2d[Lanes3]
    old_velocities: wp.array2d[Lanes3]
    """before the substep; empty unless they are needed"""
    aims: wp.array2d[Lanes3]
    area_vectors: wp.array2d[Lanes3]
    """of balloons whose aims they are not; empty where there is no air"""
    face_centers: wp.array2d[Lanes3]
    face_area_vectors: wp.array2d[Lanes3]
    balloon_areas: wp.array2d[Lanes]
    balloons: wp.array3d[Lanes]
    sphere_centers: wp.array2d[Lanes3]
    sphere_squared_radii: wp.array2d[Lanes]
    ground_heights: wp.array[Lanes]
    water_forces: wp.array2d[Lanes3]
    """empty where there is no water"""
    water_loads: wp.array2d[wp.vec4]
    """of one world at a time; empty where there is no water"""


@wp.func
def world_of(state: WorldState, group: wp.int32, lane: wp.int32):
    """The world in a lane; lanes that are left over in the last group copy the last world."""
    return wp.min(group * LANE_COUNT + lane, state.points.shape[0] - 1)


@wp.func
def read_lanes(
    bodies: BodyTable,
    springs: SpringTable,
    obstacles: ObstacleTable,
    state: WorldState,
    lanes: LaneState,
    group: wp.int32,
):
    """Into the lanes, what a frame begins with."""
    for lane in range(LANE_COUNT):
        world = world_of(state, group, lane)
        lanes.ground_heights[group][lane] = ground_height(obstacles, world)
        for particle in range(state.points.shape[1]):
            for axis in range(3):
                lanes.points[group, particle][axis, lane] = state.points[world, particle][axis]
                lanes.velocities[group, particle][axis, lane] = state.velocities[world, particle][axis]
        for balloon in range(state.inflation_ramp.shape[1]):
            for kind in range(3):
                lanes.balloons[group, balloon, kind][lane] = spring_constant(springs, world, balloon, kind)
            mass = bodies.mass[row_of_world(world, bodies.mass.shape[0]), balloon]
            helium = bodies.helium[row_of_world(world, bodies.helium.shape[0]), balloon]
            damping = bodies.damping[row_of_world(world, bodies.damping.shape[0]), balloon]
            gravity = bodies.gravity[row_of_world(world, bodies.gravity.shape[0])]
            lanes.balloons[group, balloon, VISCOSITY][lane] = spring_viscosity(springs, world, balloon)
            lanes.balloons[group, balloon, YIELD_STRETCH][lane] = spring_yield(springs, world, balloon)
            torsion = springs.hinges.stiffness
            lanes.balloons[group, balloon, TORSION][lane] = torsion[row_of_world(world, torsion.shape[0]), balloon]
            lanes.balloons[group, balloon, CORRECTION_LIMIT][lane] = springs.limits[
                row_of_world(world, springs.limits.shape[0])
            ]
            lanes.balloons[group, balloon, MASS][lane] = mass
            lanes.balloons[group, balloon, HELIUM][lane] = helium
            lanes.balloons[group, balloon, DAMPING][lane] = damping
            lanes.balloons[group, balloon, GRAVITY][lane] = gravity
            lanes.balloons[group, balloon, RAMP_BEGIN][lane] = state.inflation_ramp[world, balloon][0]
            lanes.balloons[group, balloon, RAMP_SLOPE][lane] = state.inflation_ramp[world, balloon][1]
        for sphere in range(state.sphere_positions.shape[1]):
            radius = obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere]
            lanes.sphere_squared_radii[group, sphere][lane] = radius * radius


@wp.func
def write_lanes(state: WorldState, lanes: LaneState, points: wp.array[Lanes3], group: wp.int32):
    """Out of the lanes, what a frame ends with."""
    for lane in range(LANE_COUNT):
        world = group * LANE_COUNT + lane
        if world < state.points.shape[0]:
            for particle in range(state.points.shape[1]):
                state.points[world, particle] = column(points[particle], lane)
                state.velocities[world, particle] = column(lanes.velocities[group, particle], lane)
                state.inflation_aims[world, particle] = column(lanes.aims[group, particle], lane)

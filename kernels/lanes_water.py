"""Water beside eight worlds. The surface cuts the faces of each world elsewhere: each is looked at by itself."""

import warp as wp

from balloon_warp.kernels.lanes_state import LaneState, world_of
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes3, column, set_column
from balloon_warp.kernels.tables import BodyTable, FaceTable, WaterTable, WorldState
from balloon_warp.kernels.water import water_force


@wp.func
def set_water_force_lanes(
    water: WaterTable,
    faces: FaceTable,
    bodies: BodyTable,
    state: WorldState,
    lanes: LaneState,
    points: wp.array[Lanes3],
    group: wp.int32,
    step_seconds: float,
):
    """Forces of the water on all particles. Until the frame is written, the state holds the points of this substep."""
    for lane in range(LANE_COUNT):
        world = world_of(state, group, lane)
        for particle in range(points.shape[0]):
            state.points[world, particle] = column(points[particle], lane)
        for particle in range(points.shape[0]):
            velocity = column(lanes.velocities[group, particle], lane)
            force = water_force(water, faces, bodies, state.points[world], 0, world, particle, velocity, step_seconds)
            lanes.water_forces[group, particle] = set_column(lanes.water_forces[group, particle], lane, force)

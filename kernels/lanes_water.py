"""Water beside eight worlds. The surface cuts the faces of each world elsewhere: each is looked at by itself."""

import warp as wp

from balloon_warp.kernels.lanes_state import LaneState, world_of
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes3, column
from balloon_warp.kernels.tables import BodyTable, FaceTable, WaterTable, WorldState
from balloon_warp.kernels.water import add_face_load, force_of_load, water_level


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
    loads = lanes.water_loads[group]
    for lane in range(LANE_COUNT):
        world = world_of(state, group, lane)
        level = water_level(water, world)
        for particle in range(points.shape[0]):
            state.points[world, particle] = column(points[particle], lane)
            loads[particle] = wp.vec4()
        for face in range(faces.balloon.shape[0]):
            add_face_load(faces, state.points[world], face, level, bodies.up, loads)
        for particle in range(points.shape[0]):
            velocity = column(lanes.velocities[group, particle], lane)
            force = force_of_load(water, bodies, world, particle, loads[particle], velocity, step_seconds)
            for axis in range(3):
                lanes.water_forces[group, particle][axis, lane] = force[axis]

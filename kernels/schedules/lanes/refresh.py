"""The aims of normal forces, eight lanes at a time."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import LANE_COUNT, Lanes, Lanes3, of_lane
from balloon_warp.kernels.laws.inflation import FAR, aim_of, facing_of, nearer_area
from balloon_warp.kernels.loops.areas import face_measures
from balloon_warp.kernels.schedules.lanes.layouts import Layout, entry_at, near, of_item, put_item, total_in_lanes
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.traits import Traits


@cache
def refresh_function(traits: Traits, layout: Layout) -> Any:
    """The function that refreshes the aims of all particles."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    center_of_face, area_vector_of_face = face_measures(near)

    @wp.func
    def measure_faces(t: LaneTables, lanes: LaneState, group: wp.int32, points: Any):
        """Centers and area vectors of all faces, and the areas of the balloons."""
        centers = lanes.face_centers[group]
        area_vectors = lanes.face_area_vectors[group]
        for balloon in range(lanes.balloon_areas.shape[1]):
            lanes.balloon_areas[group, balloon] = Lanes()
        for face in range(t.faces.balloon.shape[0]):
            center = center_of_face(t.faces, points, face)
            area_vector = area_vector_of_face(t.faces, points, face, center)
            areas = lanes.balloon_areas[group, t.faces.balloon[face]]
            for lane in range(LANE_COUNT):
                areas[lane] += wp.length(of_lane(area_vector, lane))
            lanes.balloon_areas[group, t.faces.balloon[face]] = areas
            put_item(centers, face, center)
            put_item(area_vectors, face, area_vector)
        if wp.static(not layout.worlds):
            for balloon in range(lanes.balloon_areas.shape[1]):
                lanes.balloon_areas[group, balloon] = total_in_lanes(lanes.balloon_areas[group, balloon])

    @wp.func
    def aim_item(t: LaneTables, lanes: LaneState, group: wp.int32, item: wp.int32, point: Lanes3, areas: Lanes):
        """(A_p / A_total) n of an item, from the faces as they were measured."""
        normals = Lanes3()
        squared_distances = Lanes(FAR)
        nearest_areas = Lanes()
        for entry in range(t.faces.particle_offsets[item], t.faces.particle_offsets[item + 1]):
            face = entry_at(t.faces.around_particles, entry)
            center = near(lanes.face_centers[group], face)
            area_vector = near(lanes.face_area_vectors[group], face)
            for lane in range(LANE_COUNT):
                of_one = of_lane(area_vector, lane)
                normal = wp.normalize(of_one)
                nearest = nearer_area(
                    wp.vec2(squared_distances[lane], nearest_areas[lane]),
                    of_lane(point, lane),
                    of_lane(center, lane),
                    of_one,
                )
                squared_distances[lane] = nearest[0]
                nearest_areas[lane] = nearest[1]
                normals[0, lane] += normal[0]
                normals[1, lane] += normal[1]
                normals[2, lane] += normal[2]
        aims = Lanes3()
        for lane in range(LANE_COUNT):
            nearest = wp.vec2(squared_distances[lane], nearest_areas[lane])
            aim = aim_of(facing_of(of_lane(normals, lane), nearest), areas[lane])
            aims[0, lane] = aim[0]
            aims[1, lane] = aim[1]
            aims[2, lane] = aim[2]
        return aims

    @wp.func
    def refresh_aims(t: LaneTables, lanes: LaneState, group: wp.int32, points: Any):
        """Of all balloons."""
        measure_faces(t, lanes, group, points)
        for balloon in range(lanes.balloon_areas.shape[1]):
            areas = lanes.balloon_areas[group, balloon]
            for item in range(t.item_offsets[balloon], t.item_offsets[balloon + 1]):
                lanes.aims[group, item] = aim_item(t, lanes, group, item, of_item(points, item), areas)

    return refresh_aims

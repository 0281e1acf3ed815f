"""The aims of the inflation, eight faces and then eight particles side by side."""

import warp as wp

from balloon_warp.kernels.inflation import FAR, face_area_vector, face_center
from balloon_warp.kernels.lanes_inflation import aims_of_lanes, look_at_faces
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3, column
from balloon_warp.kernels.octets_state import OctetFaces, OctetState, fetch, store, whole_octet
from balloon_warp.kernels.tables import BodyTable


@wp.func
def measure_octet_faces(
    faces: OctetFaces,
    points: wp.array[wp.vec4],
    # out
    corner_points: wp.array[Lanes3],
    centers: wp.array[wp.vec4],
    area_vectors: wp.array[wp.vec4],
    balloon_areas: wp.array[Lanes],
):
    """Centers and area vectors of all faces, and the areas of the balloons, in each lane."""
    for balloon in range(balloon_areas.shape[0]):
        balloon_areas[balloon] = Lanes()
    for octet in range(faces.balloon.shape[0]):
        begin = faces.offsets[octet]
        count = faces.offsets[octet + 1] - begin
        for corner in range(count):
            corner_points[corner] = fetch(points, faces.corners[begin + corner])
        center = face_center(corner_points, 0, faces.counting, 0, count)
        area_vector = face_area_vector(corner_points, 0, faces.counting, 0, count, center)
        areas = balloon_areas[faces.balloon[octet]]
        for lane in range(LANE_COUNT):
            areas[lane] += wp.length(column(area_vector, lane))
        balloon_areas[faces.balloon[octet]] = areas
        store(centers, octet, center)
        store(area_vectors, octet, area_vector)
    for balloon in range(balloon_areas.shape[0]):
        balloon_areas[balloon] = Lanes(wp.dot(balloon_areas[balloon], Lanes(1.0)))


@wp.func
def aim_all_octets(
    bodies: BodyTable, faces: OctetFaces, octets: OctetState, world: wp.int32, points: wp.array[wp.vec4]
):
    """The aims of all particles at `points`."""
    centers = octets.face_centers[world]
    area_vectors = octets.face_area_vectors[world]
    measure_octet_faces(faces, points, octets.corner_points[world], centers, area_vectors, octets.balloon_areas[world])
    for octet in range(octets.velocities.shape[1]):
        point = fetch(points, whole_octet(octet))
        normals = Lanes3()
        squared_distances = Lanes(FAR)
        areas = Lanes()
        for slot in range(faces.around_offsets[octet], faces.around_offsets[octet + 1]):
            around = faces.around[slot]
            normals, squared_distances, areas = look_at_faces(
                point, fetch(centers, around), fetch(area_vectors, around), normals, squared_distances, areas
            )
        balloon_areas = Lanes()
        for lane in range(LANE_COUNT):
            particle = wp.min(LANE_COUNT * octet + lane, bodies.balloon.shape[0] - 1)
            balloon_areas[lane] = octets.balloon_areas[world, bodies.balloon[particle]][lane]
        octets.aims[world, octet] = aims_of_lanes(normals, squared_distances, areas, balloon_areas)

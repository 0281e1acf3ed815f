"""The aims of the inflation in eight worlds side by side."""

import warp as wp

from balloon_warp.kernels.inflation import FAR, aim_of, face_area_vector, face_center, nearer_area
from balloon_warp.kernels.lanes_state import LaneState
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3, column, set_column
from balloon_warp.kernels.tables import BodyTable, FaceTable


@wp.func
def measure_face_lanes(
    faces: FaceTable,
    points: wp.array[Lanes3],
    # out
    centers: wp.array[Lanes3],
    area_vectors: wp.array[Lanes3],
    balloon_areas: wp.array[Lanes],
):
    """Centers and area vectors of all faces, and the areas of the balloons."""
    for balloon in range(balloon_areas.shape[0]):
        balloon_areas[balloon] = Lanes()
    for face in range(faces.balloon.shape[0]):
        begin = faces.offsets[face]
        end = faces.offsets[face + 1]
        center = face_center(points, 0, faces.particles, begin, end)
        area_vector = face_area_vector(points, 0, faces.particles, begin, end, center)
        areas = balloon_areas[faces.balloon[face]]
        for lane in range(LANE_COUNT):
            areas[lane] += wp.length(column(area_vector, lane))
        balloon_areas[faces.balloon[face]] = areas
        centers[face] = center
        area_vectors[face] = area_vector


@wp.func
def look_at_faces(
    point: Lanes3, center: Lanes3, area_vector: Lanes3, normals: Lanes3, squared_distances: Lanes, areas: Lanes
):
    """The sums of unit normals around eight particles and their nearest faces so far, with one more face of each."""
    for lane in range(LANE_COUNT):
        normal = wp.normalize(column(area_vector, lane))
        nearest = nearer_area(
            wp.vec2(squared_distances[lane], areas[lane]),
            column(point, lane),
            column(center, lane),
            column(area_vector, lane),
        )
        squared_distances[lane] = nearest[0]
        areas[lane] = nearest[1]
        normals[0, lane] += normal[0]
        normals[1, lane] += normal[1]
        normals[2, lane] += normal[2]
    return normals, squared_distances, areas


@wp.func
def aims_of_lanes(normals: Lanes3, squared_distances: Lanes, areas: Lanes, balloon_areas: Lanes):
    """(A_p / A_total) n of eight particles."""
    aims = Lanes3()
    for lane in range(LANE_COUNT):
        nearest = wp.vec2(squared_distances[lane], areas[lane])
        aims = set_column(aims, lane, aim_of(column(normals, lane), nearest, balloon_areas[lane]))
    return aims


@wp.func
def aim_lanes(
    faces: FaceTable,
    particle: wp.int32,
    point: Lanes3,
    centers: wp.array[Lanes3],
    area_vectors: wp.array[Lanes3],
    balloon_area: Lanes,
):
    """(A_p / A_total) n of a particle in each world."""
    normals = Lanes3()
    squared_distances = Lanes(FAR)
    areas = Lanes()
    for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
        face = faces.around_particles[incidence]
        normals, squared_distances, areas = look_at_faces(
            point, centers[face], area_vectors[face], normals, squared_distances, areas
        )
    return aims_of_lanes(normals, squared_distances, areas, balloon_area)


@wp.func
def aim_all_lanes(faces: FaceTable, bodies: BodyTable, lanes: LaneState, group: wp.int32, points: wp.array[Lanes3]):
    """The aims of all particles at `points`."""
    centers = lanes.face_centers[group]
    area_vectors = lanes.face_area_vectors[group]
    measure_face_lanes(faces, points, centers, area_vectors, lanes.balloon_areas[group])
    for particle in range(points.shape[0]):
        balloon_area = lanes.balloon_areas[group, bodies.balloon[particle]]
        lanes.aims[group, particle] = aim_lanes(faces, particle, points[particle], centers, area_vectors, balloon_area)

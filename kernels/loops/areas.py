"""Area vectors of faces and particles, and directions of an inflation by normal forces.

Area vectors: of a face, and of a particle, which is the gradient of the balloon's volume by its place. With c a face's
center, A its area vector, n its corners, and b, d the corners before and after x, the gradient of 1/3 c . A by x is (A
/ n + 1/2 (d - b) x c) / 3. Around a closed fan of faces the d - b add up to zero, so that c may be taken from any
place, and from x float32 keeps its digits.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import cross_product, scaled
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3, entry_at, of_lane, set_lane
from balloon_warp.kernels.laws.outer import FAR, inflation_direction_of, nearer_area, vertex_normal_of
from balloon_warp.kernels.memory import fixed_int_at, in_tile, triple_at
from balloon_warp.kernels.tables import SLICE, FaceTable, FanTable, Tables, first_entry


@cache
def direction_loop(at: Any) -> Any:
    """Return the function for a particle's direction."""

    @wp.func
    def direction_of_particle(
        faces: FaceTable, centers: Any, area_vectors: Any, particle: wp.int32, point: wp.vec3, total_area: float
    ):
        """Return the direction (A_p / A_total) n of a particle."""
        normal = wp.vec3()
        nearest = wp.vec2(FAR, 0.0)
        for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
            face = faces.around_particles[incidence]
            area_vector = at(area_vectors, face)
            normal += wp.normalize(area_vector)
            nearest = nearer_area(nearest, point, at(centers, face), area_vector)
        return inflation_direction_of(vertex_normal_of(normal, nearest), total_area)

    return direction_of_particle


@cache
def direction_loop_of_eight(at: Any) -> Any:
    """Return the function for the directions of eight particles."""

    @wp.func
    def directions_of_eight(
        faces: Any, centers: Any, area_vectors: Any, eight: wp.int32, points: Lanes3, total_areas: Lanes
    ):
        """Return (A_p / A_total) n of each."""
        normals = Lanes3()
        squared_distances = Lanes(FAR)
        areas = Lanes()
        for incidence in range(faces.particle_offsets[eight], faces.particle_offsets[eight + 1]):
            face = entry_at(faces.around_particles, incidence)
            center = at(centers, face)
            area_vector = at(area_vectors, face)
            for lane in range(LANE_COUNT):
                of_one = of_lane(area_vector, lane)
                normal = wp.normalize(of_one)
                nearest = wp.vec2(squared_distances[lane], areas[lane])
                nearest = nearer_area(nearest, of_lane(points, lane), of_lane(center, lane), of_one)
                squared_distances[lane] = nearest[0]
                areas[lane] = nearest[1]
                normals[0, lane] += normal[0]
                normals[1, lane] += normal[1]
                normals[2, lane] += normal[2]
        inflation_directions = Lanes3()
        for lane in range(LANE_COUNT):
            nearest = wp.vec2(squared_distances[lane], areas[lane])
            inflation_directions = set_lane(
                inflation_directions,
                lane,
                inflation_direction_of(vertex_normal_of(of_lane(normals, lane), nearest), total_areas[lane]),
            )
        return inflation_directions

    return directions_of_eight


@wp.func
def add_quad_normal(normal: wp.vec3, nearest: wp.vec2, before: wp.vec3, across: wp.vec3, along: wp.vec3):
    """Add a quad to the sum of unit normals around a particle, and update its nearest face.

    The arguments are the vectors to the quad's other corners. Distances are four times as long, and areas twice as
    large as they are.
    """
    area_vector = cross_product(across, before - along)
    return normal + wp.normalize(area_vector), nearer_area(nearest, wp.vec3(), before + across + along, area_vector)


@wp.func
def normal_of_quads(normal: wp.vec3, nearest: wp.vec2):
    """Return A_p n, when all quads around a particle have been seen [m^2]."""
    return 0.5 * vertex_normal_of(normal, nearest)


@wp.func
def cross_at_quad_corner(before: Any, opposite: Any, after: Any):
    """Return a quad's contribution to the area vector of one of its corners [m^2], over `CROSSES`.

    The arguments are the vectors to the other corners [m].

    The formula above with c = (b + o + d) / 4 and A = 1/2 o x (b - d), where (d - b) x d = (d - b) x b.
    """
    return cross_product(after - before, before + opposite)


@wp.func
def plus_cross(v: wp.vec3, a: wp.vec3, b: wp.vec3):
    """Return v + a x b, in two instructions a component: each adds a product."""
    return wp.vec3(
        v[0] + a[1] * b[2] - a[2] * b[1],
        v[1] + a[2] * b[0] - a[0] * b[2],
        v[2] + a[0] * b[1] - a[1] * b[0],
    )


@wp.func
def plus_cross_at_quad_corner(crosses: wp.vec3, before: wp.vec3, opposite: wp.vec3, after: wp.vec3):
    """Return the sum of quads' cross products with one more, see `cross_at_quad_corner`."""
    return plus_cross(crosses, after - before, before + opposite)


@wp.func
def crosses_at_quad_corners(ab: wp.vec3, bc: wp.vec3, da: wp.vec3, ac: wp.vec3, bd: wp.vec3):
    """Return a quad's contributions to the area vectors of all four corners, over `CROSSES`, from edges and diagonals.

    It is faster than corner by corner, since the crosses of opposite corners' edges add up to that of the diagonals.
    """
    both = wp.cross(ac, bd)
    at_a = plus_cross(both, da, ab)
    at_b = plus_cross(both, ab, bc)
    return at_a, at_b, 3.0 * both - at_a, 3.0 * both - at_b


CROSSES = wp.constant(1.0 / 12.0)
"""Area vector over the sum of the crosses at the corners of quads"""


@wp.func
def area_vector_of_quad(before: Any, opposite: Any, after: Any):
    """Return the area vector of a quad, flat or not [m^2], from the vectors from one corner to the others [m]."""
    return scaled(cross_product(opposite, before - after), 0.5)


@wp.func
def area_vector_between(points: Any, corners: wp.vec4i):
    """Return a quad's contribution to the area vector of its first corner, whose points are in a tile."""
    point = in_tile(points, corners[0])
    return area_vector_of_quad(
        in_tile(points, corners[3]) - point, in_tile(points, corners[2]) - point, in_tile(points, corners[1]) - point
    )


@wp.func
def area_vector_of_corner(double_area: Any, chord: Any, arms: Any, corners: float):
    """Return a face's contribution to the area vector of one of its corners [m^2].

    Args:
        double_area: 2 A [m^2].
        chord: d - b [m].
        arms: Sum of the vectors from x to all corners, n (c - x) [m].
    """
    return scaled(double_area + cross_product(chord, arms), 0.5 / (3.0 * corners))


@cache
def area_loop(quads: bool, at: Any) -> Any:
    """Return the function that sums a particle's area vector over its faces, or those of eight particles."""

    @wp.func
    def area_vector_in_quads(fans: FanTable, points: Any, particle: wp.int32, point: Any):
        """Return the area vector of a particle whose faces are all quads [m^2]."""
        area_vector = scaled(point, 0.0)
        begin = first_entry(fans.slice_offsets, particle)
        for entry in range(begin, begin + SLICE * fans.counts[particle], SLICE):
            others = triple_at(fans.quads, entry)
            area_vector += cross_at_quad_corner(
                at(points, others[0]) - point, at(points, others[1]) - point, at(points, others[2]) - point
            )
        return scaled(area_vector, CROSSES)

    @wp.func
    def area_vector_in_faces(fans: Any, points: Any, particle: wp.int32, point: Any):
        """Return the area vector of a particle with faces of any number of corners [m^2]."""
        area_vector = scaled(point, 0.0)
        for corner in range(entry_at(fans.offsets, particle), entry_at(fans.offsets, particle + 1)):
            begin = entry_at(fans.begins, corner)
            end = entry_at(fans.begins, corner + 1)
            first = at(points, entry_at(fans.particles, begin)) - point
            arm = first
            arms = first
            double_area = scaled(point, 0.0)
            for other in range(begin + 1, end):
                next_arm = at(points, entry_at(fans.particles, other)) - point
                double_area += cross_product(arm, next_arm)
                arms += next_arm
                arm = next_arm
            area_vector += area_vector_of_corner(double_area, first - arm, arms, float(end - begin + 1))
        return area_vector

    return area_vector_in_quads if quads else area_vector_in_faces


@cache
def face_measures(at: Any) -> tuple[Any, Any]:
    """Return the functions that give a face's center and its area vector, or those of eight faces."""

    @wp.func
    def center_of_face(faces: Any, points: Any, face: wp.int32):
        """Return the mean of a face's corners [m]."""
        begin = entry_at(faces.offsets, face)
        end = entry_at(faces.offsets, face + 1)
        total = at(points, entry_at(faces.particles, begin))
        for corner in range(begin + 1, end):
            total = total + at(points, entry_at(faces.particles, corner))
        return total / float(end - begin)

    @wp.func
    def area_vector_of_face(faces: Any, points: Any, face: wp.int32, center: Any):
        """Return the area vector of a polygon, flat or not: half the sum of (a - c) x (b - c) over its edges a b."""
        begin = entry_at(faces.offsets, face)
        end = entry_at(faces.offsets, face + 1)
        arm = at(points, entry_at(faces.particles, begin)) - center
        total = cross_product(at(points, entry_at(faces.particles, end - 1)) - center, arm)
        for corner in range(begin + 1, end):
            next_arm = at(points, entry_at(faces.particles, corner)) - center
            total = total + cross_product(arm, next_arm)
            arm = next_arm
        return scaled(total, 0.5)

    return center_of_face, area_vector_of_face


@cache
def corner_area(at: Any) -> Any:
    """Return the function for a face's contribution to the area vector of one of its corners."""

    @wp.func
    def area_vector_at_corner(t: Tables, points: Any, face: wp.int32, corner: wp.int32, point: wp.vec3):
        """Return the contribution of a face [m^2].

        Args:
            corner: place among those of the face, from 0.
        """
        begin = t.faces.offsets[face]
        count = t.faces.offsets[face + 1] - begin
        first = at(points, t.faces.particles[begin + (corner + 1) % count]) - point
        arm = first
        arms = first
        double_area = wp.vec3()
        for further in range(2, count):
            next_arm = at(points, t.faces.particles[begin + (corner + further) % count]) - point
            double_area += wp.cross(arm, next_arm)
            arms += next_arm
            arm = next_arm
        return area_vector_of_corner(double_area, first - arm, arms, float(count))

    return area_vector_at_corner


@cache
def hole_loop(at: Any) -> Any:
    """Return the function that sums a particle's area vector over its torn faces alone."""
    area_vector_at_corner = corner_area(at)

    @wp.func
    def area_vector_of_holes(t: Any, points: Any, world: wp.int32, particle: wp.int32, point: wp.vec3):
        """Return the area vector of a particle's holes [m^2]."""
        area_vector = wp.vec3()
        gone = t.membranes.wear.tears.gone
        for place in range(t.faces.particle_offsets[particle], t.faces.particle_offsets[particle + 1]):
            face = t.faces.around_particles[place]
            if gone[world, face] == wp.int8(1):
                corner = wp.int32(0)
                for each in range(t.faces.offsets[face + 1] - t.faces.offsets[face]):
                    if t.faces.particles[t.faces.offsets[face] + each] == particle:
                        corner = each
                area_vector += area_vector_at_corner(t, points, face, corner, point)
        return area_vector

    return area_vector_of_holes


@wp.func
def volume_origin(t: Tables, balloon: wp.int32):
    """Return the particle of a balloon about which its volume is taken."""
    return fixed_int_at(t.faces.volume_origins, balloon)

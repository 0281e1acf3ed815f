"""Membranes face by face: each face is measured once, and its forces are stored for the threads of its corners."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.tension_field import how_surely_taut
from balloon_warp.kernels.loops.areas import CROSSES, crosses_at_quad_corners
from balloon_warp.kernels.loops.membrane_face_places import MembraneFaceLayout, membrane_face_places
from balloon_warp.kernels.loops.membranes import (
    pulls_on_corners,
    taut_tension_function,
    tension_function,
)
from balloon_warp.kernels.membrane_face_tables import MembraneFaceTable
from balloon_warp.kernels.memory import found_anew, four_floats_at, four_ints_at
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.tables import Tables

OF_TRIANGLE = wp.constant(1.0 / 6.0)
"""Area vector of a corner over the cross product of its edges, from the one before and to the one after"""


@wp.func
def rest_of(membrane_faces: MembraneFaceTable, face: wp.int32, corner: wp.int32):
    """Return the rest metric of the triangle at a corner of a face."""
    return four_floats_at(membrane_faces.rests, corner * membrane_faces.corners.shape[0] + face)


@wp.func
def is_there(corner: wp.int32, rest: wp.vec4):
    """Return whether a face has a triangle at a corner.

    Where some faces have four triangles and some one, a triangle that is absent has no area.
    """
    return corner == 0 or rest[3] > 0.0


@wp.func
def metric_at(corner: wp.int32, d11: wp.vec4, d12: wp.vec4):
    """Return the dot products of the two edges that begin at a corner, or their rates."""
    return wp.vec3(d11[corner], d12[corner], d11[(corner + 3) % 4])


class MembraneFaces(NamedTuple):
    """Hold the functions of faces, and of particles at their corners."""

    clear: Any
    """(t, pulls, area_vectors): the clearing as a frame begins"""
    stretch: Any
    """(t, world, membrane_face, points, velocities, pulls, area_vectors): a face"""
    read_places: Any
    """(t, own, active): a particle's first four places, which it may keep for a frame"""
    take: Any
    """(t, own, kept, pulls, area_vectors): the force on a particle [N], and its area vector [m^2], once all faces are
    measured"""


@cache
def tensions_of(features: Features, membrane_face: MembraneFaceLayout) -> Any:
    """Return the function for the tensions of a face's triangles."""
    tension, taut_tension = tension_function(features), taut_tension_function(features)
    triangles, mixed, viscous = membrane_face.triangles, membrane_face.mixed, features.viscous

    @wp.func
    def are_surely_taut(membrane_faces: MembraneFaceTable, face: wp.int32, d11: wp.vec4, d12: wp.vec4):
        """Return whether all triangles of a face are surely taut, so that `pulls_if_taut` suffices."""
        least = float(1.0)
        for corner in range(triangles):
            rest = rest_of(membrane_faces, face, corner)
            surely = how_surely_taut(metric_at(corner, d11, d12), rest)
            if wp.static(mixed):
                surely = wp.where(is_there(corner, rest), surely, 1.0)
            least = wp.min(least, surely)
        return least > 0.0

    @wp.func
    def what_is_left(t: Tables, world: wp.int32, face: wp.int32, corner: wp.int32, rest: wp.vec4, pulls: wp.vec3):
        """Return the tensions that are left of a triangle that is worn, or absent."""
        if wp.static(features.wears):
            pulls *= t.membranes.wear.left[world, t.membranes.membrane_faces.numbers[face][corner]]
        if wp.static(mixed):
            pulls = wp.where(is_there(corner, rest), pulls, wp.vec3())
        return pulls

    @wp.func
    def stretch_face(
        t: Tables, world: wp.int32, face: wp.int32, n: Any, d11: wp.vec4, d12: wp.vec4, r11: wp.vec4, r12: wp.vec4
    ):
        """Return the tensions of a face's triangles [N/m].

        Along the edges that begin at each corner, mixed, and along those that end there, as for the corner that they
        begin at.
        """
        membrane_faces = t.membranes.membrane_faces
        material = t.membranes.materials[membrane_faces.balloons[face]]
        along = wp.vec4()
        both = wp.vec4()
        back = wp.vec4()
        surely = bool(False)
        if wp.static(not viscous):
            surely = are_surely_taut(membrane_faces, face, d11, d12)
        if surely:
            for corner in range(triangles):
                rest = rest_of(membrane_faces, face, corner)
                pulls = taut_tension(metric_at(corner, d11, d12), rest, material, n, 0)
                pulls = what_is_left(t, world, face, corner, rest, pulls)
                along[corner] = pulls[0]
                both[corner] = pulls[1]
                back[(corner + 3) % 4] = pulls[2]
        else:
            for corner in range(triangles):
                rest = rest_of(membrane_faces, face, corner)
                metric = metric_at(corner, d11, d12)
                pulls = tension(metric, metric_at(corner, r11, r12), rest, material, n, 0)
                pulls = what_is_left(t, world, face, corner, rest, pulls)
                along[corner] = pulls[0]
                both[corner] = pulls[1]
                back[(corner + 3) % 4] = pulls[2]
        return along, both, back

    return stretch_face


@cache
def face_function(features: Features, membrane_face: MembraneFaceLayout) -> Any:
    """Return the function that measures a face."""
    step, put, _, point_at, velocity_at = membrane_face_places(membrane_face)
    stretch_face, triangles, areas, viscous = (
        tensions_of(features, membrane_face),
        membrane_face.triangles,
        membrane_face.areas,
        features.viscous,
    )

    @wp.func
    def measure_face(
        t: Tables, world: wp.int32, face: wp.int32, n: Any, points: Any, velocities: Any, pulls: Any, area_vectors: Any
    ):
        """Store the forces of a face on its corners, by one thread."""
        count = t.membranes.membrane_faces.corners.shape[0]
        corners = four_ints_at(t.membranes.membrane_faces.corners, face)
        a = point_at(points, corners[0])
        b = point_at(points, corners[1])
        c = point_at(points, corners[2])
        d = point_at(points, corners[3])
        ab = b - a
        bc = c - b
        cd = d - c
        da = a - d
        d11 = wp.vec4(wp.dot(ab, ab), wp.dot(bc, bc), wp.dot(cd, cd), wp.dot(da, da))
        d12 = -1.0 * wp.vec4(wp.dot(ab, da), wp.dot(bc, ab), wp.dot(cd, bc), wp.dot(da, cd))
        r11 = wp.vec4()
        r12 = wp.vec4()
        if wp.static(viscous):
            va = velocity_at(velocities, corners[0])
            vb = velocity_at(velocities, corners[1])
            vc = velocity_at(velocities, corners[2])
            vd = velocity_at(velocities, corners[3])
            vab = vb - va
            vbc = vc - vb
            vcd = vd - vc
            vda = va - vd
            r11 = 2.0 * wp.vec4(wp.dot(ab, vab), wp.dot(bc, vbc), wp.dot(cd, vcd), wp.dot(da, vda))
            r12 = -wp.vec4(
                wp.dot(ab, vda) + wp.dot(da, vab),
                wp.dot(bc, vab) + wp.dot(ab, vbc),
                wp.dot(cd, vbc) + wp.dot(bc, vcd),
                wp.dot(da, vcd) + wp.dot(cd, vda),
            )
        along, both, back = stretch_face(t, world, face, n, d11, d12, r11, r12)
        on_a, on_b, on_c, on_d = pulls_on_corners(ab, bc, cd, da, along, both, back)
        at_a = wp.vec3()
        at_b = wp.vec3()
        at_c = wp.vec3()
        at_d = wp.vec3()
        if wp.static(areas and triangles == 4):
            at_a, at_b, at_c, at_d = crosses_at_quad_corners(ab, bc, da, ab + bc, bc + cd)
        elif wp.static(areas):
            at_a = wp.cross(da, ab)
            at_b = at_a
            at_d = at_a
        put(pulls, area_vectors, step * face, on_a, at_a)
        put(pulls, area_vectors, step * (count + face), on_b, at_b)
        if wp.static(triangles == 4):
            put(pulls, area_vectors, step * (2 * count + face), on_c, at_c)
        put(pulls, area_vectors, step * (3 * count + face), on_d, at_d)

    return measure_face


@cache
def membrane_faces_of(features: Features, membrane_face: MembraneFaceLayout) -> MembraneFaces:
    """Return the functions of films for a layout that has them."""
    step, put, get, _, _ = membrane_face_places(membrane_face)
    measure_face, read_numbers = face_function(features, membrane_face), numbers_reader(features.columns)
    triangles, slots, room, fours = (
        membrane_face.triangles,
        membrane_face.slots,
        membrane_face.room,
        -(-membrane_face.slots // 4),
    )
    keeps_places = membrane_face.tile > 0 and fours == 1

    @wp.func
    def nothing(membrane_faces: MembraneFaceTable):
        """Return the place of an entry that is always zero."""
        if wp.static(room > 0):
            return wp.static(step * 4 * room)
        else:
            return step * 4 * membrane_faces.corners.shape[0]

    @wp.func
    def read_places(t: Tables, params: Any, active: bool):
        places = wp.vec4i()
        if wp.static(keeps_places):
            places = four_ints_at(t.membranes.membrane_faces.places, params.number)
            if not active:
                for slot in range(4):
                    places[slot] = nothing(t.membranes.membrane_faces)
        return places

    @wp.func
    def clear(t: Tables, pulls: Any, area_vectors: Any):
        """Clear the entries that particles with fewer faces than others read."""
        put(pulls, area_vectors, nothing(t.membranes.membrane_faces), wp.vec3(), wp.vec3())

    @wp.func
    def stretch(
        t: Tables, world: wp.int32, membrane_face: wp.int32, points: Any, velocities: Any, pulls: Any, area_vectors: Any
    ):
        n = read_numbers(t, world, t.membranes.membrane_faces.balloons[membrane_face])
        measure_face(t, world, membrane_face, n, points, velocities, pulls, area_vectors)

    @wp.func
    def take(t: Tables, params: Any, kept: wp.vec4i, pulls: Any, area_vectors: Any):
        """Sum the forces on a particle in the order of its faces."""
        first = kept
        if wp.static(keeps_places):
            for slot in range(4):
                first[slot] = found_anew(kept[slot])
        else:
            first = four_ints_at(t.membranes.membrane_faces.places, params.number)
        pull, area_vector = get(pulls, area_vectors, first[0])
        for slot in range(1, wp.static(min(slots, 4))):
            more, further = get(pulls, area_vectors, first[slot])
            pull += more
            area_vector += further
        count = t.particles.balloon.shape[0]
        for four in range(1, fours):
            places = four_ints_at(t.membranes.membrane_faces.places, four * count + params.number)
            for slot in range(4):
                more, further = get(pulls, area_vectors, places[slot])
                pull += more
                area_vector += further
        return pull, wp.static(CROSSES if triangles == 4 else OF_TRIANGLE) * area_vector

    return MembraneFaces(clear, stretch, read_places, take)

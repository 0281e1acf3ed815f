"""Membranes in a block: a thread measures a face once, and what that does to its corners waits there, in a place of its
own for each corner, for the threads that have the particles."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.film_tables import FilmTable
from balloon_warp.kernels.laws.tension_field import how_surely_taut
from balloon_warp.kernels.loops.areas import CROSSES, crosses_at_quad_corners
from balloon_warp.kernels.loops.membranes import (
    material_reader,
    pulls_on_corners,
    taut_tension_function,
    tension_function,
    wear_reader,
)
from balloon_warp.kernels.memory import found_anew, four_floats_at, four_ints_at
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.schedules.block.film_places import film_places
from balloon_warp.kernels.schedules.block.memory import Layout, Seat
from balloon_warp.kernels.schedules.block.pairs import pairs_of
from balloon_warp.kernels.schedules.block.quads import quads_of
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier

OF_TRIANGLE = wp.constant(1.0 / 6.0)
"""area vector of a corner over the cross of its edges, from the one before and to the one after"""


class Films(NamedTuple):
    """Functions of all threads of a block, and of one that has a particle."""

    held: Any
    """what a particle holds: its `springs`, and the `pull` and `area_vector` that faces have for it"""
    begin: Any
    """(t, seat, pulls, area_vectors): what a frame begins with; a barrier must follow"""
    stretch: Any
    """(t, seat, n, held, points, velocities, pulls, area_vectors): all faces, and a barrier; with the numbers of a
    balloon, if there is one alone, and what the thread's first particle holds"""
    take: Any
    """(t, seat, number, held, pulls, area_vectors): a particle's, once all faces are measured"""
    read: Any
    """(t, slots, own, place, active): what it holds at the start of a frame"""
    pull: Any
    """as of springs, with that of the faces"""
    area_vector: Any
    """as of a loop over faces; None if these have none"""


@cache
def films_of(traits: Traits, layout: Layout, springs_type: Any, read_springs: Any, pull_of_springs: Any) -> Films:
    """For a layout that has films, beside the springs of particles."""
    film = layout.film
    assert film is not None
    step, put, get, point_at, velocity_at = film_places(layout)
    quads = (pairs_of if film.pairs else quads_of)(traits, layout) if film.held else None
    quads_type = quads.held if quads else wp.int32
    tension, taut_tension = tension_function(traits), taut_tension_function(traits)
    material_of, left_of = material_reader(traits), wear_reader(traits)
    read_numbers = numbers_reader(traits.columns)
    triangles, mixed, slots, areas = film.triangles, film.mixed, film.slots, film.areas
    viscous, fours = traits.viscous, -(-slots // 4)
    keeps_places = layout.resident and fours == 1
    has_springs = not layout.resident or sum(layout.kind_slots) > 0

    @wp.struct
    class Held:
        """What a particle holds."""

        springs: springs_type
        quads: quads_type  # of a thread's first, where that keeps what it knows of some
        places: wp.vec4i  # of what its faces do to it, where it keeps them
        pull: wp.vec3
        area_vector: wp.vec3

    @wp.func
    def count_of(films: FilmTable):
        """Faces that there is room for; known ahead where kernels are made for so many."""
        if wp.static(layout.resident):
            return wp.static((layout.faces - 1) // 4)
        else:
            return films.corners.shape[0]

    @wp.func
    def nothing(films: FilmTable):
        """The place where that stands."""
        if wp.static(layout.resident):
            return wp.static(step * (layout.faces - 1))
        else:
            return step * 4 * films.corners.shape[0]

    @wp.func
    def read(t: Tables, slot_table: Any, own: Any, place: wp.int32, active: bool):
        held = Held()
        held.springs = read_springs(t, slot_table, own, place, active)
        if wp.static(quads is not None):
            held.quads = quads.hold(t, own.world, own.n, place)
        if wp.static(keeps_places):
            held.places = four_ints_at(t.membranes.films.places, own.number)
            if not active:
                for slot in range(4):
                    held.places[slot] = nothing(t.membranes.films)
        return held

    @wp.func
    def pull(
        t: Tables, points: Any, velocities: Any, own: Any, held: Held, point: wp.vec3, velocity: wp.vec3, time: float
    ):
        """Net force of springs and faces [N]."""
        if wp.static(has_springs):
            return pull_of_springs(t, points, velocities, own, held.springs, point, velocity, time) + held.pull
        else:
            return held.pull

    @wp.func
    def area_vector(t: Tables, points: Any, own: Any, held: Held, point: wp.vec3):
        """[m^2]"""
        return held.area_vector

    @wp.func
    def begin(t: Tables, seat: Seat, pulls: Any, area_vectors: Any):
        """Where a particle has fewer faces than others, it reads what is always zero."""
        if seat.thread == 0:
            put(pulls, area_vectors, nothing(t.membranes.films), wp.vec3(), wp.vec3())

    @wp.func
    def rest_of(films: FilmTable, face: wp.int32, corner: wp.int32):
        """Of the triangle at a corner of a face."""
        return four_floats_at(films.rests, corner * count_of(films) + face)

    @wp.func
    def is_there(corner: wp.int32, rest: wp.vec4):
        """Whether a face has a triangle at a corner: where some have four and some one, what is not there has no
        area."""
        return corner == 0 or rest[3] > 0.0

    @wp.func
    def metric_at(corner: wp.int32, d11: wp.vec4, d12: wp.vec4):
        """Products of the two edges that begin at a corner, or how they change."""
        return wp.vec3(d11[corner], d12[corner], d11[(corner + 3) % 4])

    @wp.func
    def are_surely_taut(films: FilmTable, face: wp.int32, d11: wp.vec4, d12: wp.vec4):
        """Whether all triangles of a face are, so that they need no more than `pulls_if_taut`."""
        least = float(1.0)
        for corner in range(triangles):
            rest = rest_of(films, face, corner)
            surely = how_surely_taut(metric_at(corner, d11, d12), rest)
            if wp.static(mixed):
                surely = wp.where(is_there(corner, rest), surely, 1.0)
            least = wp.min(least, surely)
        return least > 0.0

    @wp.func
    def what_is_left(t: Tables, world: wp.int32, face: wp.int32, corner: wp.int32, rest: wp.vec4, pulls: wp.vec3):
        """Of the tensions of a triangle that is worn, or that is none."""
        if wp.static(traits.wears):
            pulls *= left_of(t.membranes, world, t.membranes.films.numbers[face][corner])
        if wp.static(mixed):
            pulls = wp.where(is_there(corner, rest), pulls, wp.vec3())
        return pulls

    @wp.func
    def stretch_face(
        t: Tables, world: wp.int32, face: wp.int32, n: Any, d11: wp.vec4, d12: wp.vec4, r11: wp.vec4, r12: wp.vec4
    ):
        """The tensions of its triangles: along the edges that begin at each corner, mixed, and along those that end
        there, as of the corner that they begin at [N/m]."""
        films = t.membranes.films
        material = material_of(t.membranes, films.balloons[face])
        along = wp.vec4()
        both = wp.vec4()
        back = wp.vec4()
        surely = bool(False)
        if wp.static(not viscous):
            surely = are_surely_taut(films, face, d11, d12)
        if surely:
            for corner in range(triangles):
                rest = rest_of(films, face, corner)
                pulls = taut_tension(metric_at(corner, d11, d12), rest, material, n, 0)
                pulls = what_is_left(t, world, face, corner, rest, pulls)
                along[corner] = pulls[0]
                both[corner] = pulls[1]
                back[(corner + 3) % 4] = pulls[2]
        else:
            for corner in range(triangles):
                rest = rest_of(films, face, corner)
                metric = metric_at(corner, d11, d12)
                pulls = tension(metric, metric_at(corner, r11, r12), rest, material, n, 0)
                pulls = what_is_left(t, world, face, corner, rest, pulls)
                along[corner] = pulls[0]
                both[corner] = pulls[1]
                back[(corner + 3) % 4] = pulls[2]
        return along, both, back

    @wp.func
    def measure_face(
        t: Tables, world: wp.int32, face: wp.int32, n: Any, points: Any, velocities: Any, pulls: Any, area_vectors: Any
    ):
        """By one thread."""
        count = count_of(t.membranes.films)
        corners = four_ints_at(t.membranes.films.corners, face)
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

    @wp.func
    def stretch_all(t: Tables, seat: Seat, n: Any, points: Any, velocities: Any, pulls: Any, area_vectors: Any):
        for face in range(seat.thread, count_of(t.membranes.films), wp.block_dim()):
            if wp.static(traits.balloons == 1):
                measure_face(t, seat.world, face, n, points, velocities, pulls, area_vectors)
            else:
                numbers = read_numbers(t, seat.world, t.membranes.films.balloons[face])
                measure_face(t, seat.world, face, numbers, points, velocities, pulls, area_vectors)
        block_barrier()

    @wp.func
    def stretch(t: Tables, seat: Seat, n: Any, held: Held, points: Any, velocities: Any, pulls: Any, area_vectors: Any):
        if wp.static(quads is not None):
            quads.stretch(t, seat, n, held.quads, points, pulls, area_vectors)
        else:
            stretch_all(t, seat, n, points, velocities, pulls, area_vectors)

    @wp.func
    def take(t: Tables, seat: Seat, number: wp.int32, held: Held, pulls: Any, area_vectors: Any):
        """In the order of its faces."""
        first = held.places
        if wp.static(keeps_places):
            for slot in range(4):
                first[slot] = found_anew(held.places[slot])
        else:
            first = four_ints_at(t.membranes.films.places, number)
        pull, area_vector = get(pulls, area_vectors, first[0])
        for slot in range(1, wp.static(min(slots, 4))):
            more, further = get(pulls, area_vectors, first[slot])
            pull += more
            area_vector += further
        for four in range(1, fours):
            places = four_ints_at(t.membranes.films.places, four * seat.count + number)
            for slot in range(4):
                more, further = get(pulls, area_vectors, places[slot])
                pull += more
                area_vector += further
        held.pull = pull
        held.area_vector = wp.static(CROSSES if triangles == 4 else OF_TRIANGLE) * area_vector
        return held

    return Films(Held, begin, stretch, take, read, pull, area_vector if areas else None)

"""Quads of membranes in a block, one or two to a thread, which keeps all that is known of them at rest in its registers
for a frame."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.laws.tension_field import (
    products_at_angles,
    rest_of_shape,
    tautness,
    trace_and_det_of_shape,
)
from balloon_warp.kernels.loops.areas import crosses_at_quad_corners
from balloon_warp.kernels.loops.membranes import (
    material_reader,
    pulls_between_corners,
    taut_stiffness_function,
    tension_function,
)
from balloon_warp.kernels.memory import four_floats_at, four_ints_at
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.schedules.block_memory import Layout, Seat
from balloon_warp.kernels.schedules.film_places import film_places
from balloon_warp.kernels.schedules.warps import block_barrier
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits

PART = wp.constant(0.5)
"""of the thickness that each of a quad's four triangles has"""


class Quads(NamedTuple):
    """Functions of all threads of a block."""

    held: Any
    """what a thread holds"""
    hold: Any
    """(t, thread): that, as a frame begins"""
    stretch: Any
    """(t, seat, n, held, points, pulls, area_vectors): all of them, and a barrier; with the numbers of a balloon, if
    there is one alone"""


@cache
def quads_of(traits: Traits, layout: Layout) -> Quads:
    """For a layout whose membranes are quads that threads hold, and that hand out area vectors, too."""
    assert layout.film is not None
    threads, room = layout.threads, layout.film.held
    places = film_places(layout)
    put, point_at, step = places.put, places.point_at, places.step
    tension, taut_stiffness = tension_function(traits), taut_stiffness_function(traits)
    material_of, read_numbers = material_reader(traits), numbers_reader(traits.columns)

    @wp.struct
    class Quad:
        """A quad at rest."""

        corners: wp.vec4i  # where their points begin in a tile, in bytes
        balloon: wp.int32
        a: wp.vec4  # the triangle at each corner, see `rest_of_shape`
        b: wp.vec4
        c: wp.vec4
        d: wp.vec4

    @wp.struct
    class Held:
        """What a thread holds."""

        first: Quad
        second: Quad

    @wp.func
    def shape_of(t: Tables, corner: wp.int32, face: wp.int32):
        return four_floats_at(t.membranes.films.rests, corner * t.membranes.films.corners.shape[0] + face)

    @wp.func
    def read_quad(t: Tables, number: wp.int32):
        """Of a thread that has none the last again, for nobody."""
        face = wp.min(number, t.membranes.films.corners.shape[0] - 1)
        quad = Quad()
        quad.corners = four_ints_at(t.membranes.films.corners, face)
        if wp.static(traits.balloons > 1):
            quad.balloon = t.membranes.films.balloons[face]
        quad.a = shape_of(t, 0, face)
        quad.b = shape_of(t, 1, face)
        quad.c = shape_of(t, 2, face)
        quad.d = shape_of(t, 3, face)
        return quad

    @wp.func
    def hold(t: Tables, thread: wp.int32):
        held = Held()
        held.first = read_quad(t, thread)
        if wp.static(room > threads):
            held.second = read_quad(t, thread + threads)
        return held

    @wp.func
    def how_surely_taut(metric: wp.vec3, shape: wp.vec4):
        trace, det = trace_and_det_of_shape(metric, products_at_angles(metric), shape)
        return tautness(trace, det)

    @wp.func
    def stiffness_if_taut(metric: wp.vec3, shape: wp.vec4, material: wp.int32, n: Any):
        return taut_stiffness(metric, products_at_angles(metric), shape, PART, material, n)

    @wp.func
    def tension_of(metric: wp.vec3, shape: wp.vec4, material: wp.int32, n: Any):
        """Whatever its state."""
        return tension(metric, wp.vec3(), rest_of_shape(shape, PART), material, n, 0)

    @wp.func
    def along_edge(a: wp.vec2, shape_a: wp.vec4, metric_a: wp.vec3, b: wp.vec2, shape_b: wp.vec4, metric_b: wp.vec3):
        """What pulls along the edge that is the first of one triangle and the second of another [N/m]: product by
        product, each added by an instruction."""
        first = products_at_angles(metric_a)
        second = products_at_angles(metric_b)
        return a[0] * shape_a[0] + a[1] * first[0] + b[0] * shape_b[1] + b[1] * second[1]

    @wp.func
    def across_quad(a: wp.vec2, shape_a: wp.vec4, metric_a: wp.vec3, c: wp.vec2, shape_c: wp.vec4, metric_c: wp.vec3):
        """The same of the diagonal that is the third edge of both."""
        return a[0] * shape_a[2] + a[1] * metric_a[1] + c[0] * shape_c[2] + c[1] * metric_c[1]

    @wp.func
    def measure(t: Tables, seat: Seat, n: Any, quad: Quad, face: wp.int32, points: Any, pulls: Any, area_vectors: Any):
        """By one thread: what a quad does to its corners."""
        a = point_at(points, quad.corners[0])
        b = point_at(points, quad.corners[1])
        c = point_at(points, quad.corners[2])
        d = point_at(points, quad.corners[3])
        ab = b - a
        bc = c - b
        cd = d - c
        da = a - d
        ac = c - a
        bd = d - b
        squares = wp.vec4(wp.dot(ab, ab), wp.dot(bc, bc), wp.dot(cd, cd), wp.dot(da, da))
        at_a = wp.vec3(squares[0], -1.0 * wp.dot(ab, da), squares[3])
        at_b = wp.vec3(squares[1], -1.0 * wp.dot(bc, ab), squares[0])
        at_c = wp.vec3(squares[2], -1.0 * wp.dot(cd, bc), squares[1])
        at_d = wp.vec3(squares[3], -1.0 * wp.dot(da, cd), squares[2])
        material = material_of(t.membranes, quad.balloon)
        along = wp.vec4()
        across = wp.vec2()
        surely = wp.min(how_surely_taut(at_a, quad.a), how_surely_taut(at_b, quad.b))
        surely = wp.min(surely, how_surely_taut(at_c, quad.c))
        surely = wp.min(surely, how_surely_taut(at_d, quad.d))
        if surely > 0.0:
            of_a = stiffness_if_taut(at_a, quad.a, material, n)
            of_b = stiffness_if_taut(at_b, quad.b, material, n)
            of_c = stiffness_if_taut(at_c, quad.c, material, n)
            of_d = stiffness_if_taut(at_d, quad.d, material, n)
            along[0] = along_edge(of_a, quad.a, at_a, of_b, quad.b, at_b)
            along[1] = along_edge(of_b, quad.b, at_b, of_c, quad.c, at_c)
            along[2] = along_edge(of_c, quad.c, at_c, of_d, quad.d, at_d)
            along[3] = along_edge(of_d, quad.d, at_d, of_a, quad.a, at_a)
            across[0] = across_quad(of_b, quad.b, at_b, of_d, quad.d, at_d)
            across[1] = across_quad(of_a, quad.a, at_a, of_c, quad.c, at_c)
        else:
            a_pulls = tension_of(at_a, quad.a, material, n)
            b_pulls = tension_of(at_b, quad.b, material, n)
            c_pulls = tension_of(at_c, quad.c, material, n)
            d_pulls = tension_of(at_d, quad.d, material, n)
            along[0] = a_pulls[0] + a_pulls[1] + b_pulls[2] + b_pulls[1]
            along[1] = b_pulls[0] + b_pulls[1] + c_pulls[2] + c_pulls[1]
            along[2] = c_pulls[0] + c_pulls[1] + d_pulls[2] + d_pulls[1]
            along[3] = d_pulls[0] + d_pulls[1] + a_pulls[2] + a_pulls[1]
            across[0] = -1.0 * b_pulls[1] - d_pulls[1]
            across[1] = -1.0 * a_pulls[1] - c_pulls[1]
        on_a, on_b, on_c, on_d = pulls_between_corners(ab, bc, cd, da, ac, bd, along, across)
        area_a, area_b, area_c, area_d = crosses_at_quad_corners(ab, bc, da, ac, bd)
        put(pulls, area_vectors, step * face, on_a, area_a)
        put(pulls, area_vectors, step * (room + face), on_b, area_b)
        put(pulls, area_vectors, step * (2 * room + face), on_c, area_c)
        put(pulls, area_vectors, step * (3 * room + face), on_d, area_d)

    @wp.func
    def measure_numbered(
        t: Tables, seat: Seat, n: Any, quad: Quad, face: wp.int32, points: Any, pulls: Any, area_vectors: Any
    ):
        """The same with the numbers of the quad's balloon."""
        if wp.static(traits.balloons == 1):
            measure(t, seat, n, quad, face, points, pulls, area_vectors)
        else:
            numbers = read_numbers(t, seat.world, quad.balloon)
            measure(t, seat, numbers, quad, face, points, pulls, area_vectors)

    @wp.func
    def stretch(t: Tables, seat: Seat, n: Any, held: Held, points: Any, pulls: Any, area_vectors: Any):
        measure_numbered(t, seat, n, held.first, seat.thread, points, pulls, area_vectors)
        if wp.static(room > threads):
            measure_numbered(t, seat, n, held.second, seat.thread + threads, points, pulls, area_vectors)
        block_barrier()

    return Quads(Held, hold, stretch)

"""Quads of membranes in a block, one or two to a thread, which keeps all that is known of them at rest in its registers
for a frame."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.loops.areas import crosses_at_quad_corners
from balloon_warp.kernels.loops.membranes import material_reader, pulls_between_corners
from balloon_warp.kernels.loops.quad_tensions import quad_tensions
from balloon_warp.kernels.loops.quads import products_between
from balloon_warp.kernels.memory import four_ints_at
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.schedules.block.film_places import film_places
from balloon_warp.kernels.schedules.block.memory import Layout, Seat
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier


class Quads(NamedTuple):
    """Functions of all threads of a block."""

    held: Any
    """what a thread holds"""
    hold: Any
    """(t, world, n, thread): that, as a frame begins"""
    stretch: Any
    """(t, seat, n, held, points, pulls, area_vectors): all of them, and a barrier; with the numbers of a balloon, if
    there is one alone"""
    end_of: Any = None
    """of pairs, (points, held, c, has_c): where the second end of the edge that they share is"""
    stretch_ends: Any = None
    """of pairs, (t, seat, n, held, b, c, has_c, points, pulls, area_vectors): as `stretch`, and returns what a thread's
    pair does to its ends, see `block_ends`"""


@cache
def quads_of(traits: Traits, layout: Layout) -> Quads:
    """For a layout whose membranes are quads that threads hold, and that hand out area vectors, too."""
    assert layout.film is not None
    threads, room = layout.threads, layout.film.held
    places = film_places(layout)
    put, point_at, step = places.put, places.point_at, places.step
    tensions = quad_tensions(traits)
    material_of, read_numbers = material_reader(traits), numbers_reader(traits.columns)

    @wp.struct
    class Quad:
        """A quad at rest."""

        corners: wp.vec4i  # where their points begin in a tile, in bytes
        balloon: wp.int32
        rest: tensions.rest

    @wp.struct
    class Held:
        """What a thread holds."""

        first: Quad
        second: Quad

    @wp.func
    def known(t: Tables, number: wp.int32):
        """Of a thread that has none the last again, for nobody."""
        return wp.min(number, t.membranes.films.corners.shape[0] - 1)

    @wp.func
    def read_quad(t: Tables, world: wp.int32, n: Any, number: wp.int32):
        face = known(t, number)
        quad = Quad()
        quad.corners = four_ints_at(t.membranes.films.corners, face)
        if wp.static(traits.balloons > 1):
            quad.balloon = t.membranes.films.balloons[face]
            numbers = read_numbers(t, world, quad.balloon)
            quad.rest = tensions.read(t, face, material_of(t.membranes, quad.balloon), numbers)
        else:
            quad.rest = tensions.read(t, face, material_of(t.membranes, 0), n)
        return quad

    @wp.func
    def hold(t: Tables, world: wp.int32, n: Any, thread: wp.int32):
        held = Held()
        held.first = read_quad(t, world, n, thread)
        if wp.static(room > threads):
            held.second = read_quad(t, world, n, thread + threads)
        return held

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
        metrics = products_between(ab, bc, cd, da)
        material = material_of(t.membranes, quad.balloon)
        along, across = tensions.pulls(t, known(t, face), metrics, quad.rest, 0.0, material, n)
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

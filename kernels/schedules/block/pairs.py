"""Pairs of quads of membranes that stand side by side, one to a thread of a block, which keeps all that is known of
them at rest in its registers for a frame.

A thread reads six points instead of twice four, and writes six entries: what both do to the corners that they share is
one. So a particle of four quads reads three entries, if one of its edges is shared.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.membranes import material_reader
from balloon_warp.kernels.loops.quad_tensions import quad_tensions
from balloon_warp.kernels.loops.quads import (
    Sides,
    crosses_at_two_quads,
    products_between,
    pulls_on_two_quads,
    sides_between,
)
from balloon_warp.kernels.memory import four_ints_at
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.schedules.block.film_places import film_places
from balloon_warp.kernels.schedules.block.memory import Layout, Seat
from balloon_warp.kernels.schedules.block.quads import Quads
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier


@wp.struct
class Ends:
    """What a pair of quads does to the ends of the edge that these share: forces [N], and parts of area vectors, see
    `CROSSES`."""

    pull_b: wp.vec3
    pull_c: wp.vec3
    area_b: wp.vec3
    area_c: wp.vec3


@cache
def pairs_of(traits: Traits, layout: Layout) -> Quads:
    """For a layout whose membranes are such pairs."""
    room = layout.threads
    places = film_places(layout)
    put, point_at, step = places.put, places.point_at, places.step
    tensions = quad_tensions(traits)
    material_of, read_numbers = material_reader(traits), numbers_reader(traits.columns)

    @wp.struct
    class Pair:
        """Two quads at rest, abcd and befc."""

        corners: wp.vec4i  # a, b, c and d: where their points begin in a tile, in bytes
        others: wp.vec2i  # e and f
        balloon: wp.int32
        first: tensions.rest
        second: tensions.rest

    @wp.func
    def quads_of_thread(t: Tables, thread: wp.int32):
        """The numbers of both; of a thread that has none the last again, for nobody."""
        count = t.membranes.films.corners.shape[0] // 2
        first = wp.min(thread, count - 1)
        return first, first + count

    @wp.func
    def hold(t: Tables, world: wp.int32, n: Any, thread: wp.int32):
        films = t.membranes.films
        first, second = quads_of_thread(t, thread)
        pair = Pair()
        pair.corners = four_ints_at(films.corners, first)
        befc = four_ints_at(films.corners, second)
        pair.others = wp.vec2i(befc[1], befc[2])
        if wp.static(traits.balloons > 1):
            pair.balloon = films.balloons[first]
            numbers = read_numbers(t, world, pair.balloon)
            material = material_of(t.membranes, pair.balloon)
            pair.first = tensions.read(t, first, material, numbers)
            pair.second = tensions.read(t, second, material, numbers)
        else:
            pair.first = tensions.read(t, first, material_of(t.membranes, 0), n)
            pair.second = tensions.read(t, second, material_of(t.membranes, 0), n)
        return pair

    @wp.func
    def measure(t: Tables, thread: wp.int32, n: Any, pair: Pair, s: Sides):
        """By one thread: what both quads do to their corners."""
        one, other = quads_of_thread(t, thread)
        material = material_of(t.membranes, pair.balloon)
        metrics = products_between(s.ab, s.bc, s.cd, s.da)
        first, first_across = tensions.pulls(t, one, metrics, pair.first, 0.0, material, n)
        metrics_beside = products_between(s.be, s.ef, s.fc, -s.bc)
        second, second_across = tensions.pulls(t, other, metrics_beside, pair.second, first[1], material, n)
        return pulls_on_two_quads(s, first, first_across, second, second_across), crosses_at_two_quads(s)

    @wp.func
    def stretch_pair(t: Tables, thread: wp.int32, n: Any, pair: Pair, points: Any, pulls: Any, area_vectors: Any):
        s = sides_between(
            point_at(points, pair.corners[0]),
            point_at(points, pair.corners[1]),
            point_at(points, pair.corners[2]),
            point_at(points, pair.corners[3]),
            point_at(points, pair.others[0]),
            point_at(points, pair.others[1]),
        )
        on, at = measure(t, thread, n, pair, s)
        put(pulls, area_vectors, step * thread, on.a, at.a)
        put(pulls, area_vectors, step * (room + thread), on.b, at.b)
        put(pulls, area_vectors, step * (2 * room + thread), on.c, at.c)
        put(pulls, area_vectors, step * (3 * room + thread), on.d, at.d)
        put(pulls, area_vectors, step * (4 * room + thread), on.e, at.e)
        put(pulls, area_vectors, step * (5 * room + thread), on.f, at.f)

    @wp.func
    def stretch(t: Tables, seat: Seat, n: Any, held: Pair, points: Any, pulls: Any, area_vectors: Any):
        if wp.static(traits.balloons == 1):
            stretch_pair(t, seat.thread, n, held, points, pulls, area_vectors)
        else:
            numbers = read_numbers(t, seat.world, held.balloon)
            stretch_pair(t, seat.thread, numbers, held, points, pulls, area_vectors)
        block_barrier()

    @wp.func
    def end_of(points: Any, pair: Pair, c: wp.vec3, has_c: bool):
        """Where the second end is, which the thread may have."""
        if has_c:
            return c
        return point_at(points, pair.corners[2])

    @wp.func
    def stretch_ends(
        t: Tables,
        seat: Seat,
        n: Any,
        pair: Pair,
        b: wp.vec3,
        c: wp.vec3,
        has_c: bool,
        points: Any,
        pulls: Any,
        area_vectors: Any,
    ):
        """Of the one balloon of a world."""
        thread = seat.thread
        s = sides_between(
            point_at(points, pair.corners[0]),
            b,
            c,
            point_at(points, pair.corners[3]),
            point_at(points, pair.others[0]),
            point_at(points, pair.others[1]),
        )
        on, at = measure(t, thread, n, pair, s)
        put(pulls, area_vectors, step * thread, on.a, at.a)
        put(pulls, area_vectors, step * (room + thread), on.d, at.d)
        put(pulls, area_vectors, step * (2 * room + thread), on.e, at.e)
        put(pulls, area_vectors, step * (3 * room + thread), on.f, at.f)
        if not has_c:
            put(pulls, area_vectors, step * (4 * room + thread), on.c, at.c)
        block_barrier()
        ends = Ends()
        ends.pull_b = on.b
        ends.area_b = at.b
        ends.pull_c = on.c
        ends.area_c = at.c
        return ends

    return Quads(Pair, hold, stretch, end_of, stretch_ends)

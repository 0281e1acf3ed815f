"""Quads of membranes, one or two a thread, whose rest data stays in the thread's registers for a frame."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.areas import crosses_at_quad_corners
from balloon_warp.kernels.loops.membrane_face_places import MembraneFaceLayout, membrane_face_places
from balloon_warp.kernels.loops.membranes import pulls_between_corners
from balloon_warp.kernels.loops.quad_tensions import Sums, products_between, quad_tensions, sums_reader
from balloon_warp.kernels.memory import four_ints_at
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.tables import Tables


class Quads(NamedTuple):
    """Hold the functions of a thread that keeps quads."""

    hold: Any
    """(t, world, n, thread): its quads, kept as a frame begins"""
    stretch: Any
    """(t, world, thread, numbers, films, points, pulls, area_vectors): all of its quads; with the numbers of a
    balloon, if there is one alone"""


@cache
def quad_reader(features: Features) -> tuple[Any, Any]:
    """Return the type of a quad at rest, and the function that reads one."""
    read_sums, read_numbers = sums_reader(features), numbers_reader(features.columns)

    @wp.struct
    class Quad:
        """A quad at rest."""

        corners: wp.vec4i  # where their points begin in a tile, in bytes
        balloon: wp.int32
        rest: Sums

    @wp.func
    def read_quad(t: Tables, world: wp.int32, n: Any, number: wp.int32):
        face = wp.min(number, t.membranes.membrane_faces.corners.shape[0] - 1)
        quad = Quad()
        quad.corners = four_ints_at(t.membranes.membrane_faces.corners, face)
        if wp.static(features.balloons > 1):
            quad.balloon = t.membranes.membrane_faces.balloons[face]
            numbers = read_numbers(t, world, quad.balloon)
            quad.rest = read_sums(t, face, t.membranes.materials[quad.balloon], numbers)
        else:
            quad.rest = read_sums(t, face, t.membranes.materials[0], n)
        return quad

    return Quad, read_quad


@cache
def quad_measure(features: Features, membrane_face: MembraneFaceLayout) -> Any:
    """Return the function that measures a quad that a thread keeps."""
    Quad, _ = quad_reader(features)  # noqa: N806 - a type
    put, point_at, step = (getattr(membrane_face_places(membrane_face), name) for name in ("put", "point_at", "step"))
    pulls_of_quad, room = quad_tensions(features), membrane_face.room

    @wp.func
    def measure(t: Tables, n: Any, quad: Quad, face: wp.int32, points: Any, pulls: Any, area_vectors: Any):
        """Store the forces of a quad on its corners, by one thread."""
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
        material = t.membranes.materials[quad.balloon]
        along, across = pulls_of_quad(
            t, wp.min(face, t.membranes.membrane_faces.corners.shape[0] - 1), metrics, quad.rest, material, n
        )
        on_a, on_b, on_c, on_d = pulls_between_corners(ab, bc, cd, da, ac, bd, along, across)
        area_a, area_b, area_c, area_d = crosses_at_quad_corners(ab, bc, da, ac, bd)
        put(pulls, area_vectors, step * face, on_a, area_a)
        put(pulls, area_vectors, step * (room + face), on_b, area_b)
        put(pulls, area_vectors, step * (2 * room + face), on_c, area_c)
        put(pulls, area_vectors, step * (3 * room + face), on_d, area_d)

    return measure


@cache
def quads_of(features: Features, membrane_face: MembraneFaceLayout) -> Quads:
    """Return the functions of quads for a layout whose threads keep them, and store area vectors, too."""
    quads, threads = membrane_face.quads, membrane_face.room // membrane_face.quads
    Quad, read_quad = quad_reader(features)  # noqa: N806 - a type
    measure, read_numbers = quad_measure(features, membrane_face), numbers_reader(features.columns)

    @wp.struct
    class Held:
        """Rest data of quads that a thread keeps."""

        first: Quad
        second: Quad

    @wp.func
    def hold(t: Tables, world: wp.int32, n: Any, thread: wp.int32):
        held = Held()
        held.first = read_quad(t, world, n, thread)
        if wp.static(quads > 1):
            held.second = read_quad(t, world, n, thread + threads)
        return held

    @wp.func
    def measure_numbered(
        t: Tables, world: wp.int32, n: Any, quad: Quad, face: wp.int32, points: Any, pulls: Any, area_vectors: Any
    ):
        """Store the forces of a quad on its corners, with the numbers of its balloon."""
        if wp.static(features.balloons == 1):
            measure(t, n, quad, face, points, pulls, area_vectors)
        else:
            numbers = read_numbers(t, world, quad.balloon)
            measure(t, numbers, quad, face, points, pulls, area_vectors)

    @wp.func
    def stretch(
        t: Tables,
        world: wp.int32,
        thread: wp.int32,
        numbers: Any,
        membrane_faces: Held,
        points: Any,
        pulls: Any,
        area_vectors: Any,
    ):
        measure_numbered(t, world, numbers, membrane_faces.first, thread, points, pulls, area_vectors)
        if wp.static(quads > 1):
            measure_numbered(t, world, numbers, membrane_faces.second, thread + threads, points, pulls, area_vectors)

    return Quads(hold, stretch)

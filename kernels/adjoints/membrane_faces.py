"""Adjoint of membranes whose faces are measured once: each face derives its triangles, and leaves bars at corners."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.adjoints.membranes import is_at_rest, triangle_work
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.membrane_face_places import MembraneFaceLayout, membrane_face_places
from balloon_warp.kernels.loops.membrane_faces import is_there, membrane_faces_of, rest_of
from balloon_warp.kernels.memory import four_ints_at
from balloon_warp.kernels.tables import Tables


@cache
def membrane_faces_adjoint(features: Features, membrane_face: MembraneFaceLayout, keeps: bool) -> Adjoint:
    """Return the adjoint that gathers the bar of a particle's place from its faces.

    Args:
        keeps: whether a thread keeps the places where its particle's faces leave their bars.
    """
    take = membrane_faces_of(features, membrane_face).take

    @wp.func
    def kept_adjoint(t: Tables, params: Any, kept: Any, pulls: Any, area_vectors: Any, force_bars: Any):
        point_bar, _area = take(t, params, kept.places, pulls, area_vectors)
        return point_bar

    @wp.func
    def faces_adjoint(t: Tables, params: Any, pulls: Any, area_vectors: Any, force_bars: Any):
        point_bar, _area = take(t, params, wp.vec4i(), pulls, area_vectors)
        return point_bar

    return Adjoint(kept_adjoint if keeps else faces_adjoint, ("point",), _of_face(features, membrane_face))


def _of_face(features: Features, membrane_face: MembraneFaceLayout) -> Any:
    """Return the function that derives a face."""
    work_of_triangle = triangle_work(features)
    step, put, _, point_at, _ = membrane_face_places(membrane_face)
    triangles, mixed = membrane_face.triangles, membrane_face.mixed

    @wp.func
    def at_corner(
        t: Tables, face: wp.int32, corner: wp.int32, n: Any, d1: wp.vec3, d2: wp.vec3, b1: wp.vec3, b2: wp.vec3
    ):
        """Return the bars of both edges of the triangle at a corner, and of the numbers."""
        rest = rest_of(t.membranes.membrane_faces, face, corner)
        material = t.membranes.materials[t.membranes.membrane_faces.balloons[face]]
        there = not is_at_rest(d1, d2, rest)
        if wp.static(mixed):
            there = there and is_there(corner, rest)
        first = wp.vec3()
        second = wp.vec3()
        numbers = 0.0 * n
        if there:
            by_d1, by_d2, _v1, _v2, by_n, _rest, _material, _b1, _b2 = wp.grad(work_of_triangle)(
                d1, d2, wp.vec3(), wp.vec3(), n, rest, material, b1, b2
            )
            first = by_d1
            second = by_d2
            numbers = by_n
        return first, second, numbers

    @wp.func
    def turn_face(
        t: Tables, membrane_face: wp.int32, n: Any, points: Any, force_bars: Any, pulls: Any, area_vectors: Any
    ):
        count = t.membranes.membrane_faces.corners.shape[0]
        corners = four_ints_at(t.membranes.membrane_faces.corners, membrane_face)
        a = point_at(points, corners[0])
        b = point_at(points, corners[1])
        d = point_at(points, corners[3])
        of_a = point_at(force_bars, corners[0])
        of_b = point_at(force_bars, corners[1])
        of_d = point_at(force_bars, corners[3])
        by_ab, by_ad, numbers = at_corner(t, membrane_face, 0, n, b - a, d - a, of_b - of_a, of_d - of_a)
        on_a = -(by_ab + by_ad)
        on_b = by_ab
        on_d = by_ad
        if wp.static(triangles == 4):
            c = point_at(points, corners[2])
            of_c = point_at(force_bars, corners[2])
            by_bc, by_ba, of_second = at_corner(t, membrane_face, 1, n, c - b, a - b, of_c - of_b, of_a - of_b)
            by_cd, by_cb, of_third = at_corner(t, membrane_face, 2, n, d - c, b - c, of_d - of_c, of_b - of_c)
            by_da, by_dc, of_last = at_corner(t, membrane_face, 3, n, a - d, c - d, of_a - of_d, of_c - of_d)
            numbers = numbers + of_second + of_third + of_last
            on_a += by_ba + by_da
            on_b += by_cb - (by_bc + by_ba)
            on_d += by_cd - (by_da + by_dc)
            on_c = by_bc + by_dc - (by_cd + by_cb)
            put(pulls, area_vectors, step * (2 * count + membrane_face), on_c, wp.vec3())
        put(pulls, area_vectors, step * membrane_face, on_a, wp.vec3())
        put(pulls, area_vectors, step * (count + membrane_face), on_b, wp.vec3())
        put(pulls, area_vectors, step * (3 * count + membrane_face), on_d, wp.vec3())
        return numbers

    return turn_face

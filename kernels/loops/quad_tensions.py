"""Tensions of a membrane quad along edges and diagonals, from the rest data of its four triangles."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.laws.tension_field import (
    products_at_angles,
    rest_of_shape,
    tautness,
    trace_and_det_of_shape,
)
from balloon_warp.kernels.loops.membranes import skin_function, taut_stiffness_function, tension_function
from balloon_warp.kernels.loops.quads import Metrics
from balloon_warp.kernels.memory import four_floats_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits

PART = wp.constant(0.5)
"""Fraction of the thickness that each of a quad's four triangles has"""


class QuadTensions(NamedTuple):
    """Functions for the tensions of quads."""

    rest: Any
    """Type of the rest data that a thread keeps of a quad"""
    read: Any
    """(t, face, material, n): that, which holds as long as the balloon's numbers do"""
    pulls: Any
    """(t, face, metrics, rest, before, material, n): what edges pull with and what both diagonals do, over their
    vectors [N/m]; `before` is added to that of the last edge"""


@wp.struct
class Shapes:
    """Rest shapes of the triangles at each corner of a quad, see `rest_of_shape`."""

    a: wp.vec4
    b: wp.vec4
    c: wp.vec4
    d: wp.vec4


@wp.func
def shape_of(t: Tables, corner: wp.int32, face: wp.int32):
    """Return the rest shape of one of a quad's triangles."""
    return four_floats_at(t.membranes.films.rests, corner * t.membranes.films.corners.shape[0] + face)


@wp.func
def shapes_of(t: Tables, face: wp.int32):
    """Return the rest shapes of a quad."""
    shapes = Shapes()
    shapes.a = shape_of(t, 0, face)
    shapes.b = shape_of(t, 1, face)
    shapes.c = shape_of(t, 2, face)
    shapes.d = shape_of(t, 3, face)
    return shapes


@wp.struct
class Sums:
    """Rest sums of a quad whose law is `Law.linear`, with the k that its tensions are proportional to [N/m]."""

    along: wp.vec4
    """Sum of the opposite cotangents of each edge, times k"""
    across: wp.vec2
    """Sum of the opposite cotangents of both diagonals, times k"""
    roots: wp.vec4
    """Root of k / s^3 of each triangle, s the last number of its shape: its square over det M, times each opposite
    product, is subtracted from an edge's tension"""
    steep: wp.vec2
    """Largest contribution of two opposite squared edges to a triangle's trace, over its shape's last number and k"""


def quad_tensions(traits: Traits) -> QuadTensions:
    """Return the tensions of quads for the laws of a scene."""
    linear = all(law.linear for law in traits.membranes)
    return tensions_by_sums(traits) if linear else tensions_by_shapes(traits)


@cache
def tensions_whatever(traits: Traits) -> Any:
    """Return the function of metrics, shapes, the sum so far, material and numbers, for any state of a quad."""
    tension = tension_function(traits)

    @wp.func
    def tension_of(metric: wp.vec3, shape: wp.vec4, material: wp.int32, n: Any):
        return tension(metric, wp.vec3(), rest_of_shape(shape, PART), material, n, 0)

    @wp.func
    def pulls_whatever(metrics: Metrics, shapes: Shapes, before: float, material: wp.int32, n: Any):
        a = tension_of(metrics.a, shapes.a, material, n)
        b = tension_of(metrics.b, shapes.b, material, n)
        c = tension_of(metrics.c, shapes.c, material, n)
        d = tension_of(metrics.d, shapes.d, material, n)
        along = wp.vec4(
            a[0] + a[1] + b[2] + b[1],
            b[0] + b[1] + c[2] + c[1],
            c[0] + c[1] + d[2] + d[1],
            before + d[0] + d[1] + a[2] + a[1],
        )
        return along, wp.vec2(-1.0 * b[1] - d[1], -1.0 * a[1] - c[1])

    return pulls_whatever


@cache
def tensions_by_shapes(traits: Traits) -> QuadTensions:
    """Return the tensions of quads for any laws."""
    taut_stiffness, pulls_whatever = taut_stiffness_function(traits), tensions_whatever(traits)

    @wp.func
    def read(t: Tables, face: wp.int32, material: wp.int32, n: Any):
        return shapes_of(t, face)

    @wp.func
    def how_surely(metric: wp.vec3, shape: wp.vec4):
        trace, det = trace_and_det_of_shape(metric, products_at_angles(metric), shape)
        return tautness(trace, det)

    @wp.func
    def how_surely_taut(metrics: Metrics, shapes: Shapes):
        surely = wp.min(how_surely(metrics.a, shapes.a), how_surely(metrics.b, shapes.b))
        surely = wp.min(surely, how_surely(metrics.c, shapes.c))
        return wp.min(surely, how_surely(metrics.d, shapes.d))

    @wp.func
    def stiffness_if_taut(metric: wp.vec3, shape: wp.vec4, material: wp.int32, n: Any):
        return taut_stiffness(metric, products_at_angles(metric), shape, PART, material, n)

    @wp.func
    def along_edge(
        before: float, a: wp.vec2, shape_a: wp.vec4, metric_a: wp.vec3, b: wp.vec2, shape_b: wp.vec4, metric_b: wp.vec3
    ):
        """Return the tension along the edge that is the first of one triangle and the second of another [N/m].

        It is added to `before`, product by product, each with one instruction.
        """
        first = products_at_angles(metric_a)
        second = products_at_angles(metric_b)
        return before + a[0] * shape_a[0] + a[1] * first[0] + b[0] * shape_b[1] + b[1] * second[1]

    @wp.func
    def across_quad(a: wp.vec2, shape_a: wp.vec4, metric_a: wp.vec3, c: wp.vec2, shape_c: wp.vec4, metric_c: wp.vec3):
        """Return the tension along the diagonal that is the third edge of both triangles [N/m]."""
        return a[0] * shape_a[2] + a[1] * metric_a[1] + c[0] * shape_c[2] + c[1] * metric_c[1]

    @wp.func
    def if_taut(metrics: Metrics, shapes: Shapes, before: float, material: wp.int32, n: Any):
        a = stiffness_if_taut(metrics.a, shapes.a, material, n)
        b = stiffness_if_taut(metrics.b, shapes.b, material, n)
        c = stiffness_if_taut(metrics.c, shapes.c, material, n)
        d = stiffness_if_taut(metrics.d, shapes.d, material, n)
        along = wp.vec4(
            along_edge(0.0, a, shapes.a, metrics.a, b, shapes.b, metrics.b),
            along_edge(0.0, b, shapes.b, metrics.b, c, shapes.c, metrics.c),
            along_edge(0.0, c, shapes.c, metrics.c, d, shapes.d, metrics.d),
            along_edge(before, d, shapes.d, metrics.d, a, shapes.a, metrics.a),
        )
        across = wp.vec2(
            across_quad(b, shapes.b, metrics.b, d, shapes.d, metrics.d),
            across_quad(a, shapes.a, metrics.a, c, shapes.c, metrics.c),
        )
        return along, across

    @wp.func
    def pulls(t: Tables, face: wp.int32, metrics: Metrics, rest: Shapes, before: float, material: wp.int32, n: Any):
        if how_surely_taut(metrics, rest) > 0.0:
            return if_taut(metrics, rest, before, material, n)
        return pulls_whatever(metrics, rest, before, material, n)

    return QuadTensions(Shapes, read, pulls)


@cache
def tensions_by_sums(traits: Traits) -> QuadTensions:
    """Return the tensions of quads for laws that are `Law.linear`.

    The constant parts of a taut quad are precomputed.
    """
    skin_of, pulls_whatever = skin_function(traits), tensions_whatever(traits)

    @wp.func
    def read(t: Tables, face: wp.int32, material: wp.int32, n: Any):
        count = t.membranes.films.corners.shape[0]
        k = skin_of(PART, material, n)
        last = four_floats_at(t.membranes.films.sums, 2 * count + face)
        sums = Sums()
        sums.along = k * four_floats_at(t.membranes.films.sums, face)
        sums.roots = wp.sqrt(k) * four_floats_at(t.membranes.films.sums, count + face)
        sums.across = k * wp.vec2(last[0], last[1])
        sums.steep = wp.vec2(last[2], last[3]) / k
        return sums

    @wp.func
    def taken(metric: wp.vec3, root: float):
        """Return the part that is subtracted for each product at an angle [N/m^3]."""
        each = root / (metric[0] * metric[2] - metric[1] * metric[1])
        return each * each

    @wp.func
    def pulls(t: Tables, face: wp.int32, metrics: Metrics, rest: Sums, before: float, material: wp.int32, n: Any):
        a = taken(metrics.a, rest.roots[0])
        b = taken(metrics.b, rest.roots[1])
        c = taken(metrics.c, rest.roots[2])
        d = taken(metrics.d, rest.roots[3])
        trace = rest.steep[0] * wp.max(metrics.a[0], metrics.c[0])
        trace += rest.steep[1] * wp.max(metrics.b[0], metrics.d[0])
        if wp.max(wp.max(a, b), wp.max(c, d)) * trace < 1.0:  # see `tautness`
            at_a = products_at_angles(metrics.a)
            at_b = products_at_angles(metrics.b)
            at_c = products_at_angles(metrics.c)
            at_d = products_at_angles(metrics.d)
            along = wp.vec4(
                rest.along[0] - a * at_a[0] - b * at_b[1],
                rest.along[1] - b * at_b[0] - c * at_c[1],
                rest.along[2] - c * at_c[0] - d * at_d[1],
                before + rest.along[3] - d * at_d[0] - a * at_a[1],
            )
            return along, wp.vec2(
                rest.across[0] - b * at_b[2] - d * at_d[2], rest.across[1] - a * at_a[2] - c * at_c[2]
            )
        return pulls_whatever(metrics, shapes_of(t, face), before, material, n)

    return QuadTensions(Sums, read, pulls)

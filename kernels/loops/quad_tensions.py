"""Tensions of a membrane quad along edges and diagonals, from the sums of its four triangles at rest.

For laws that are `Law.linear`: the constant parts of a taut quad are computed once.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import choice_of_laws
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.tension_field import products_at_angles
from balloon_warp.kernels.loops.membranes import tension_function
from balloon_warp.kernels.memory import four_floats_at
from balloon_warp.kernels.tables import Tables

PART = wp.constant(0.5)
"""Fraction of the thickness that each of a quad's four triangles has"""


@wp.struct
class Metrics:
    """Products of the two edges that begin at each corner of a quad, see `products_between`."""

    a: wp.vec3
    b: wp.vec3
    c: wp.vec3
    d: wp.vec3


@wp.func
def products_between(ab: wp.vec3, bc: wp.vec3, cd: wp.vec3, da: wp.vec3):
    """Return the dot products of a quad's edges [m^2].

    At each corner: of the triangle's first edge with itself, with its second, and of the second with itself.
    """
    squares = wp.vec4(wp.dot(ab, ab), wp.dot(bc, bc), wp.dot(cd, cd), wp.dot(da, da))
    metrics = Metrics()
    metrics.a = wp.vec3(squares[0], -1.0 * wp.dot(ab, da), squares[3])
    metrics.b = wp.vec3(squares[1], -1.0 * wp.dot(bc, ab), squares[0])
    metrics.c = wp.vec3(squares[2], -1.0 * wp.dot(cd, bc), squares[1])
    metrics.d = wp.vec3(squares[3], -1.0 * wp.dot(da, cd), squares[2])
    return metrics


@wp.struct
class Sums:
    """Rest sums of a quad, with the k that its tensions are proportional to [N/m]."""

    along: wp.vec4
    """Sum of the opposite cotangents of each edge, times k"""
    across: wp.vec2
    """Sum of the opposite cotangents of both diagonals, times k"""
    roots: wp.vec4
    """Root of k / s^3 of each triangle, s the last number of its shape: its square over det M, times each opposite
    product, is subtracted from an edge's tension"""
    steep: wp.vec2
    """Largest contribution of two opposite squared edges to a triangle's trace, over its shape's last number and k"""


@cache
def sums_reader(features: Features) -> Any:
    """Return the function that reads the rest sums of a quad, which hold as long as the balloon's numbers do."""
    slopes_of_law, thickness = (
        choice_of_laws(features.membranes, features.columns),
        features.columns.places["thickness"],
    )

    @wp.func
    def read_sums(t: Tables, face: wp.int32, material: wp.int32, n: Any):
        count = t.membranes.membrane_faces.corners.shape[0]
        by_trace, _by_det = slopes_of_law(2.0, 1.0, 0.0, material, n, 0)
        k = PART * n[thickness] * by_trace
        last = four_floats_at(t.membranes.membrane_faces.sums, 2 * count + face)
        sums = Sums()
        sums.along = k * four_floats_at(t.membranes.membrane_faces.sums, face)
        sums.roots = wp.sqrt(k) * four_floats_at(t.membranes.membrane_faces.sums, count + face)
        sums.across = k * wp.vec2(last[0], last[1])
        sums.steep = wp.vec2(last[2], last[3]) / k
        return sums

    return read_sums


@cache
def tensions_whatever(features: Features) -> Any:
    """Return the function for the tensions of a quad in any state."""
    tension = tension_function(features)

    @wp.func
    def tension_at(t: Tables, face: wp.int32, corner: wp.int32, metric: wp.vec3, material: wp.int32, n: Any):
        rest = four_floats_at(
            t.membranes.membrane_faces.rests, corner * t.membranes.membrane_faces.corners.shape[0] + face
        )
        return tension(metric, wp.vec3(), rest, material, n, 0)

    @wp.func
    def pulls_whatever(t: Tables, face: wp.int32, metrics: Metrics, material: wp.int32, n: Any):
        a = tension_at(t, face, 0, metrics.a, material, n)
        b = tension_at(t, face, 1, metrics.b, material, n)
        c = tension_at(t, face, 2, metrics.c, material, n)
        d = tension_at(t, face, 3, metrics.d, material, n)
        along = wp.vec4(
            a[0] + a[1] + b[2] + b[1],
            b[0] + b[1] + c[2] + c[1],
            c[0] + c[1] + d[2] + d[1],
            d[0] + d[1] + a[2] + a[1],
        )
        return along, wp.vec2(-1.0 * b[1] - d[1], -1.0 * a[1] - c[1])

    return pulls_whatever


@wp.func
def taken(metric: wp.vec3, root: float):
    """Return the part that is subtracted for each product at an angle [N/m^3]."""
    each = root / (metric[0] * metric[2] - metric[1] * metric[1])
    return each * each


@cache
def quad_tensions(features: Features) -> Any:
    """Return the function for the pulls of edges and of both diagonals, over their vectors [N/m]."""
    pulls_whatever = tensions_whatever(features)

    @wp.func
    def pulls(t: Tables, face: wp.int32, metrics: Metrics, rest: Sums, material: wp.int32, n: Any):
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
                rest.along[3] - d * at_d[0] - a * at_a[1],
            )
            return along, wp.vec2(
                rest.across[0] - b * at_b[2] - d * at_d[2], rest.across[1] - a * at_a[2] - c * at_c[2]
            )
        return pulls_whatever(t, face, metrics, material, n)

    return pulls

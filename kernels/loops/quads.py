"""Quads of membranes, alone and two side by side: their edges and diagonals, and what these do to their corners."""

import warp as wp

from balloon_warp.kernels.loops.areas import plus_cross


@wp.struct
class Metrics:
    """Products of the two edges that begin at each corner of a quad, see `products_between`."""

    a: wp.vec3
    b: wp.vec3
    c: wp.vec3
    d: wp.vec3


@wp.func
def products_between(ab: wp.vec3, bc: wp.vec3, cd: wp.vec3, da: wp.vec3):
    """Of a quad's edges [m^2]: of the first edge of the triangle at each corner with itself, with its second, and of
    that."""
    squares = wp.vec4(wp.dot(ab, ab), wp.dot(bc, bc), wp.dot(cd, cd), wp.dot(da, da))
    metrics = Metrics()
    metrics.a = wp.vec3(squares[0], -1.0 * wp.dot(ab, da), squares[3])
    metrics.b = wp.vec3(squares[1], -1.0 * wp.dot(bc, ab), squares[0])
    metrics.c = wp.vec3(squares[2], -1.0 * wp.dot(cd, bc), squares[1])
    metrics.d = wp.vec3(squares[3], -1.0 * wp.dot(da, cd), squares[2])
    return metrics


@wp.struct
class Six:
    """A vector at each corner of two quads abcd and befc."""

    a: wp.vec3
    b: wp.vec3
    c: wp.vec3
    d: wp.vec3
    e: wp.vec3
    f: wp.vec3


@wp.struct
class Sides:
    """Edges and diagonals of two quads abcd and befc [m]."""

    ab: wp.vec3
    bc: wp.vec3
    cd: wp.vec3
    da: wp.vec3
    ac: wp.vec3
    bd: wp.vec3
    be: wp.vec3
    ef: wp.vec3
    fc: wp.vec3
    bf: wp.vec3
    ec: wp.vec3


@wp.func
def sides_between(a: wp.vec3, b: wp.vec3, c: wp.vec3, d: wp.vec3, e: wp.vec3, f: wp.vec3):
    """Of the points at their corners [m]."""
    sides = Sides()
    sides.ab = b - a
    sides.bc = c - b
    sides.cd = d - c
    sides.da = a - d
    sides.ac = c - a
    sides.bd = d - b
    sides.be = e - b
    sides.ef = f - e
    sides.fc = c - f
    sides.bf = f - b
    sides.ec = c - e
    return sides


@wp.func
def pulls_on_two_quads(s: Sides, first: wp.vec4, first_across: wp.vec2, second: wp.vec4, second_across: wp.vec2):
    """The forces on the corners of both [N], which add up to nothing.

    Args:
        first: what edges of the first pull with, over their vectors [N/m]; of that which they share nothing.
        first_across: what both diagonals do.
        second: of the second, and of what they share for both.
    """
    on = Six()
    da = first[3] * s.da
    ef = second[1] * s.ef
    bc = second[3] * s.bc
    on.a = first[0] * s.ab + first_across[0] * s.ac - da
    on.d = da - first[2] * s.cd - first_across[1] * s.bd
    on.e = ef + second_across[1] * s.ec - second[0] * s.be
    on.f = second[2] * s.fc - second_across[0] * s.bf - ef
    on.b = bc - first[0] * s.ab + first_across[1] * s.bd + second[0] * s.be + second_across[0] * s.bf
    on.c = first[2] * s.cd - first_across[0] * s.ac - second[2] * s.fc - second_across[1] * s.ec - bc
    return on


@wp.func
def crosses_at_two_quads(s: Sides):
    """What both add to the area vectors of their corners, over `CROSSES`, see `crosses_at_quad_corners` [m^2]."""
    at = Six()
    first = wp.cross(s.ac, s.bd)
    second = wp.cross(s.bf, s.ec)
    at.a = plus_cross(first, s.da, s.ab)
    at.d = plus_cross(first, s.cd, s.da)
    at.e = plus_cross(second, s.be, s.ef)
    at.f = plus_cross(second, s.ef, s.fc)
    both = 3.0 * (first + second)
    at.b = both - at.d - at.f
    at.c = both - at.a - at.e
    return at

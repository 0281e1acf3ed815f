"""Quads of membranes, alone and two side by side: their edges and diagonals, and what these do to their corners."""

import warp as wp


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

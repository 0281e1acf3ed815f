"""Membranes face by face, as kernels read them."""

import warp as wp


@wp.struct
class FilmTable:
    """Triangles of membranes, by faces of four corners with four triangles, or one, as a block loops over them.

    A face of one triangle has its first corner twice. Empty where no block loops over faces.
    """

    corners: wp.array[wp.vec4i]
    """Particles at each face's corners; where particles are resident, byte offsets of their points in a tile; where
    threads keep pairs, all first quads come first, see `FilmLayout`"""
    rests: wp.array[wp.vec4]
    """Rest metric of the triangle at each corner, all of the first corners first; zero area where there is no triangle;
    where threads keep them, the shape at rest, see `rest_of_shape`"""
    sums: wp.array[wp.vec4]
    """Rest sums where threads keep quads: of each along its edges, then of each the roots, then across and the slopes;
    see `Sums`, with a k of 1"""
    balloons: wp.array[wp.int32]
    """Balloon of each face"""
    numbers: wp.array[wp.vec4i]
    """Numbers of the triangles, where membranes wear"""
    places: wp.array[wp.vec4i]
    """Addresses of each face's forces on its particles, corner times the number of faces plus the face, in fours: the
    first four of all particles, then the next; an address past the end as padding. For pairs a, b, c, d, e and f of
    quads abcd and befc, or a, d, e, f and c where threads have the ends b and, most of them, c; where particles are
    resident, times `PLACE_BYTES`"""

"""Membranes face by face, as kernels read them."""

import warp as wp


@wp.struct
class FilmTable:
    """The triangles of membranes, by faces of four corners with four triangles, or one, as a block goes through them.
    A face of one has its first corner twice. Empty where no block does."""

    corners: wp.array[wp.vec4i]
    """the particles at each face's corners; where particles are resident, where their points begin in a tile, in
    bytes; where threads keep pairs, those of all first quads come first, see `FilmLayout`"""
    rests: wp.array[wp.vec4]
    """of the triangle at each corner, all of the first corners first; without area where there is none; where threads
    keep them, its shape at rest, see `rest_of_shape`"""
    sums: wp.array[wp.vec4]
    """where threads keep quads, of each along its edges, then of each the roots, then across and how steep; see
    `Sums`, with a k of 1"""
    balloons: wp.array[wp.int32]
    """of each face"""
    numbers: wp.array[wp.vec4i]
    """of the triangles, where they wear"""
    places: wp.array[wp.vec4i]
    """where what each face does to a particle stands, corner times the number of faces plus the face, in fours: of all
    particles the first four, then the next; and the place after all of them, where there is nothing, as what fills up;
    of pairs a, b, c, d, e and f of quads abcd and befc, or a, d, e, f and c where threads have the ends b and, most of
    them, c; where particles are resident, each times `PLACE_BYTES`"""

"""Tables of membranes face by face, as kernels read them."""

import warp as wp


@wp.struct
class MembraneFaceTable:
    """Triangles of membranes, by faces of four corners with four triangles, or one, as a block loops over them.

    A face of one triangle has its first corner twice. Empty where no block loops over faces.
    """

    corners: wp.array[wp.vec4i]
    """Particles at each face's corners; where forces are in tiles, byte offsets of the particles' points"""
    rests: wp.array[wp.vec4]
    """Rest metric of the triangle at each corner, all of the first corners first; no area where there is no triangle"""
    sums: wp.array[wp.vec4]
    """Rest sums where threads keep quads: of each along its edges, then of each the roots, then across and the slopes;
    see `Sums`, with a k of 1"""
    balloons: wp.array[wp.int32]
    """Balloon of each face"""
    numbers: wp.array[wp.vec4i]
    """Numbers of the triangles, where membranes wear"""
    places: wp.array[wp.vec4i]
    """Addresses of each face's forces on its particles, corner times the number of faces plus the face, in fours: the
    first four of all particles, then the next; an address past the end as padding; in tiles times `PLACE_BYTES`"""

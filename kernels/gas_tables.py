"""Tubes, pumps and necks as kernels read them: see `kernels.tables`."""

import warp as wp


@wp.struct
class TubeTable:
    """Tubes between balloons."""

    balloons: wp.array[wp.vec2i]
    conductance: wp.array2d[float]


@wp.struct
class PumpTable:
    """The curves of pumps; a shorter one repeats its last point."""

    has: wp.array[wp.int32]
    """Whether each balloon has a pump curve"""
    pressures: wp.array2d[float]
    """Pressures of the curve's points [Pa], shape (balloon_count, points)"""
    flows: wp.array2d[float]
    """Flows of the curve's points [mol/s]"""


@wp.struct
class NeckTable:
    """Necks of balloons; empty unless a balloon is open."""

    weights: wp.array[float]
    """Share of each particle in the thrust of its balloon's neck: by mass, 0 away from the neck"""
    offsets: wp.array[wp.int32]
    """Begin of the edges around each balloon's neck, and the end of the last"""
    edges: wp.array[wp.vec2i]
    """Edges around the neck, in the order of the faces that would close it"""

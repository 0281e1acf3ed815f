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
    """whether each balloon has one"""
    pressures: wp.array2d[float]
    """[Pa], shape (balloon_count, points)"""
    flows: wp.array2d[float]
    """[mol/s]"""


@wp.struct
class NeckTable:
    """Where balloons are open; empty unless one is."""

    weights: wp.array[float]
    """what each particle gets of the thrust of its balloon's neck: by mass, 0 of those that are not at it"""
    offsets: wp.array[wp.int32]
    """where the edges around each balloon's neck begin, and after the last, where they end"""
    edges: wp.array[wp.vec2i]
    """in turn, as the faces run that close it"""

"""Strings and outer forces as kernels read them: see `kernels.tables`."""

import warp as wp


@wp.struct
class StringTable:
    """Strings sorted by the particle that they hold: those of p are `offsets[p]` to `offsets[p + 1]`."""

    offsets: wp.array[wp.int32]
    """Begin of each particle's strings; empty if there are no strings"""
    particles: wp.array[wp.int32]
    """Particle that each string holds, in order"""
    order: wp.array[wp.vec2i]
    """Index of the string in the model, and of the free body that carries its anchor, or -1"""
    anchors: wp.array2d[wp.vec3]
    """Anchors. Where any moves: as the frame begins, on a body as the substep does; their velocities over the frame, on
    a body 0; and in the axes of a body from its center of mass, by turns, shape (3 world_count, string_count + 1),
    where the last column has the time at which the frame begins"""
    lengths: wp.array2d[float]
    stiffness: wp.array2d[float]


@wp.struct
class ForceTable:
    """Outer forces on each particle."""

    slots: wp.array2d[float]
    """Share of a particle in a force, and the index of that force, by turns; padded by shares of 0. Shape
    (particle_count, 2 times the most forces on any), or (0, 0) if none acts"""
    newtons: wp.array2d[wp.vec3]

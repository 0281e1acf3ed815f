"""Contacts that may push in a substep: with a ridge, and of two edges, or a particle and a triangle."""

import warp as wp

from balloon_warp.kernels.laws.edges import Crossing


@wp.struct
class Catch:
    """A feature of a balloon beside a ridge in a substep."""

    pair: wp.int32  # its number among those that are near
    corners: wp.vec3i
    weights: wp.vec3
    normal: wp.vec3  # from the ridge, zero if they do not meet
    gap: float  # [m]
    kept: float  # distance that they keep [m]
    solid: wp.int32
    arm: wp.vec3  # from the center of a body to the balloon's point [m]
    moving: wp.vec3  # how fast an obstacle's surface moves there [m/s]
    friction: float
    push: float  # by which it lets them come nearer no faster, this sweep [N s]


@wp.struct
class EdgeCatch:
    """Two edges, or a triangle and a particle, that may touch in a substep."""

    ends: wp.vec4i  # of the first edge and the second, or the triangle's corners and the particle
    weights: wp.vec4  # of their velocities in that of the second relative to the first
    crossing: Crossing  # of a particle, normal and gap alone
    kept: float  # distance that they keep [m]
    marked: wp.int32  # of this place in the list: which of the pairs of a sweep comes too near

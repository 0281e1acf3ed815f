"""Ridges of obstacles and free bodies and the faces that meet them, as kernels read them."""

import warp as wp

from balloon_warp.kernels.laws.ridges import Ridge


@wp.struct
class RidgeTable:
    """Ridges of all solids: first obstacles, then free bodies; empty where faces do not meet them."""

    ridges: wp.array[Ridge]
    ends: wp.array[wp.vec2i]
    """where each solid's begin and end"""
    trees: wp.array[wp.uint64]
    """of boxes around the ridges of each solid; 0 for one without any"""
    features: wp.array[wp.vec4i]
    """triangles and edges of balloons: their particles, -1 in place of an edge's third, and their balloon"""
    kept: float
    """distance that faces keep from ridges [m]"""
    margin: float
    """how much further off ridges are noted [m]"""


@wp.struct
class Catch:
    """A feature of a balloon beside a ridge in a substep."""

    corners: wp.vec3i
    weights: wp.vec3
    normal: wp.vec3  # from the ridge, zero if they do not meet
    gap: float  # [m]
    solid: wp.int32
    arm: wp.vec3  # from the center of a body to the balloon's point [m]
    moving: wp.vec3  # how fast an obstacle's surface moves there [m/s]
    friction: float
    push: float  # by which it lets them come nearer no faster, this sweep [N s]

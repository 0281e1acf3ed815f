"""A contact with a ridge."""

import warp as wp


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

"""Poses and velocities of obstacles that move as the scene says."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.tables import Tables, row_of_world


@wp.struct
class Pose:
    """Pose and velocities of an obstacle."""

    center: wp.vec3
    turn: wp.quat
    velocity: wp.vec3
    spin: wp.vec3  # [rad/s]


@wp.func
def motion_of(t: Tables, world: wp.int32, fixture: wp.int32):
    """Return the shift and rotation of an obstacle as a world's frame begins, and as it ends."""
    row = 2 * row_of_world(world, t.fixtures.motion.shape[0] // 2)
    return t.fixtures.motion[row, fixture], t.fixtures.motion[row + 1, fixture]


@wp.func
def seconds_in_frame(t: Tables, end: float):
    """Return a time within a frame, whose end and beginning rounding does not pass [s]."""
    return wp.clamp(end, 0.0, t.frame_seconds)


@cache
def center_function(features: Features) -> Any:
    """Return the function that returns an obstacle's origin at a time since the frame began."""

    @wp.func
    def center_at(t: Tables, world: wp.int32, fixture: wp.int32, end: float):
        """Return the position of an obstacle [m], linear between two frames."""
        shift = wp.transform_get_translation(t.fixtures.motion[0, fixture])
        if wp.static(features.fixtures_move):
            first, last = motion_of(t, world, fixture)
            part = seconds_in_frame(t, end) / t.frame_seconds
            way = wp.transform_get_translation(last) - wp.transform_get_translation(first)
            shift = wp.transform_get_translation(first) + part * way
        if wp.static(features.fixtures_steered):
            shift += seconds_in_frame(t, end) * t.fixtures.velocities[world, fixture]
        return t.fixtures.positions[row_of_world(world, t.fixtures.positions.shape[0]), fixture] + shift

    return center_at


@cache
def pose_function(features: Features) -> Any:
    """Return the function that returns an obstacle's pose at a time since the frame began."""
    center_at = center_function(features)

    @wp.func
    def pose_at(t: Tables, world: wp.int32, fixture: wp.int32, end: float):
        """Return the pose of an obstacle: between two frames it moves along a line, and turns about an axis."""
        pose = Pose()
        pose.center = center_at(t, world, fixture, end)
        if wp.static(features.fixtures_move):
            first, last = motion_of(t, world, fixture)
            part = seconds_in_frame(t, end) / t.frame_seconds
            shift = wp.transform_get_translation(last) - wp.transform_get_translation(first)
            axis, angle = wp.quat_to_axis_angle(
                wp.transform_get_rotation(last) * wp.quat_inverse(wp.transform_get_rotation(first))
            )
            pose.turn = wp.quat_from_axis_angle(axis, part * angle) * wp.transform_get_rotation(first)
            pose.velocity = shift / t.frame_seconds
            if wp.static(features.fixtures_steered):
                pose.velocity += t.fixtures.velocities[world, fixture]
            pose.spin = (angle / t.frame_seconds) * axis
        else:
            pose.turn = wp.transform_get_rotation(t.fixtures.motion[0, fixture])
        return pose

    return pose_at

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
def frame_at(t: Tables, time: float):
    """Return the frame of a step that ends at a time, and the fraction of it then; the last frame is one of rest."""
    last = t.fixtures.motion.shape[0] - 2
    frame = wp.clamp(int((time - 0.5 * t.step_seconds) / t.frame_seconds), 0, last)
    return frame, wp.clamp(time / t.frame_seconds - float(frame), 0.0, 1.0)


@wp.func
def seconds_in_frame(t: Tables, time: float):
    """Return the time since the frame of a step began that ends at a time [s]."""
    frame = wp.floor((time - 0.5 * t.step_seconds) / t.frame_seconds)
    return wp.clamp(time - frame * t.frame_seconds, 0.0, t.frame_seconds)


@cache
def center_function(features: Features) -> Any:
    """Return the function that returns an obstacle's origin at a time."""

    @wp.func
    def center_at(t: Tables, world: wp.int32, fixture: wp.int32, time: float):
        """Return the position of an obstacle [m], linear between two frames."""
        shift = wp.transform_get_translation(t.fixtures.motion[0, fixture])
        if wp.static(features.fixtures_move):
            frame, part = frame_at(t, time)
            begin = wp.transform_get_translation(t.fixtures.motion[frame, fixture])
            end = wp.transform_get_translation(t.fixtures.motion[frame + 1, fixture])
            shift = begin + part * (end - begin)
        if wp.static(features.fixtures_steered):
            shift += seconds_in_frame(t, time) * t.fixtures.velocities[world, fixture]
        return t.fixtures.positions[row_of_world(world, t.fixtures.positions.shape[0]), fixture] + shift

    return center_at


@cache
def pose_function(features: Features) -> Any:
    """Return the function that returns an obstacle's pose at a time."""
    center_at = center_function(features)

    @wp.func
    def pose_at(t: Tables, world: wp.int32, fixture: wp.int32, time: float):
        """Return the pose of an obstacle: between two frames it moves along a line, and turns about an axis."""
        pose = Pose()
        pose.center = center_at(t, world, fixture, time)
        if wp.static(features.fixtures_move):
            frame, part = frame_at(t, time)
            begin = t.fixtures.motion[frame, fixture]
            end = t.fixtures.motion[frame + 1, fixture]
            shift = wp.transform_get_translation(end) - wp.transform_get_translation(begin)
            axis, angle = wp.quat_to_axis_angle(
                wp.transform_get_rotation(end) * wp.quat_inverse(wp.transform_get_rotation(begin))
            )
            pose.turn = wp.quat_from_axis_angle(axis, part * angle) * wp.transform_get_rotation(begin)
            pose.velocity = shift / t.frame_seconds
            if wp.static(features.fixtures_steered):
                pose.velocity += t.fixtures.velocities[world, fixture]
            pose.spin = (angle / t.frame_seconds) * axis
        else:
            pose.turn = wp.transform_get_rotation(t.fixtures.motion[0, fixture])
        return pose

    return pose_at

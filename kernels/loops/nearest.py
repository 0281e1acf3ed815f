"""What is nearest to a point of a free rigid body: the ground, an obstacle, or another body."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.fixture_poses import pose_function
from balloon_warp.kernels.loops.solids import surface_function
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
from balloon_warp.kernels.traits import Traits


@wp.struct
class Near:
    """The nearest thing to a point of a body."""

    gap: float  # [m]
    normal: wp.vec3
    moving: wp.vec3  # [m/s]
    friction: float
    restitution: float
    other: wp.int32


@cache
def near_function(traits: Traits) -> Any:
    """The function that finds what is nearest to a point of a body."""
    pose_at = pose_function(traits) if traits.fixtures else None
    fixture_surface = surface_function(traits.fixture_meshes) if traits.fixtures else None
    body_surface = surface_function(traits.body_meshes)
    split = traits.columns.balloon_width
    height, ground_friction, ground_restitution = (
        traits.columns.places[name] - split for name in ("ground_height", "ground_friction", "ground_restitution")
    )

    @wp.func
    def nearest_to(
        t: Tables,
        state: WorldState,
        world: wp.int32,
        body: wp.int32,
        time: float,
        point: wp.vec3,
        radius: float,
        within: float,
    ):
        """At a time; of what is nearer than that [m]."""
        near = Near()
        near.gap = within
        near.other = -1
        if wp.static(traits.ground):
            row = row_of_world(world, t.world_numbers.shape[0])
            gap = wp.dot(point, t.up) - radius - t.world_numbers[row, height]
            if gap < near.gap:
                near.gap = gap
                near.normal = t.up
                near.friction = t.world_numbers[row, ground_friction]
                near.restitution = t.world_numbers[row, ground_restitution]
        if wp.static(traits.fixtures):
            for fixture in range(t.fixtures.solids.kinds.shape[0]):
                pose = pose_at(t, world, fixture, time)
                arm = point - pose.center
                if wp.length(arm) - t.fixtures.solids.reaches[fixture] - radius < near.gap:
                    gap, normal = fixture_surface(
                        t.fixtures.solids, t.up, fixture, wp.quat_rotate_inv(pose.turn, arm), radius,
                        wp.max(within, 0.0) + radius + 0.1 * t.fixtures.solids.reaches[fixture],
                    )  # fmt: skip
                    if gap < near.gap:
                        near.gap = gap
                        near.normal = wp.quat_rotate(pose.turn, normal)
                        near.moving = pose.velocity + wp.cross(pose.spin, arm)
                        near.friction = t.fixtures.frictions[
                            row_of_world(world, t.fixtures.frictions.shape[0]), fixture
                        ]
                        near.restitution = t.fixtures.restitutions[
                            row_of_world(world, t.fixtures.restitutions.shape[0]), fixture
                        ]
        for other in range(state.body_positions.shape[1]):
            arm = point - state.body_positions[world, other]
            if other != body and wp.length(arm) - t.bodies.solids.reaches[other] - radius < near.gap:
                turn = state.body_turns[world, other]
                gap, normal = body_surface(
                    t.bodies.solids, t.up, other, wp.quat_rotate_inv(turn, arm), radius,
                    wp.max(within, 0.0) + radius + 0.1 * t.bodies.solids.reaches[other],
                )  # fmt: skip
                if gap < near.gap:
                    near.gap = gap
                    near.normal = wp.quat_rotate(turn, normal)
                    near.moving = wp.vec3()
                    near.other = other
                    near.friction = t.bodies.friction[row_of_world(world, t.bodies.friction.shape[0]), other]
                    near.restitution = t.bodies.restitution[row_of_world(world, t.bodies.restitution.shape[0]), other]
        return near

    return nearest_to

"""Things that a free rigid body may touch: the ground, obstacles and other bodies, numbered in this order."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.rigid import turned_by
from balloon_warp.kernels.loops.fixtures import GROUND, number_of_body, number_of_obstacle, pose_function
from balloon_warp.kernels.loops.ways import surface_function
from balloon_warp.kernels.tables import Solid, Tables, WorldState, row_of_world


@wp.struct
class Thing:
    """Obstacle, body, sphere or ground, in a step."""

    fixture: wp.int32  # its number if it is an obstacle, or -1
    other: wp.int32  # its number if it is a body, or -1
    center: wp.vec3
    turn: wp.quat
    reach: float  # from there [m]
    solid: Solid  # of an obstacle or a body
    velocity: wp.vec3  # if it goes where it is told [m/s]
    spin: wp.vec3  # likewise [rad/s]
    number: wp.int32  # among all, as friction has it
    friction: float  # with the body that is near it
    restitution: float


@cache
def thing_functions(features: Features) -> tuple[Any, Any, Any, Any]:
    """Return functions for the number of things, for a body, for any thing, and for its distance to a point."""
    pose_at = pose_function(features) if features.fixtures else None
    surface_at = surface_function(features.body_meshes or features.fixture_meshes)
    split = features.columns.balloon_width
    height, ground_restitution = (
        features.columns.places[name] - split for name in ("ground_height", "ground_restitution")
    )

    @wp.func
    def count_of(t: Tables, state: WorldState):
        count = 1 + state.body_positions.shape[1]
        if wp.static(features.fixtures):
            count += t.fixtures.solids.shape[0]
        return count

    @wp.func
    def body_in(t: Tables, state: WorldState, world: wp.int32, body: wp.int32):
        """Return a body as a thing that bodies may touch."""
        thing = Thing()
        thing.fixture = -1
        thing.other = body
        thing.center = state.body_positions[world, body]
        thing.turn = state.body_turns[world, body]
        thing.solid = t.bodies.solids[body]
        thing.reach = thing.solid.reach
        thing.number = number_of_body(t, body)
        thing.restitution = t.bodies.restitution[row_of_world(world, t.bodies.restitution.shape[0]), body]
        return thing

    @wp.func
    def thing_at(t: Tables, state: WorldState, world: wp.int32, number: wp.int32, begin: float):
        """Return a thing as it is and moves when a step begins at a time in the frame."""
        thing = Thing()
        thing.fixture = -1
        thing.other = number - 1
        if number == 0:
            row = row_of_world(world, t.world_numbers.shape[0])
            thing.reach = wp.where(wp.static(features.ground), wp.inf, -wp.inf)
            thing.center = t.world_numbers[row, height] * t.up
            thing.number = GROUND
            thing.restitution = t.world_numbers[row, ground_restitution]
        elif wp.static(features.fixtures):
            fixture = number - 1
            thing.other = fixture - t.fixtures.solids.shape[0]
            if thing.other < 0:
                pose = pose_at(t, world, fixture, begin + t.step_seconds)  # as the step ends, then back
                thing.fixture = fixture
                thing.other = -1
                thing.center = pose.center - t.step_seconds * pose.velocity
                thing.turn = turned_by(pose.turn, -t.step_seconds * pose.spin)
                thing.solid = t.fixtures.solids[fixture]
                thing.reach = thing.solid.reach
                thing.velocity = pose.velocity
                thing.spin = pose.spin
                thing.number = number_of_obstacle(fixture)
                row = row_of_world(world, t.fixtures.restitutions.shape[0])
                thing.restitution = t.fixtures.restitutions[row, fixture]
        if thing.other >= 0:
            thing = body_in(t, state, world, thing.other)
        return thing

    @wp.func
    def gap_to(t: Tables, thing: Thing, point: wp.vec3, radius: float, within: float):
        """Return the gap from a thing's surface to a point's [m], up to `within`, and the normal there."""
        arm = point - thing.center
        gap = wp.dot(arm, t.up) - radius
        normal = t.up
        if thing.other >= 0 or thing.fixture >= 0:
            gap = wp.length(arm) - thing.reach - radius
            if gap < within:
                place, farthest = wp.quat_rotate_inv(thing.turn, arm), within + radius + 0.1 * thing.reach
                distance, outward = surface_at(thing.solid, t.up, place, radius, farthest)
                gap = distance
                normal = wp.quat_rotate(thing.turn, outward)
        return gap, normal

    return count_of, body_in, thing_at, gap_to

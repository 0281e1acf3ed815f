"""Solids with ridges: where obstacles and free bodies are as a substep begins, and how they move."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.rigid import spin_of, turned_by
from balloon_warp.kernels.loops.bodies import body_mass
from balloon_warp.kernels.loops.fixture_poses import pose_function
from balloon_warp.kernels.loops.friction import number_of_body, number_of_obstacle
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working


@wp.struct
class Placed:
    """A solid as a substep begins."""

    center: wp.vec3
    turn: wp.quat
    velocity: wp.vec3
    spin: wp.vec3  # [rad/s]
    reach: float  # of its farthest point [m]
    thing: wp.int32  # its number, as friction has it


@cache
def placing_function(features: Features) -> Any:
    """Return the function that returns the pose of a solid with ridges: an obstacle, or a body, numbered after them."""
    pose_at = pose_function(features) if features.fixtures else None

    @wp.func
    def place_of(t: Tables, state: WorldState, working: Working, world: wp.int32, number: wp.int32, end: float):
        """Return the pose of a solid in a substep that ends at a time."""
        placed = Placed()
        fixtures = t.fixtures.solids.shape[0]
        if wp.static(features.fixtures):
            if number < fixtures:
                pose = pose_at(t, world, number, end)
                placed.center = pose.center - t.step_seconds * pose.velocity
                placed.turn = turned_by(pose.turn, -t.step_seconds * pose.spin)
                placed.velocity = pose.velocity
                placed.spin = pose.spin
                placed.reach = t.fixtures.solids[number].reach
                placed.thing = number_of_obstacle(number)
        if wp.static(features.bodies > 0):
            if number >= fixtures:
                body = number - fixtures
                placed.center = working.body_starts[world, body]
                placed.turn = working.body_start_turns[world, body]
                placed.velocity = state.body_velocities[world, body]
                mass = body_mass(t, world, body)
                placed.spin = spin_of(placed.turn, t.bodies.eases[body], mass, state.body_momenta[world, body])
                placed.reach = t.bodies.solids[body].reach
                placed.thing = number_of_body(t, body)
        return placed

    return place_of

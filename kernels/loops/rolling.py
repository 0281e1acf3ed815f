"""How a sphere moves in a step, wherever it is kept, before it meets particles."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.contact import bounced, move_sphere
from balloon_warp.kernels.laws.impulse import fall
from balloon_warp.kernels.loops.fixtures import meeting_function
from balloon_warp.kernels.tables import Tables, row_of_world
from balloon_warp.kernels.traits import Traits


@cache
def leaving_function(traits: Traits) -> Any:
    """The function by which a sphere leaves obstacles."""
    meet = meeting_function(traits)

    @wp.func
    def leave_fixtures(
        t: Tables,
        world: wp.int32,
        time: float,
        start: wp.vec3,
        position: wp.vec3,
        velocity: wp.vec3,
        radius: float,
    ):
        """A sphere out of obstacles, which it leaves at the speed it came with times their restitution.

        Args:
            time: at the end of the step [s].
            start: where it was before the step.
        """
        for fixture in range(t.fixtures.solids.kinds.shape[0]):
            met = meet(t, world, fixture, time, start, position, radius)
            if wp.length_sq(met.normal) > 0.0:
                row = row_of_world(world, t.fixtures.restitutions.shape[0])
                position = met.let
                velocity = bounced(velocity, met.moving, met.normal, t.fixtures.restitutions[row, fixture])
        return position, velocity

    return leave_fixtures


@cache
def rolling_function(traits: Traits) -> Any:
    """The function that moves a sphere under gravity, beside the ground and obstacles."""
    leave_fixtures = leaving_function(traits) if traits.fixtures else None

    @wp.func
    def roll(
        t: Tables,
        world: wp.int32,
        time: float,
        position: wp.vec3,
        velocity: wp.vec3,
        pushed: wp.vec3,
        radius: float,
        around: wp.vec3,
    ):
        """Its position and velocity after a step.

        Args:
            time: at the end of the step [s].
            pushed: its acceleration by particles, where that is the paper's [m/s^2].
            around: gravity, the ground's height and its restitution.
        """
        if wp.static(traits.impulses):
            position, velocity = fall(position, velocity, radius, around[0], t.up, around[1], around[2], t.step_seconds)
        else:
            position, velocity = move_sphere(
                position, velocity, pushed, radius, around[0], t.up, around[1], around[2], t.step_seconds
            )
        if wp.static(traits.fixtures):
            start = position - t.step_seconds * velocity
            out, after = leave_fixtures(t, world, time, start, position, velocity, radius)
            position = out
            velocity = after
        return position, velocity

    return roll

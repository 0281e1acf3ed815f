"""Strings that are tied to free bodies pull these, too."""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.bodies import body_mass
from balloon_warp.kernels.loops.strings import held_string_pull
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working


@phase("world", when=lambda features: features.ties)
def tie(features: Features, look: Look) -> Any:
    """Place the anchors that bodies carry, and pull at these with the opposite of the forces on particles.

    Both ends get the same force, of where both are as the substep begins: momentum stays, as angular momentum does.
    """
    pull_of_held_string = held_string_pull(features)

    @wp.func
    def tie(
        t: Tables, state: WorldState, working: Working, points: Any, velocities: Any, world: wp.int32, time: float
    ):  # fmt: skip
        for body in range(state.body_positions.shape[1]):
            working.body_tugs[world, body] = wp.vec3()
            working.body_twists[world, body] = wp.vec3()
        for held in range(t.strings.particles.shape[0]):
            string = t.strings.order[held][0]
            body = t.strings.order[held][1]
            if body >= 0:
                arm = wp.quat_rotate(state.body_turns[world, body], t.strings.anchors[3 * world + 2, string])
                t.strings.anchors[3 * world, string] = state.body_positions[world, body] + arm
                push = -t.step_seconds * pull_of_held_string(t, world, held, points, velocities, time)
                working.body_tugs[world, body] = working.body_tugs[world, body] + push / body_mass(t, world, body)
                working.body_twists[world, body] = working.body_twists[world, body] + wp.cross(arm, push)
        for body in range(state.body_positions.shape[1]):
            state.body_velocities[world, body] = state.body_velocities[world, body] + working.body_tugs[world, body]
            state.body_momenta[world, body] = state.body_momenta[world, body] + working.body_twists[world, body]

    return tie

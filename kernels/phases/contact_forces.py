"""Impulses of contacts on particles, summed over a frame.

An impulse follows from the change of a velocity that all other forces would have left as it was, with the part of it
that damping and drag take in the step.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact.sums import take_impulse
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact_things import nearest_thing_function
from balloon_warp.kernels.loops.inertia import ease_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working

ROUNDING = wp.constant(1.0e-5)
"""Part of a velocity that is rounding where balloons push each other in many sweeps"""


@phase("particle", {"unhindered": wp.vec3}, when=lambda features: features.tells_contacts)
def note_unhindered(features: Features, look: Look) -> Any:
    """Store a particle's velocity without contacts."""

    @wp.func
    def note_unhindered(velocity: wp.vec3):
        return velocity

    return note_unhindered


@phase("particle", when=lambda features: features.tells_contacts)
def record_impulses(features: Features, look: Look) -> Any:
    """Sum the impulse of the thing nearest to a particle."""
    nearest_thing, ease_of_moving = nearest_thing_function(features), ease_function(features)

    @wp.func
    def record_impulses(
        t: Tables,
        state: WorldState,
        working: Working,
        params: Any,
        end: float,
        point: wp.vec3,
        velocity: wp.vec3,
        unhindered: wp.vec3,
        gain: float,
    ):
        change = velocity - unhindered
        least = float(0.0)
        if wp.static(features.edges_meet):
            of_layers = take_impulse(working.layer_quanta, params.world, params.number)
            if wp.length_sq(of_layers) > 0.0:
                change -= ease_of_moving(t, working, params.world, params.number) * of_layers
                least = ROUNDING * (wp.length(velocity) + wp.length(unhindered))
        if wp.length(change) > least and gain > 0.0:
            impulse = (t.step_seconds / gain) * change
            thing = nearest_thing(t, state, params.world, end, point)
            if thing >= 0:
                before = working.contact_impulses[params.world, thing, params.number]
                working.contact_impulses[params.world, thing, params.number] = before + wp.vec4(
                    impulse[0], impulse[1], impulse[2], t.step_seconds
                )

    return record_impulses

"""Impulses of contacts on particles, summed over a frame.

An impulse follows from the change of a velocity that all other forces would have left as it was.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.loops.contact_things import nearest_thing_function
from balloon_warp.kernels.loops.inertia import inertia_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working


@phase("particle", {"unhindered": wp.vec3}, when=lambda traits: traits.tells_contacts)
def note_unhindered(traits: Traits, look: Look) -> Any:
    """Store a particle's velocity without contacts."""

    @wp.func
    def note_unhindered(velocity: wp.vec3):
        return velocity

    return note_unhindered


@phase("particle", when=lambda traits: traits.tells_contacts)
def tell_contacts(traits: Traits, look: Look) -> Any:
    """Sum the impulse of the thing nearest to a particle."""
    inertia = inertia_function(traits)
    nearest_thing = nearest_thing_function(traits)

    @wp.func
    def tell_contacts(
        t: Tables,
        state: WorldState,
        working: Working,
        own: Any,
        end: float,
        point: wp.vec3,
        velocity: wp.vec3,
        unhindered: wp.vec3,
    ):
        gain = velocity - unhindered
        if wp.length_sq(gain) > 0.0:
            impulse = inertia(working, own) * gain
            thing = nearest_thing(t, state, own.world, end, point)
            if thing >= 0:
                told = working.contact_pushes[own.world, thing, own.number]
                working.contact_pushes[own.world, thing, own.number] = told + wp.vec4(
                    impulse[0], impulse[1], impulse[2], t.step_seconds
                )

    return tell_contacts

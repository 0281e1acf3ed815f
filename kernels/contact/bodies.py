"""Contact of particles with free bodies, as both go through the substep."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.contact.kind import Kind, list_contact
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.bodies import Rigid, body_at, stop_function
from balloon_warp.kernels.loops.fixtures import friction_on, number_of_body
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working

SETTLED, LITTLE = wp.constant(1.0e-3), wp.constant(1.0e-7)
"""Fractions of the way that a particle would go too far, and of the body's reach, by which it may still do so"""


@cache
def contact_function(features: Features) -> Any:
    """Return the function that finds where a particle would come into a body; the normal is zero where it does not."""
    stop_at = stop_function(features)

    @wp.func
    def contact_of(t: Tables, world: wp.int32, rigid: Rigid, particle: wp.int32, point: wp.vec3, velocity: wp.vec3):
        contact = Contact()
        start = point - t.step_seconds * velocity
        stop = stop_at(
            t.bodies.solids[rigid.number], t.up, t.step_seconds, rigid, start, point, velocity, 0.0
        )  # fmt: skip
        contact.normal = stop.normal
        if wp.length_sq(stop.normal) > 0.0:
            approach = wp.dot(rigid.velocity + wp.cross(rigid.spin, stop.arm) - velocity, stop.normal)
            contact.ends = wp.vec4i(particle, particle, particle, particle)
            contact.weights = wp.vec4(1.0, 0.0, 0.0, 0.0)
            contact.gap = t.step_seconds * (approach - stop.excess)
            contact.left = SETTLED * t.step_seconds * wp.max(stop.excess, 0.0) + LITTLE * rigid.reach
            contact.overlap = stop.out
            contact.friction = friction_on(t, world, t.particles.balloon[particle], number_of_body(t, rigid.number))
            contact.solid = t.fixtures.solids.shape[0] + rigid.number
            contact.arm = stop.arm
        return contact

    return contact_of


@cache
def listing_function(features: Features, backwards: bool) -> Any:
    """Return the function that lists particles that would come into bodies, see `kind.Kind`."""
    contact_of = contact_function(features)

    @wp.func
    def list_bodies(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        overlaps = bool(False)
        for body in range(state.body_positions.shape[1]):
            rigid = body_at(t, state, working.body_starts, working.body_start_turns, world, body)
            for particle in range(thread, points.shape[0], wp.block_dim()):
                if t.particles.mass_share[particle] > 0.0:
                    contact = contact_of(t, world, rigid, particle, points[particle], velocities[particle])
                    if wp.length_sq(contact.normal) > 0.0:
                        overlaps = list_contact(working, world, contact) or overlaps
        return overlaps

    return list_bodies


BODIES = Kind(lambda features: features.bodies > 0, listing_function, 50)
"""Particles that would come into free bodies"""

"""Spheres as ridges: each is its center, with its radius around that, so that faces meet it, see `laws.ridges`."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.ridge_sums import take_of_body
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.sliding import spin_by
from balloon_warp.kernels.tables import Tables, WorldState, sphere_mass, sphere_radius
from balloon_warp.kernels.working import Working


@cache
def ball_functions(features: Features) -> tuple[Any, Any]:
    """Return functions for the velocity of a sphere at an arm, and for its answer."""

    @wp.func
    def velocity_of_ball(state: WorldState, world: wp.int32, sphere: wp.int32, arm: wp.vec3):
        """Return the velocity of a sphere at an arm from its center [m/s]."""
        velocity = state.sphere_velocities[world, sphere]
        if wp.static(features.spheres_rub):
            velocity += wp.cross(state.sphere_spins[world, sphere], arm)
        return velocity

    @wp.func
    def move_ball(t: Tables, state: WorldState, working: Working, world: wp.int32, sphere: wp.int32, speeds: float):
        """Move a sphere by the sum of all impulses.

        Args:
            speeds: 1, or 0 where impulses are moves without speed.
        """
        impulse, torque = take_of_body(working.ridge_ball_quanta, world, sphere)
        mass = sphere_mass(t.spheres, world, sphere)
        gain = impulse / mass
        shift = wp.where(speeds > 0.0, t.step_seconds, 1.0) * gain
        state.sphere_positions[world, sphere] = state.sphere_positions[world, sphere] + shift
        state.sphere_velocities[world, sphere] = state.sphere_velocities[world, sphere] + speeds * gain
        force = (speeds / t.step_seconds) * impulse
        state.sphere_forces[world, sphere] = state.sphere_forces[world, sphere] + force
        if wp.static(features.spheres_rub):
            twist = spin_by(mass, sphere_radius(t.spheres, world, sphere), torque)
            state.sphere_spins[world, sphere] = state.sphere_spins[world, sphere] + speeds * twist

    return velocity_of_ball, move_ball

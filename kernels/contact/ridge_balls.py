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
def ball_laws(features: Features) -> tuple[Any, Any]:
    """Return functions of plain values for the velocity of a sphere at an arm, and for its gains by an impulse."""

    @wp.func
    def moving_of_ball(velocity: wp.vec3, spin: wp.vec3, arm: wp.vec3):
        """Return the velocity of a sphere at an arm from its center [m/s]."""
        if wp.static(features.spheres_rub):
            return velocity + wp.cross(spin, arm)
        return velocity

    @wp.func
    def gains_of_ball(mass: float, radius: float, impulse: wp.vec3, torque: wp.vec3):
        """Return the velocity [m/s] and the spin [rad/s] that a sphere gains."""
        twist = wp.vec3()
        if wp.static(features.spheres_rub):
            twist = spin_by(mass, radius, torque)
        return impulse / mass, twist

    return moving_of_ball, gains_of_ball


@cache
def ball_functions(features: Features) -> tuple[Any, Any]:
    """Return functions for the velocity of a sphere at an arm, and for its answer."""
    moving_of_ball, gains_of_ball = ball_laws(features)

    @wp.func
    def velocity_of_ball(state: WorldState, world: wp.int32, sphere: wp.int32, arm: wp.vec3):
        spin = wp.vec3()
        if wp.static(features.spheres_rub):
            spin = state.sphere_spins[world, sphere]
        return moving_of_ball(state.sphere_velocities[world, sphere], spin, arm)

    @wp.func
    def move_ball(t: Tables, state: WorldState, working: Working, world: wp.int32, sphere: wp.int32, speeds: float):
        """Move a sphere by the sum of all impulses.

        Args:
            speeds: 1, or 0 where impulses are moves without speed.
        """
        impulse, torque = take_of_body(working.ridge_ball_quanta, world, sphere)
        mass = sphere_mass(t.spheres, world, sphere)
        gain, twist = gains_of_ball(mass, sphere_radius(t.spheres, world, sphere), impulse, torque)
        shift = wp.where(speeds > 0.0, t.step_seconds, 1.0) * gain
        state.sphere_positions[world, sphere] = state.sphere_positions[world, sphere] + shift
        state.sphere_velocities[world, sphere] = state.sphere_velocities[world, sphere] + speeds * gain
        force = (speeds / t.step_seconds) * impulse
        state.sphere_forces[world, sphere] = state.sphere_forces[world, sphere] + force
        if wp.static(features.spheres_rub):
            state.sphere_spins[world, sphere] = state.sphere_spins[world, sphere] + speeds * twist

    return velocity_of_ball, move_ball

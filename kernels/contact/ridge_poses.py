"""Solids with ridges: where obstacles, free bodies and spheres are as a substep begins, and how they move."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.rigid import spin_of, turned_by
from balloon_warp.kernels.loops.bodies import body_mass
from balloon_warp.kernels.loops.fixtures import number_of_body, number_of_obstacle, number_of_sphere, pose_function
from balloon_warp.kernels.tables import Tables, WorldState, sphere_radius
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
    radius: float  # of a sphere, around its ridge, which is its center [m]
    kept: float  # distance that faces keep [m]


@wp.func
def body_of(t: Tables, solid: wp.int32):
    """Return the body that a solid is, or -1."""
    body = solid - t.fixtures.solids.shape[0]
    return wp.where(body < t.bodies.solids.shape[0], body, -1)


@wp.func
def sphere_of(t: Tables, solid: wp.int32):
    """Return the sphere that a solid is; below 0 if it is none."""
    return solid - t.fixtures.solids.shape[0] - t.bodies.solids.shape[0]


@cache
def placing_function(features: Features) -> Any:
    """Return the function for the pose of a solid with ridges: obstacles are first, then bodies, then spheres."""
    pose_at = pose_function(features) if features.fixtures else None

    @wp.func
    def place_of(t: Tables, state: WorldState, working: Working, world: wp.int32, number: wp.int32, end: float):
        """Return the pose of a solid in a substep that ends at a time."""
        placed = Placed()
        placed.kept = t.ridges.kept
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
            body = body_of(t, number)
            if body >= 0:
                placed.center = working.body_starts[world, body]
                placed.turn = working.body_start_turns[world, body]
                placed.velocity = state.body_velocities[world, body]
                mass = body_mass(t, world, body)
                placed.spin = spin_of(placed.turn, t.bodies.eases[body], mass, state.body_momenta[world, body])
                placed.reach = t.bodies.solids[body].reach
                placed.thing = number_of_body(t, body)
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, number)
            if sphere >= 0:
                placed.center = working.sphere_starts[world, sphere]
                placed.turn = wp.quat_identity()
                placed.thing = number_of_sphere(t, sphere)
                placed.radius = sphere_radius(t.spheres, world, sphere)
                if placed.radius > 0.0:
                    placed.velocity = state.sphere_velocities[world, sphere]
                placed.kept = 0.0  # as particles
        return placed

    return place_of

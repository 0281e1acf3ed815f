"""Solids that a particle may touch, numbered: the ground, obstacles, spheres and free bodies."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.fixture import FAR_AWAY
from balloon_warp.kernels.loops.fixture_poses import pose_function
from balloon_warp.kernels.loops.solids import surface_function
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world, sphere_radius


@cache
def nearest_thing_function(features: Features) -> Any:
    """Return the function that returns the thing nearest to a particle."""
    pose_at = pose_function(features) if features.fixtures else None
    surface_at = surface_function(features.body_meshes or features.fixture_meshes)
    height = features.columns.places["ground_height"] - features.columns.balloon_width

    @wp.func
    def nearest_thing(t: Tables, state: WorldState, world: wp.int32, end: float, point: wp.vec3):
        """Return the number of the nearest solid at the end of a substep; -1 if there is none."""
        nearest = float(FAR_AWAY)
        thing = wp.int32(-1)
        if wp.static(features.ground):
            row = row_of_world(world, t.world_numbers.shape[0])
            nearest = wp.dot(point, t.up) - t.world_numbers[row, height]
            thing = wp.int32(0)
        first = wp.int32(1)
        if wp.static(features.fixtures):
            for fixture in range(t.fixtures.solids.shape[0]):
                pose = pose_at(t, world, fixture, end)
                solid = t.fixtures.solids[fixture]
                place = wp.quat_rotate_inv(pose.turn, point - pose.center)
                if wp.length(place) - solid.reach < nearest:
                    distance, _normal = surface_at(solid, t.up, place, 0.0, wp.length(place) + solid.reach)
                    if distance < nearest:
                        nearest = distance
                        thing = first + fixture
            first += t.fixtures.solids.shape[0]
        if wp.static(features.spheres > 0):
            for sphere in range(state.sphere_positions.shape[1]):
                radius = sphere_radius(t.spheres, world, sphere)
                distance = wp.length(point - state.sphere_positions[world, sphere]) - radius
                if radius > 0.0 and distance < nearest:
                    nearest = distance
                    thing = first + sphere
            first += state.sphere_positions.shape[1]
        if wp.static(features.bodies > 0):
            for body in range(state.body_positions.shape[1]):
                solid = t.bodies.solids[body]
                place = wp.quat_rotate_inv(state.body_turns[world, body], point - state.body_positions[world, body])
                if wp.length(place) - solid.reach < nearest:
                    distance, _normal = surface_at(solid, t.up, place, 0.0, wp.length(place) + solid.reach)
                    if distance < nearest:
                        nearest = distance
                        thing = first + body
        return thing

    return nearest_thing

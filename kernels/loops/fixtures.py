"""Obstacles of prescribed motion: their poses, and the response of particles and balls."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import stand_on
from balloon_warp.kernels.laws.fixture import FAR_AWAY
from balloon_warp.kernels.laws.rigid import carried
from balloon_warp.kernels.loops.fixture_looks import SURELY, is_free, nearest_alone, note_look
from balloon_warp.kernels.loops.fixture_poses import center_function, pose_function
from balloon_warp.kernels.loops.friction import friction_on, number_of_obstacle
from balloon_warp.kernels.loops.solids import surface_function
from balloon_warp.kernels.loops.ways import way_function
from balloon_warp.kernels.tables import Tables


@wp.struct
class Around:
    """Particle, and the obstacles around it at the end of a step."""

    world: wp.int32
    particle: wp.int32
    balloon: wp.int32
    ground_height: float
    time: float  # [s]


@wp.struct
class Meeting:
    """Contact of a particle's path with an obstacle."""

    let: wp.vec3  # where it lets the particle go
    normal: wp.vec3  # there, zero if it is not in the way
    moving: wp.vec3  # how fast its surface moves there [m/s]
    free: float  # how far from the end of the way there is nothing for sure [m]
    slides: bool  # whether it slides on from its contact, as it passes an edge
    part: float  # of the step in which it does


NOBODY, ON_GROUND, SEVERAL = wp.constant(-1), wp.constant(-2), wp.constant(-3)
"""Partners of a particle in a step, beside the numbers of obstacles"""


@wp.func
def with_another(partner: wp.int32, thing: wp.int32):
    """Return the partner of a particle that meets one more: an obstacle, the ground, or several."""
    if thing == NOBODY or partner == thing:
        return partner
    return wp.where(partner == NOBODY, thing, SEVERAL)


@cache
def meeting_function(features: Features) -> Any:
    """Return the function for the contact of a particle, or a ball, with an obstacle."""
    pose_at = pose_function(features)
    center_at = center_function(features)
    let_through = way_function(features.fixture_meshes)

    @wp.func
    def meet(t: Tables, world: wp.int32, fixture: wp.int32, time: float, start: wp.vec3, end: wp.vec3, radius: float):
        """Return the contact with an obstacle in a step that ends at a time."""
        met = Meeting()
        met.let = end
        arm = end - center_at(t, world, fixture, time)
        way = wp.length(end - start) + t.step_seconds * t.fixtures.fastest
        met.free = wp.length(arm) - t.fixtures.solids[fixture].reach - radius
        if met.free <= way:
            pose = pose_at(t, world, fixture, time)
            before = start - pose.center
            if wp.static(features.fixtures_move):
                earlier = pose_at(t, world, fixture, time - t.step_seconds)
                # where the particle would have been, had the obstacle stood already where it is now
                before = wp.quat_rotate(pose.turn, wp.quat_rotate_inv(earlier.turn, start - earlier.center))
            place, outward, free, slides, part = let_through(
                t.fixtures.solids[fixture],
                t.up,
                wp.quat_rotate_inv(pose.turn, before),
                wp.quat_rotate_inv(pose.turn, arm),
                radius,
            )
            met.free = wp.max(met.free, free)
            if wp.length_sq(outward) > 0.0:
                arm = wp.quat_rotate(pose.turn, place)
                met.let = pose.center + arm
                met.normal = wp.quat_rotate(pose.turn, outward)
                met.moving = carried(pose.velocity, pose.spin, arm, -t.step_seconds)
                met.free = 0.0
                met.slides = slides
                met.part = part
        return met

    return meet


@cache
def free_ball_function(features: Features) -> Any:
    """Return the function that returns the clearance of a ball from obstacles."""
    pose_at = pose_function(features)
    surface_at = surface_function(features.fixture_meshes)

    @wp.func
    def free_ball(t: Tables, world: wp.int32, time: float, center: wp.vec3, radius: float):
        """Return a lower bound of the clearance of a ball from obstacles [m].

        Negative where an obstacle is in the way already; the search extends as far as the ball is wide.
        """
        free = float(FAR_AWAY)
        for fixture in range(t.fixtures.solids.shape[0]):
            pose = pose_at(t, world, fixture, time)
            place = wp.quat_rotate_inv(pose.turn, center - pose.center)
            beyond = wp.length(place) - t.fixtures.solids[fixture].reach - radius
            if beyond < radius:
                farthest = 3.0 * radius + t.fixtures.solids[fixture].thickness
                distance, _normal = surface_at(t.fixtures.solids[fixture], t.up, place, radius, farthest)
                beyond = wp.max(beyond, wp.min(distance, 2.0 * radius))
            free = wp.min(free, beyond)
        return SURELY * free

    return free_ball


@cache
def fixture_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions that move a particle out of obstacles, and that foresee its place."""
    meet = meeting_function(features)

    @wp.func
    def leave_fixtures(t: Tables, around: Around, start: wp.vec3, point: wp.vec3, velocity: wp.vec3, at_once: bool):
        """Return a particle's point and velocity outside of all obstacles, at the end of a step.

        Also the obstacle that has moved it, see `with_another`, and whether more than that one may be in its way.

        Args:
            start: Position before the step.
            at_once: see `stand_on`.
        """
        partner = NOBODY
        crowded = bool(False)
        if not is_free(t, around.world, around.particle, around.time, point):
            end = point
            free = float(FAR_AWAY)
            beyond = float(FAR_AWAY)  # of all but the nearest
            nearest = wp.int32(0)
            first = wp.int32(0)
            last = t.fixtures.solids.shape[0]
            seen, others = nearest_alone(t, around.world, around.particle, around.time, end)
            if others > 0.0:
                first = seen
                last = seen + 1
                beyond = others
            for fixture in range(first, last):
                met = meet(t, around.world, fixture, around.time, start, point, 0.0)
                beyond = wp.min(beyond, wp.max(free, met.free))
                if met.free < free:
                    nearest = fixture
                free = wp.min(free, met.free)
                if wp.length_sq(met.normal) > 0.0:
                    friction = friction_on(t, around.world, around.balloon, number_of_obstacle(fixture))
                    once = at_once or met.slides
                    stood, slowed = stand_on(
                        point, met.let, velocity, met.moving, met.normal, friction, t.step_seconds, once, met.part
                    )
                    point = stood
                    velocity = slowed
                    partner = with_another(partner, fixture)
            aside = wp.length(point - end)
            free = wp.min(free, beyond - aside)
            note_look(t, around.world, around.particle, around.time, free, nearest, beyond - aside, point)
            crowded = SURELY * beyond < wp.length(end - start) + aside
        return point, velocity, partner, crowded

    @wp.func
    def out_of_fixtures(
        t: Tables, around: Around, start: wp.vec3, end: wp.vec3, velocity: wp.vec3, last_normal: wp.vec3
    ):
        """Return a position outside of all obstacles, and the normal of the last in the way.

        The normal is `last_normal` if none is in the way.
        """
        outside = end
        outward = last_normal
        if not is_free(t, around.world, around.particle, around.time, end):
            for fixture in range(t.fixtures.solids.shape[0]):
                met = meet(t, around.world, fixture, around.time, start, outside, 0.0)
                if wp.length_sq(met.normal) > 0.0:
                    friction = friction_on(t, around.world, around.balloon, number_of_obstacle(fixture))
                    step = t.step_seconds
                    stood, _slowed = stand_on(
                        outside, met.let, velocity, met.moving, met.normal, friction, step, met.slides, met.part
                    )
                    outside = stood
                    outward = met.normal
        return outside, outward

    return leave_fixtures, out_of_fixtures

"""Obstacles of prescribed motion: poses, distances, friction, and the response of particles and balls.

A particle's distances to obstacles are cached. They are 1-Lipschitz: one query bounds how far the particle may move
without another. A particle on one of many obstacles is checked against this one alone, as long as the others are out of
its path.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import FAR_AWAY, resolve_at_surface
from balloon_warp.kernels.laws.rigid import carried
from balloon_warp.kernels.loops.paths import path_function, surface_function
from balloon_warp.kernels.memory import four_in, two_in
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world, sphere_radius

GROUND = wp.constant(0)
"""Number of the ground; then come obstacles, spheres, free bodies and balloons"""


@wp.func
def number_of_obstacle(obstacle: wp.int32):
    """Return the number of an obstacle among all things."""
    return 1 + obstacle


@wp.func
def number_of_sphere(t: Tables, sphere: wp.int32):
    """Return the number of a sphere among all things."""
    return 1 + t.fixtures.solids.shape[0] + sphere


@wp.func
def number_of_body(t: Tables, body: wp.int32):
    """Return the number of a body among all things."""
    return 1 + t.fixtures.solids.shape[0] + t.spheres.numbers.shape[1] + body


@wp.func
def number_of_balloon(t: Tables, balloon: wp.int32):
    """Return the number of a balloon among all things: balloons are the last."""
    return t.friction.shape[1] - t.balloon_numbers.shape[1] + balloon


@wp.func
def friction_between(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
    """Return Coulomb's coefficient of two things."""
    return t.friction[row_of_world(world, t.friction.shape[0]), first, second]


@wp.func
def friction_on(t: Tables, world: wp.int32, balloon: wp.int32, thing: wp.int32):
    """Return Coulomb's coefficient of a balloon and a thing."""
    return friction_between(t, world, number_of_balloon(t, balloon), thing)


@wp.func
def friction_of_balloons(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
    """Return Coulomb's coefficient of two balloons."""
    return friction_on(t, world, first, number_of_balloon(t, second))


@wp.struct
class Pose:
    """Pose and velocities of an obstacle."""

    center: wp.vec3
    turn: wp.quat
    velocity: wp.vec3
    spin: wp.vec3  # [rad/s]


@wp.func
def motion_of(t: Tables, world: wp.int32, fixture: wp.int32):
    """Return the shift and rotation of an obstacle as a world's frame begins, and as it ends."""
    row = 2 * row_of_world(world, t.fixtures.motion.shape[0] // 2)
    return t.fixtures.motion[row, fixture], t.fixtures.motion[row + 1, fixture]


@wp.func
def seconds_in_frame(t: Tables, end: float):
    """Return a time within a frame, whose end and beginning rounding does not pass [s]."""
    return wp.clamp(end, 0.0, t.frame_seconds)


@cache
def center_function(features: Features) -> Any:
    """Return the function that returns an obstacle's origin at a time since the frame began."""

    @wp.func
    def center_at(t: Tables, world: wp.int32, fixture: wp.int32, end: float):
        """Return the position of an obstacle [m], linear between two frames."""
        shift = wp.transform_get_translation(t.fixtures.motion[0, fixture])
        if wp.static(features.fixtures_move):
            first, last = motion_of(t, world, fixture)
            part = seconds_in_frame(t, end) / t.frame_seconds
            way = wp.transform_get_translation(last) - wp.transform_get_translation(first)
            shift = wp.transform_get_translation(first) + part * way
        if wp.static(features.fixtures_steered):
            shift += seconds_in_frame(t, end) * t.fixtures.velocities[world, fixture]
        return t.fixtures.positions[row_of_world(world, t.fixtures.positions.shape[0]), fixture] + shift

    return center_at


@cache
def pose_function(features: Features) -> Any:
    """Return the function that returns an obstacle's pose at a time since the frame began."""
    center_at = center_function(features)

    @wp.func
    def pose_at(t: Tables, world: wp.int32, fixture: wp.int32, end: float):
        """Return the pose of an obstacle: between two frames it moves along a line, and turns about an axis."""
        pose = Pose()
        pose.center = center_at(t, world, fixture, end)
        if wp.static(features.fixtures_move):
            first, last = motion_of(t, world, fixture)
            part = seconds_in_frame(t, end) / t.frame_seconds
            shift = wp.transform_get_translation(last) - wp.transform_get_translation(first)
            axis, angle = wp.quat_to_axis_angle(
                wp.transform_get_rotation(last) * wp.quat_inverse(wp.transform_get_rotation(first))
            )
            pose.turn = wp.quat_from_axis_angle(axis, part * angle) * wp.transform_get_rotation(first)
            pose.velocity = shift / t.frame_seconds
            if wp.static(features.fixtures_steered):
                pose.velocity += t.fixtures.velocities[world, fixture]
            pose.spin = (angle / t.frame_seconds) * axis
        else:
            pose.turn = wp.transform_get_rotation(t.fixtures.motion[0, fixture])
        return pose

    return pose_at


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


SURELY = wp.constant(0.999)
"""Fraction of a distance that is safe from rounding"""


@wp.func
def is_free(t: Tables, world: wp.int32, particle: wp.int32, time: float, end: wp.vec3):
    """Return whether no obstacle is in a particle's path, by the cached query."""
    seen = four_in(t.fixtures.clearances, world, particle)
    return wp.length(end - wp.vec3(seen[0], seen[1], seen[2])) + t.fixtures.fastest * time < seen[3]


@wp.func
def nearest_alone(t: Tables, world: wp.int32, particle: wp.int32, time: float, end: wp.vec3):
    """Return the nearest obstacle, and the clearance from all others [m]: positive if only that one may be met."""
    if t.fixtures.nearest.shape[1] == 0:
        return 0, FAR_AWAY  # there is one obstacle
    seen = four_in(t.fixtures.clearances, world, particle)
    noted = two_in(t.fixtures.nearest, world, particle)
    gone = wp.length(end - wp.vec3(seen[0], seen[1], seen[2])) + t.fixtures.fastest * time
    return wp.int32(noted[0]), noted[1] - gone


@wp.func
def cache_clearance(
    t: Tables,
    world: wp.int32,
    particle: wp.int32,
    time: float,
    free: float,
    nearest: wp.int32,
    beyond: float,
    point: wp.vec3,
):
    """Cache the clearance of a particle at the end of its path, the nearest obstacle, and that of all others [m]."""
    gone = t.fixtures.fastest * time
    t.fixtures.clearances[world, particle] = wp.vec4(point[0], point[1], point[2], SURELY * free + gone)
    if t.fixtures.nearest.shape[1] > 0:
        t.fixtures.nearest[world, particle] = wp.vec2(float(nearest), SURELY * beyond + gone)


@wp.func
def clear_clearance(t: Tables, world: wp.int32, particle: wp.int32):
    """Clear the cached query of a particle, before another path in the same step."""
    t.fixtures.clearances[world, particle] = wp.vec4()
    if t.fixtures.nearest.shape[1] > 0:
        t.fixtures.nearest[world, particle] = wp.vec2()


@wp.struct
class Neighborhood:
    """Particle, and the obstacles around it at the end of a step."""

    world: wp.int32
    particle: wp.int32
    balloon: wp.int32
    ground_height: float
    time: float  # [s]


@wp.struct
class ObstacleContact:
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
def obstacle_contact_function(features: Features) -> Any:
    """Return the function for the contact of a particle, or a ball, with an obstacle."""
    pose_at = pose_function(features)
    center_at = center_function(features)
    let_through = path_function(features.fixture_meshes)

    @wp.func
    def meet(t: Tables, world: wp.int32, fixture: wp.int32, time: float, start: wp.vec3, end: wp.vec3, radius: float):
        """Return the contact with an obstacle in a step that ends at a time."""
        met = ObstacleContact()
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
    """Functions that project a particle out of obstacles, and that predict its place."""
    meet = obstacle_contact_function(features)

    @wp.func
    def leave_fixtures(
        t: Tables, around: Neighborhood, start: wp.vec3, point: wp.vec3, velocity: wp.vec3, at_once: bool
    ):
        """Return a particle's point and velocity outside of all obstacles, at the end of a step.

        Also the obstacle that has moved it, see `with_another`, and whether more than that one may be in its way.

        Args:
            start: Position before the step.
            at_once: see `resolve_at_surface`.
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
                    stood, slowed = resolve_at_surface(
                        point, met.let, velocity, met.moving, met.normal, friction, t.step_seconds, once, met.part
                    )
                    point = stood
                    velocity = slowed
                    partner = with_another(partner, fixture)
            aside = wp.length(point - end)
            free = wp.min(free, beyond - aside)
            cache_clearance(t, around.world, around.particle, around.time, free, nearest, beyond - aside, point)
            crowded = SURELY * beyond < wp.length(end - start) + aside
        return point, velocity, partner, crowded

    @wp.func
    def out_of_fixtures(
        t: Tables, around: Neighborhood, start: wp.vec3, end: wp.vec3, velocity: wp.vec3, last_normal: wp.vec3
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
                    stood, _slowed = resolve_at_surface(
                        outside, met.let, velocity, met.moving, met.normal, friction, step, met.slides, met.part
                    )
                    outside = stood
                    outward = met.normal
        return outside, outward

    return leave_fixtures, out_of_fixtures

"""Adjoint of one contact of a particle: with the ground, a mesh, whose normal is frozen, or a convex solid."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.contacts import Contact
from balloon_warp.kernels.adjoints.fixture_bars import fixture_bars_function
from balloon_warp.kernels.contact_tables import Solid
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import leave_ground, stand_on
from balloon_warp.kernels.laws.fixture import FAR_AWAY, LEAST_STEP, MESH
from balloon_warp.kernels.laws.rigid import carried
from balloon_warp.kernels.loops.fixture_poses import Pose, pose_function
from balloon_warp.kernels.loops.fixtures import ON_GROUND, Around
from balloon_warp.kernels.loops.solids import surface_function
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


@wp.struct
class BarsOfContact:
    """Derivatives by the state of a particle before a contact."""

    start: wp.vec3
    point: wp.vec3
    velocity: wp.vec3
    height: float  # of the ground
    friction: float  # Coulomb's coefficient on the ground
    normal: wp.vec3  # of the surface that it has met before, if it meets nothing here


@wp.func
def work_on_ground(
    point: wp.vec3, velocity: wp.vec3, up: wp.vec3, height: float, friction: float, step: float, at_once: bool,
    point_bar: wp.vec3, velocity_bar: wp.vec3,
):  # fmt: skip
    """Return where a particle leaves the ground and its velocity, times their bars."""
    out, after = leave_ground(point, velocity, up, height, friction, step, at_once)
    return wp.dot(out, point_bar) + wp.dot(after, velocity_bar)


@wp.func
def work_beside(
    point: wp.vec3, velocity: wp.vec3, let: wp.vec3, normal: wp.vec3, moving: wp.vec3, friction: float, step: float,
    part: float, at_once: bool, point_bar: wp.vec3, velocity_bar: wp.vec3,
):  # fmt: skip
    """Return the state of a particle after a contact with frozen normal, times bars."""
    place = point + wp.dot(let - point, normal) * normal
    stood, slowed = stand_on(point, place, velocity, moving, normal, friction, step, at_once, part)
    return wp.dot(stood, point_bar) + wp.dot(slowed, velocity_bar)


surface_of_convex = surface_function(False)


@wp.func
def into(pose: Pose, point: wp.vec3):
    """Return a point in an obstacle's frame."""
    return wp.quat_rotate_inv(pose.turn, point - pose.center)


@wp.func
def nearest_on_convex(here: wp.vec3, solid: Solid, up: wp.vec3, radius: float):
    """Return the nearest place that a convex solid leaves a ball's center, and the normal there, in the solid's frame.

    Of a particle the radius is 0.
    """
    distance, normal = surface_of_convex(solid, up, here, radius, FAR_AWAY)
    return here - distance * normal, normal


@wp.struct
class Entry:
    """Approach of a particle to a solid: constants, by which nothing is derived."""

    slides: bool  # on from where its way comes in; otherwise it stands at the nearest place
    part: float  # of the way up to there; 0 where it begins on the surface
    steepness: float  # how fast the way comes in, its normal part [m]
    friction: float
    restitution: float  # of a sphere
    gravity: float  # likewise [m/s^2]
    step: float  # [s]
    at_once: bool  # whether all of the approach is stopped, see `stand_on`


@wp.func
def entry_of(start: wp.vec3, here: wp.vec3, let: wp.vec3, part: float, solid: Solid, up: wp.vec3, radius: float):
    """Return the approach of a particle, or a ball, to a solid, in the solid's frame.

    Args:
        let: where the solid lets it go.
        part: of the way that is left to slide.
    """
    entry = Entry()
    place, _normal = nearest_on_convex(here, solid, up, radius)
    entry.slides = wp.length(place - let) > LEAST_STEP * (wp.length(here) + wp.length(here - start))
    entry.part = 1.0 - part
    _entry, normal = nearest_on_convex(start + entry.part * (here - start), solid, up, radius)
    entry.steepness = wp.max(-wp.dot(here - start, normal), LEAST_STEP * wp.length(here - start))
    return entry


@wp.func
def slid_on_convex(start: wp.vec3, here: wp.vec3, solid: Solid, up: wp.vec3, radius: float, entry: Entry):
    """Return the end of a path that slides on from its entry, the normal there, and the fraction that slides."""
    before, _normal = surface_of_convex(solid, up, start + entry.part * (here - start), radius, FAR_AWAY)
    gone = entry.part
    if entry.part > 0.0:
        gone = entry.part + before / entry.steepness
    place, normal = nearest_on_convex(start + gone * (here - start), solid, up, radius)
    return here + wp.dot(place - here, normal) * normal, normal, 1.0 - gone


@wp.func
def work_on_convex(
    start: wp.vec3, point: wp.vec3, velocity: wp.vec3, solid: Solid, pose: Pose, earlier: Pose, up: wp.vec3,
    entry: Entry, point_bar: wp.vec3, velocity_bar: wp.vec3, normal_bar: wp.vec3,
):  # fmt: skip
    """Return the state of a particle that stops on a convex solid, and the normal there, times bars."""
    here = into(pose, point)
    place, normal = nearest_on_convex(here, solid, up, 0.0)
    left = float(1.0)
    if entry.slides:
        slid, held, more = slid_on_convex(into(earlier, start), here, solid, up, 0.0, entry)
        place = slid
        normal = held
        left = more
    arm = wp.quat_rotate(pose.turn, place)
    outward = wp.quat_rotate(pose.turn, normal)
    moving = carried(pose.velocity, pose.spin, arm, -entry.step)
    stood, slowed = stand_on(
        point, pose.center + arm, velocity, moving, outward, entry.friction, entry.step, entry.at_once, left
    )
    return wp.dot(stood, point_bar) + wp.dot(slowed, velocity_bar) + wp.dot(outward, normal_bar)


@cache
def contact_adjoint(features: Features) -> Any:
    """Return the function that runs one contact backwards."""
    pose_at, note_fixture = pose_function(features), fixture_bars_function(features)

    @wp.func
    def contact_backwards(
        t: Tables, working: Working, around: Around, contact: Contact, point_bar: wp.vec3, velocity_bar: wp.vec3,
        normal_bar: wp.vec3,
    ):  # fmt: skip
        bars = BarsOfContact()
        if contact.thing == ON_GROUND:
            of_point, of_velocity, _up, of_height, of_friction, _s, _once, _pb, _vb = wp.grad(work_on_ground)(
                contact.point, contact.velocity, t.up, around.ground_height, contact.friction, t.step_seconds,
                contact.at_once, point_bar, velocity_bar,
            )  # fmt: skip
            bars.point = of_point
            bars.velocity = of_velocity
            bars.height = of_height
            bars.friction = of_friction
            return bars
        solid = t.fixtures.solids[contact.thing]
        if solid.kind == MESH:
            once = contact.at_once or contact.met.slides
            of_point, of_velocity, by_let, _n, by_moving, of_friction, _s, _part, _o, _pb, _vb = wp.grad(work_beside)(
                contact.point, contact.velocity, contact.met.let, contact.met.normal, contact.met.moving,
                contact.friction, t.step_seconds, contact.met.part, once, point_bar, velocity_bar,
            )  # fmt: skip
            bars.point = of_point
            bars.velocity = of_velocity
            note_fixture(t, working, around, contact.thing, by_let, by_moving, wp.vec3(), of_friction)
            return bars
        pose = pose_at(t, around.world, contact.thing, around.time)
        earlier = pose
        if wp.static(features.fixtures_move):
            earlier = pose_at(t, around.world, contact.thing, around.time - t.step_seconds)
        start = into(earlier, contact.start)
        here = into(pose, contact.point)
        entry = entry_of(start, here, into(pose, contact.met.let), contact.met.part, solid, t.up, 0.0)
        entry.friction = contact.friction
        entry.step = t.step_seconds
        entry.at_once = contact.at_once or contact.met.slides
        by_start, by_point, by_velocity, _on, by_pose, by_earlier, _up, by_entry, _p, _v, _n = wp.grad(work_on_convex)(
            contact.start, contact.point, contact.velocity, solid, pose, earlier, t.up, entry, point_bar,
            velocity_bar, normal_bar,
        )  # fmt: skip
        bars.start = by_start
        bars.point = by_point
        bars.velocity = by_velocity
        note_fixture(
            t, working, around, contact.thing, by_pose.center, by_pose.velocity, by_earlier.center, by_entry.friction
        )
        return bars

    return contact_backwards

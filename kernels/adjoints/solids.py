"""Adjoints of contact with solids: the ground, obstacles, or spheres.

Which particles touch which things in which substep, and whether friction holds them, is frozen; on meshes the normal,
too. For boxes, capsules and planes it is derived: at the place that is nearest to where a particle comes, or where its
way comes in, if it slides on from there.

A particle may touch several things one after the other. To run backwards through them, the way up to each is found
again: there are few.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.spheres import (
    leaving_spheres_adjoint,
    past_spheres_function,
    predicted_spheres_adjoint,
)
from balloon_warp.kernels.compose import params_functions
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import (
    FAR_AWAY,
    LEAST_STEP,
    MESH,
    MOST_TURNS,
    is_settled,
    leave_ground,
    resolve_at_surface,
)
from balloon_warp.kernels.laws.rigid import carried
from balloon_warp.kernels.loops.contact import around_function
from balloon_warp.kernels.loops.fixtures import (
    GROUND,
    NOBODY,
    ON_GROUND,
    SEVERAL,
    SURELY,
    Neighborhood,
    ObstacleContact,
    Pose,
    friction_on,
    number_of_obstacle,
    obstacle_contact_function,
    pose_function,
    seconds_in_frame,
    with_another,
)
from balloon_warp.kernels.loops.paths import surface_of_convex
from balloon_warp.kernels.loops.spheres import is_near_sphere
from balloon_warp.kernels.phase import Access, Adjoint, NoAdjointError, Phase
from balloon_warp.kernels.tables import Solid, Tables
from balloon_warp.kernels.working import FixtureBars, Working

WIDTH = 7
"""Numbers of `FixtureBars`"""
Totals = wp.types.vector(length=WIDTH, dtype=wp.float64)
"""Sums of `FixtureBars`"""


@wp.func
def part_of_frame(t: Tables, time: float):
    """Return which part of its frame is over at a time."""
    return seconds_in_frame(t, time) / t.frame_seconds


@cache
def fixture_bars_function(features: Features) -> Any:
    """Accumulator of an obstacle's bars by a particle's contact, where requested."""

    @wp.func
    def note_fixture(
        t: Tables, working: Working, around: Neighborhood, fixture: wp.int32, by_center: wp.vec3, by_velocity: wp.vec3,
        by_center_before: wp.vec3, by_friction: float,
    ):  # fmt: skip
        """Add to the bars of an obstacle.

        Args:
            by_center: bar of its place as the substep ends, between those of the frame's beginning and end.
            by_velocity: bar of its velocity, which follows from both.
            by_center_before: bar of its place as the substep begins.
        """
        if working.fixture_bars.shape[1] > 0:
            at_last = wp.vec3()
            if wp.static(features.fixtures_move):
                at_last = (
                    part_of_frame(t, around.time) * by_center
                    + part_of_frame(t, around.time - t.step_seconds) * by_center_before
                    + by_velocity / t.frame_seconds
                )
            at_first = by_center + by_center_before - at_last
            more = FixtureBars(at_first[0], at_first[1], at_first[2], at_last[0], at_last[1], at_last[2], by_friction)
            before = working.fixture_bars[around.world, around.particle, fixture]
            working.fixture_bars[around.world, around.particle, fixture] = before + more

    return note_fixture


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def sum_fixture_bars(t: Tables, working: Working, totals: wp.array3d[Totals]):
    """Add up an obstacle's bars by a balloon's particles, and clear them; a thread a (world, balloon, obstacle)."""
    world, balloon, fixture = wp.tid()
    total = Totals()
    for particle in range(t.particles.offsets[balloon], t.particles.offsets[balloon + 1]):
        total += Totals(working.fixture_bars[world, particle, fixture])
        working.fixture_bars[world, particle, fixture] = FixtureBars()
    totals[world, balloon, fixture] = total


MOST_CONTACTS = wp.constant(1000)
"""More contacts than a particle has in a substep"""


@wp.struct
class Contact:
    """A contact of a particle in a substep, and the state with which the particle comes to it."""

    number: wp.int32  # in the order in which the particle comes to them, -1 if there is none
    thing: wp.int32  # number of the obstacle, or `ON_GROUND`
    start: wp.vec3  # of its way
    point: wp.vec3
    velocity: wp.vec3
    met: ObstacleContact
    friction: float
    at_once: bool  # whether it stops all of an approach, see `resolve_at_surface`
    partner: wp.int32  # of all contacts so far, see `with_another`


@cache
def contact_function(features: Features) -> Any:
    """Finder of a particle's contacts in a substep, one after the other."""
    meet = obstacle_contact_function(features)

    @wp.func
    def last_contact(
        t: Tables, around: Neighborhood, start: wp.vec3, end: wp.vec3, predicted_velocity: wp.vec3, before: wp.int32,
        predicted: bool, at_once: bool,
    ):  # fmt: skip
        """Return the last contact of a particle before that of a number, see `loops.contact`.

        Args:
            predicted: whether contacts are those of `deflection_function`, in one turn at one velocity.
            at_once: whether contacts stop all of an approach.
        """
        found = Contact()
        found.number = -1
        found.start = start
        found.at_once = at_once
        h = t.step_seconds
        point = end
        velocity = predicted_velocity
        found.partner = NOBODY
        seen = wp.int32(0)
        turns = wp.int32(0)
        while turns < wp.where(predicted, 1, MOST_TURNS):
            turns += 1
            came = point
            nearest = float(FAR_AWAY)
            beyond = float(FAR_AWAY)
            again = bool(False)
            for thing in range(t.fixtures.solids.shape[0]):
                met = meet(t, around.world, thing, around.time, start, point, 0.0)
                beyond = wp.min(beyond, wp.max(nearest, met.free))
                nearest = wp.min(nearest, met.free)
                if wp.length_sq(met.normal) > 0.0:
                    friction = friction_on(t, around.world, around.balloon, number_of_obstacle(thing))
                    if seen < before:
                        found.number = seen
                        found.thing = thing
                        found.point = point
                        found.velocity = velocity
                        found.met = met
                        found.friction = friction
                    seen += 1
                    found.partner = with_another(found.partner, thing)
                    again = True
                    once = found.at_once or met.slides
                    stood, slowed = resolve_at_surface(
                        point, met.let, velocity, met.moving, met.normal, friction, h, once, met.part
                    )
                    point = stood
                    velocity = wp.where(predicted, predicted_velocity, slowed)
            again = again and SURELY * beyond < wp.length(came - start) + wp.length(point - came)
            if wp.static(features.ground):
                height = around.ground_height
                if wp.dot(point, t.up) < height:
                    friction = friction_on(t, around.world, around.balloon, GROUND)
                    if seen < before:
                        found.number = seen
                        found.thing = ON_GROUND
                        found.point = point
                        found.velocity = velocity
                        found.friction = friction
                    seen += 1
                    found.partner = with_another(found.partner, ON_GROUND)
                    again = nearest < wp.length(point - start) + wp.length(point - came)
                    stood, slowed = leave_ground(point, velocity, t.up, height, friction, h, found.at_once)
                    point = stood
                    velocity = wp.where(predicted, predicted_velocity, slowed)
            if seen >= before or not again or is_settled(start, came, point):
                turns = MOST_TURNS
        return found

    return last_contact


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
def ground_pairing(
    point: wp.vec3, velocity: wp.vec3, up: wp.vec3, height: float, friction: float, step: float, at_once: bool,
    point_bar: wp.vec3, velocity_bar: wp.vec3,
):  # fmt: skip
    """Pairing of a particle's place and velocity after contact with the ground with their bars."""
    out, after = leave_ground(point, velocity, up, height, friction, step, at_once)
    return wp.dot(out, point_bar) + wp.dot(after, velocity_bar)


@wp.func
def solid_pairing(
    point: wp.vec3, velocity: wp.vec3, let: wp.vec3, normal: wp.vec3, moving: wp.vec3, friction: float, step: float,
    part: float, at_once: bool, point_bar: wp.vec3, velocity_bar: wp.vec3,
):  # fmt: skip
    """Pairing of a particle's state after a contact of constant normal with its bars."""
    place = point + wp.dot(let - point, normal) * normal
    stood, slowed = resolve_at_surface(point, place, velocity, moving, normal, friction, step, at_once, part)
    return wp.dot(stood, point_bar) + wp.dot(slowed, velocity_bar)


@wp.func
def into(pose: Pose, point: wp.vec3):
    """Return a point in an obstacle's frame."""
    return wp.quat_rotate_inv(pose.turn, point - pose.center)


@wp.func
def nearest_on_convex(here: wp.vec3, solid: Solid, up: wp.vec3, radius: float):
    """Nearest place outside of a convex solid for a ball's center, and the normal there, in the solid's frame.

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
    at_once: bool  # whether all of the approach is stopped, see `resolve_at_surface`


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
def convex_pairing(
    start: wp.vec3, point: wp.vec3, velocity: wp.vec3, solid: Solid, pose: Pose, earlier: Pose, up: wp.vec3,
    entry: Entry, point_bar: wp.vec3, velocity_bar: wp.vec3, normal_bar: wp.vec3,
):  # fmt: skip
    """Pairing of a particle's state on a convex solid, and of the normal there, with their bars."""
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
    stood, slowed = resolve_at_surface(
        point, pose.center + arm, velocity, moving, outward, entry.friction, entry.step, entry.at_once, left
    )
    return wp.dot(stood, point_bar) + wp.dot(slowed, velocity_bar) + wp.dot(outward, normal_bar)


@cache
def contact_adjoint(features: Features) -> Any:
    """Adjoint of one contact."""
    pose_at, note_fixture = pose_function(features), fixture_bars_function(features)

    @wp.func
    def contact_backwards(
        t: Tables, working: Working, around: Neighborhood, contact: Contact, point_bar: wp.vec3, velocity_bar: wp.vec3,
        normal_bar: wp.vec3,
    ):  # fmt: skip
        bars = BarsOfContact()
        if contact.thing == ON_GROUND:
            of_point, of_velocity, _up, of_height, of_friction, _s, _once, _pb, _vb = wp.grad(ground_pairing)(
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
            of_point, of_velocity, by_let, _n, by_moving, of_friction, _s, _part, _o, _pb, _vb = wp.grad(solid_pairing)(
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
        by_start, by_point, by_velocity, _on, by_pose, by_earlier, _up, by_entry, _p, _v, _n = wp.grad(convex_pairing)(
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


def ground_columns(features: Features) -> tuple[int, int]:
    """Return the columns of the ground's height, and of a balloon's own coefficient of friction."""
    return features.columns.places["ground_height"], features.columns.places["balloon_friction"]


@wp.func
def ground_backwards(
    t: Tables, around: Neighborhood, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3, velocity_bar: wp.vec3
):
    """Adjoint of contact with the ground: bars of a particle's state before it."""
    bars = BarsOfContact()
    bars.point = point_bar
    bars.velocity = velocity_bar
    if wp.dot(point, t.up) < around.ground_height:
        friction = friction_on(t, around.world, around.balloon, GROUND)
        by_point, by_velocity, _up, by_height, by_friction, _step, _once, _bar, _v_bar = wp.grad(ground_pairing)(
            point, velocity, t.up, around.ground_height, friction, t.step_seconds, False, point_bar, velocity_bar
        )
        bars.point = by_point
        bars.velocity = by_velocity
        bars.height = by_height
        bars.friction = by_friction
    return bars


@wp.func
def deflection_by_ground_backwards(
    t: Tables, around: Neighborhood, start: wp.vec3, ahead: wp.vec3, predicted_velocity: wp.vec3, place_bar: wp.vec3,
    normal_bar: wp.vec3,
):  # fmt: skip
    """Adjoint of the deflection by the ground: bars of the predicted place and velocity, and of the last normal."""
    bars = ground_backwards(t, around, ahead, predicted_velocity, place_bar, wp.vec3())
    if wp.dot(ahead, t.up) >= around.ground_height:
        bars.normal = normal_bar
    return bars


@wp.func
def deflection_pairing(
    point: wp.vec3, predicted_velocity: wp.vec3, up: wp.vec3, height: float, friction: float, step_seconds: float,
    bar: wp.vec3,
):  # fmt: skip
    """Return the velocity change that the ground will bring, see `loops.contact.deflection_function`, times a bar."""
    end = point + step_seconds * predicted_velocity
    outside, _slowed = leave_ground(end, predicted_velocity, up, height, friction, step_seconds, False)
    return wp.dot(outside - end, bar) / step_seconds


def leave_ground_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of contact with the ground."""
    column, friction_column = ground_columns(features)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    around_particle = around_function(features)

    @wp.func
    def leave_adjoint(
        t: Tables, params: Any, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3, velocity_bar: wp.vec3
    ):
        params_bar = Params()
        bars = BarsOfContact()
        bars.point = point_bar
        bars.velocity = velocity_bar
        if params.mass > 0.0:
            bars = ground_backwards(t, around_particle(params, 0.0), point, velocity, point_bar, velocity_bar)
            params_bar.n[column] = bars.height
            params_bar.n[friction_column] = bars.friction
        return bars.point, bars.velocity, params_bar

    return (Adjoint(leave_adjoint, ("point", "velocity", "params")),)


def predict_deflection_by_ground_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of the predicted deflection; the direction from the ground is constant."""
    column, friction_column = ground_columns(features)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def predict_deflection_adjoint(
        t: Tables, params: Any, gain: float, point: wp.vec3, predicted_velocity: wp.vec3, deflection_bar: wp.vec3
    ):
        params_bar = Params()
        point_bar = wp.vec3()
        predicted_velocity_bar = wp.vec3()
        height = params.n[column]
        if gain > 0.0 and wp.dot(point + t.step_seconds * predicted_velocity, t.up) < height:
            friction = friction_on(t, params.world, params.balloon, GROUND)
            by_point, by_predicted_velocity, _up, by_height, by_friction, _step, _bar = wp.grad(deflection_pairing)(
                point, predicted_velocity, t.up, height, friction, t.step_seconds, deflection_bar
            )
            point_bar = by_point
            predicted_velocity_bar = by_predicted_velocity
            params_bar.n[column] = by_height
            params_bar.n[friction_column] = by_friction
        return point_bar, predicted_velocity_bar, params_bar

    return (Adjoint(predict_deflection_adjoint, ("point", "predicted_velocity", "params")),)


@cache
def solid_contact_adjoint(features: Features) -> Any:
    """Adjoint of a particle's contact with obstacles and the ground."""
    contact_backwards, last_contact = contact_adjoint(features), contact_function(features)

    @wp.func
    def solid_contact_backwards(
        t: Tables, working: Working, around: Neighborhood, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3,
        velocity_bar: wp.vec3,
    ):  # fmt: skip
        bars = BarsOfContact()
        bars.point = point_bar
        bars.velocity = velocity_bar
        start = point - t.step_seconds * velocity
        number = MOST_CONTACTS
        at_once = bool(False)
        while number > 0:
            contact = last_contact(t, around, start, point, velocity, number, False, at_once)
            if number == MOST_CONTACTS and contact.partner == SEVERAL and not at_once:
                at_once = True
                continue
            number = contact.number
            if number >= 0:
                more = contact_backwards(t, working, around, contact, bars.point, bars.velocity, wp.vec3())
                bars.point = more.point
                bars.velocity = more.velocity
                bars.start += more.start
                bars.height += more.height
                bars.friction += more.friction
        bars.point += bars.start
        bars.velocity -= t.step_seconds * bars.start
        return bars

    return solid_contact_backwards


@cache
def deflection_adjoint(features: Features) -> Any:
    """Adjoint of the predicted deflection by obstacles and the ground."""
    contact_backwards, last_contact = contact_adjoint(features), contact_function(features)

    @wp.func
    def deflection_backwards(
        t: Tables, working: Working, around: Neighborhood, start: wp.vec3, ahead: wp.vec3, predicted_velocity: wp.vec3,
        place_bar: wp.vec3, normal_bar: wp.vec3,
    ):  # fmt: skip
        """Return derivatives: of the velocity, that by the course."""
        bars = BarsOfContact()
        bars.point = place_bar
        bars.normal = normal_bar
        number = MOST_CONTACTS
        while number > 0:
            contact = last_contact(t, around, start, ahead, predicted_velocity, number, True, False)
            number = contact.number
            if number >= 0:
                more = contact_backwards(t, working, around, contact, bars.point, wp.vec3(), bars.normal)
                bars.point = more.point
                bars.velocity += more.velocity
                bars.start += more.start
                bars.height += more.height
                bars.friction += more.friction
                bars.normal = wp.vec3()
        return bars

    return deflection_backwards


def leave_obstacles_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of contact with obstacles and the ground."""
    column, friction_column = ground_columns(features)
    around_particle, solid_contact_backwards = around_function(features), solid_contact_adjoint(features)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def leave_adjoint(
        t: Tables, working: Working, params: Any, end: float, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3,
        velocity_bar: wp.vec3,
    ):  # fmt: skip
        params_bar = Params()
        bars = BarsOfContact()
        bars.point = point_bar
        bars.velocity = velocity_bar
        if params.mass > 0.0:
            bars = solid_contact_backwards(
                t, working, around_particle(params, end), point, velocity, point_bar, velocity_bar
            )
            params_bar.n[column] = bars.height
            params_bar.n[friction_column] = bars.friction
        return bars.point, bars.velocity, params_bar

    return (Adjoint(leave_adjoint, ("point", "velocity", "params")),)


def predict_deflection_by_obstacles_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of the predicted deflection."""
    column, friction_column = ground_columns(features)
    around_particle, deflection_backwards = around_function(features), deflection_adjoint(features)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def predict_deflection_adjoint(
        t: Tables, working: Working, params: Any, end: float, gain: float, point: wp.vec3, predicted_velocity: wp.vec3,
        deflection_bar: wp.vec3, away_bar: wp.vec3,
    ):  # fmt: skip
        params_bar = Params()
        by_point = wp.vec3()
        by_predicted_velocity = wp.vec3()
        if gain > 0.0:
            ahead = point + t.step_seconds * predicted_velocity
            by_displacement = deflection_bar / t.step_seconds
            bars = deflection_backwards(
                t, working, around_particle(params, end), point, ahead, predicted_velocity, by_displacement, away_bar
            )
            by_point = bars.start + (bars.point - by_displacement)
            by_predicted_velocity = bars.velocity + t.step_seconds * (bars.point - by_displacement)
            params_bar.n[column] = bars.height
            params_bar.n[friction_column] = bars.friction
        return by_point, by_predicted_velocity, params_bar

    return (Adjoint(predict_deflection_adjoint, ("point", "predicted_velocity", "params")),)


def leave_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of contact with solids."""
    require_no_bodies(features)
    if features.impulses:
        return leave_or_wait_backwards(features, access)
    if features.spheres:
        return leave_spheres_and_more_backwards(features, access)
    back = leave_obstacles_backwards if features.may_touch_obstacles else leave_ground_backwards
    return back(phase, features, access)


def predict_deflection_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of the predicted deflection by solids."""
    require_no_bodies(features)
    if features.spheres:
        return predict_deflection_by_spheres_and_more_backwards(features, access)
    back = (
        predict_deflection_by_obstacles_backwards
        if features.may_touch_obstacles
        else predict_deflection_by_ground_backwards
    )
    return back(phase, features, access)


def require_no_bodies(features: Features) -> None:
    """Check that all that particles leave has an adjoint.

    Raises:
        NoAdjointError: it has not.
    """
    if features.bodies:
        raise NoAdjointError("free bodies")


@wp.func
def ground_contact_backwards(
    t: Tables, working: Working, around: Neighborhood, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3,
    velocity_bar: wp.vec3,
):  # fmt: skip
    """Adjoint of contact with the ground alone: bars of a particle's state before it."""
    return ground_backwards(t, around, point, velocity, point_bar, velocity_bar)


@wp.func
def deflection_by_ground_alone_backwards(
    t: Tables, working: Working, around: Neighborhood, start: wp.vec3, ahead: wp.vec3, predicted_velocity: wp.vec3,
    place_bar: wp.vec3, normal_bar: wp.vec3,
):  # fmt: skip
    """Adjoint of the deflection by the ground alone: bars of the predicted place."""
    return deflection_by_ground_backwards(t, around, start, ahead, predicted_velocity, place_bar, normal_bar)


@wp.func
def fly_backwards(
    t: Tables, working: Working, around: Neighborhood, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3,
    velocity_bar: wp.vec3,
):  # fmt: skip
    """Return the bars of a particle that meets nothing."""
    bars = BarsOfContact()
    bars.point = point_bar
    bars.velocity = velocity_bar
    return bars


@wp.func
def no_deflection_backwards(
    t: Tables, working: Working, around: Neighborhood, start: wp.vec3, ahead: wp.vec3, predicted_velocity: wp.vec3,
    place_bar: wp.vec3, normal_bar: wp.vec3,
):  # fmt: skip
    """Return the bars of a place ahead, where there is nothing."""
    bars = BarsOfContact()
    bars.point = place_bar
    bars.normal = normal_bar
    return bars


@cache
def solid_contact_adjoints(features: Features) -> tuple[Any, Any]:
    """Adjoints of contact with obstacles and the ground, and of its prediction."""
    if features.may_touch_obstacles:
        return solid_contact_adjoint(features), deflection_adjoint(features)
    if features.ground:
        return ground_contact_backwards, deflection_by_ground_alone_backwards

    return fly_backwards, no_deflection_backwards


def leave_spheres_and_more_backwards(features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of contact with spheres, then with obstacles and the ground."""
    column, friction_column = ground_columns(features)
    around_particle, solid_contact_backwards = around_function(features), solid_contact_adjoints(features)[0]
    past_spheres = past_spheres_function(access.sphere_at)
    leave_spheres_backwards = leaving_spheres_adjoint(features, access.sphere_at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def leave_adjoint(
        t: Tables, spheres: Any, working: Working, params: Any, end: float, point: wp.vec3, velocity: wp.vec3,
        inflation: wp.vec3, point_bar: wp.vec3, velocity_bar: wp.vec3,
    ):  # fmt: skip
        params_bar = Params()
        if params.mass <= 0.0:
            return point_bar, velocity_bar, wp.vec3(), params_bar
        out, after, _met = past_spheres(t, spheres, params.world, t.spheres.numbers.shape[1], point, velocity)
        stood = solid_contact_backwards(t, working, around_particle(params, end), out, after, point_bar, velocity_bar)
        params_bar.n[column] = stood.height
        params_bar.n[friction_column] = stood.friction
        bars = leave_spheres_backwards(
            t, spheres, working, params.world, params.number, point, velocity, inflation, stood.point, stood.velocity
        )
        return bars.point, bars.velocity, bars.inflation, params_bar

    return (Adjoint(leave_adjoint, ("point", "velocity", "inflation", "params")),)


def leave_or_wait_backwards(features: Features, access: Access) -> Sequence[Adjoint]:
    """Return the adjoint of leaving obstacles and the ground, unless a particle is near a sphere: then it waits."""
    column, friction_column = ground_columns(features)
    around_particle, solid_contact_backwards = around_function(features), solid_contact_adjoints(features)[0]
    sphere_at = access.sphere_at
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def leave_adjoint(
        t: Tables, spheres: Any, working: Working, params: Any, end: float, point: wp.vec3, velocity: wp.vec3,
        point_bar: wp.vec3, velocity_bar: wp.vec3,
    ):  # fmt: skip
        params_bar = Params()
        waits = params.mass <= 0.0
        for sphere in range(t.spheres.numbers.shape[1]):
            center, motion, radius = sphere_at(t, spheres, params.world, sphere)
            waits = waits or is_near_sphere(t, center, motion, radius, point, velocity)
        if waits:
            return point_bar, velocity_bar, params_bar
        stood = solid_contact_backwards(
            t, working, around_particle(params, end), point, velocity, point_bar, velocity_bar
        )
        params_bar.n[column] = stood.height
        params_bar.n[friction_column] = stood.friction
        return stood.point, stood.velocity, params_bar

    return (Adjoint(leave_adjoint, ("point", "velocity", "params")),)


def predict_deflection_by_spheres_and_more_backwards(features: Features, access: Access) -> Sequence[Adjoint]:
    """Adjoint of the predicted deflection by spheres, then by obstacles and the ground."""
    column, friction_column = ground_columns(features)
    around_particle, deflection_backwards = around_function(features), solid_contact_adjoints(features)[1]
    past_spheres = past_spheres_function(access.sphere_at)
    predict_deflection_by_spheres_backwards = predicted_spheres_adjoint(features, access.sphere_at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def predict_deflection_adjoint(
        t: Tables, spheres: Any, working: Working, params: Any, end: float, gain: float, point: wp.vec3,
        predicted_velocity: wp.vec3, deflection_bar: wp.vec3, away_bar: wp.vec3,
    ):  # fmt: skip
        params_bar = Params()
        by_point = wp.vec3()
        by_predicted_velocity = wp.vec3()
        if gain > 0.0:
            ahead = point + t.step_seconds * predicted_velocity
            outside, _after, _met = past_spheres(t, spheres, params.world, t.spheres.numbers.shape[1], ahead, wp.vec3())
            by_displacement = deflection_bar / t.step_seconds
            stood = deflection_backwards(
                t, working, around_particle(params, end), point, outside, predicted_velocity, by_displacement, away_bar
            )
            by_ahead = predict_deflection_by_spheres_backwards(
                t, spheres, working, params.world, params.number, ahead, stood.point, stood.normal
            )
            by_point = stood.start + (by_ahead - by_displacement)
            by_predicted_velocity = stood.velocity + t.step_seconds * (by_ahead - by_displacement)
            params_bar.n[column] = stood.height
            params_bar.n[friction_column] = stood.friction
        return by_point, by_predicted_velocity, params_bar

    return (Adjoint(predict_deflection_adjoint, ("point", "predicted_velocity", "params")),)

"""Adjoints of contact with obstacles, and with the ground beside them.

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

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.adjoints.contacts import MOST_CONTACTS, contact_function
from balloon_warp.kernels.adjoints.ground import ground_columns
from balloon_warp.kernels.adjoints.one_contact import BarsOfContact, contact_adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.fixtures import SEVERAL, Around
from balloon_warp.kernels.loops.obstacles import around_function
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


@cache
def standing_adjoint(features: Features) -> Any:
    """Return the function that runs backwards how a particle leaves obstacles and the ground."""
    contact_backwards, last_contact = contact_adjoint(features), contact_function(features)

    @wp.func
    def stand_backwards(
        t: Tables, working: Working, around: Around, point: wp.vec3, velocity: wp.vec3, point_bar: wp.vec3,
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

    return stand_backwards


@cache
def detour_adjoint(features: Features) -> Any:
    """Return the function that runs backwards where obstacles and the ground will let a particle go."""
    contact_backwards, last_contact = contact_adjoint(features), contact_function(features)

    @wp.func
    def detour_backwards(
        t: Tables, working: Working, around: Around, start: wp.vec3, ahead: wp.vec3, course: wp.vec3,
        place_bar: wp.vec3, normal_bar: wp.vec3,
    ):  # fmt: skip
        """Return derivatives: of the velocity, that by the course."""
        bars = BarsOfContact()
        bars.point = place_bar
        bars.normal = normal_bar
        number = MOST_CONTACTS
        while number > 0:
            contact = last_contact(t, around, start, ahead, course, number, True, False)
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

    return detour_backwards


def leave_obstacles_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of leaving obstacles and the ground."""
    column, friction_column = ground_columns(features)
    around_particle, stand_backwards = around_function(features), standing_adjoint(features)
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
            bars = stand_backwards(t, working, around_particle(params, end), point, velocity, point_bar, velocity_bar)
            params_bar.n[column] = bars.height
            params_bar.n[friction_column] = bars.friction
        return bars.point, bars.velocity, params_bar

    return (Adjoint(leave_adjoint, ("point", "velocity", "params")),)


def foresee_obstacles_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of the deflection that a particle will meet."""
    column, friction_column = ground_columns(features)
    around_particle, detour_backwards = around_function(features), detour_adjoint(features)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def foresee_adjoint(
        t: Tables, working: Working, params: Any, end: float, gain: float, point: wp.vec3, course: wp.vec3,
        detour_bar: wp.vec3, away_bar: wp.vec3,
    ):  # fmt: skip
        params_bar = Params()
        by_point = wp.vec3()
        by_course = wp.vec3()
        if gain > 0.0:
            ahead = point + t.step_seconds * course
            by_way = detour_bar / t.step_seconds
            bars = detour_backwards(t, working, around_particle(params, end), point, ahead, course, by_way, away_bar)
            by_point = bars.start + (bars.point - by_way)
            by_course = bars.velocity + t.step_seconds * (bars.point - by_way)
            params_bar.n[column] = bars.height
            params_bar.n[friction_column] = bars.friction
        return by_point, by_course, params_bar

    return (Adjoint(foresee_adjoint, ("point", "course", "params")),)

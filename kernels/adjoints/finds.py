"""Adjoints of how contacts are found as a substep begins, a kind after the other, which Warp derives."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.contact_works import worth_of_contact
from balloon_warp.kernels.adjoints.sweeps import ContactBars, SweepBack
from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.contact.edges import edge_contact, particle_contact
from balloon_warp.kernels.contact.ends import four_of
from balloon_warp.kernels.contact.kinds import AT_LAST, BESIDE_RIDGES
from balloon_warp.kernels.contact.ridge_poses import Placed, placing_function
from balloon_warp.kernels.contact.ridge_search import seen_from
from balloon_warp.kernels.contact.ridges import ridge_contact
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import FOUR, Ridge
from balloon_warp.kernels.loops.fixtures import friction_of_balloons
from balloon_warp.kernels.loops.meeting import skin_functions
from balloon_warp.kernels.phase import Adjoint, Look, NoAdjointError, Phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working


def swept_backwards(phase: Phase, features: Features, look: Look) -> tuple[Adjoint, ...]:
    """Return no adjoint of a phase of sweeps: a kernel of its own runs them backwards.

    Raises:
        NoAdjointError: contacts push free bodies, too.
    """
    if features.bodies:
        raise NoAdjointError("free bodies")
    return ()


@wp.func
def work_of_edges(points: FOUR, moving: FOUR, thickness: float, friction: float, step_seconds: float, by: Contact):
    """Return a contact of two edges as a substep begins, times the derivatives by it."""
    contact = edge_contact(points - step_seconds * moving, thickness, friction)
    return worth_of_contact(contact, by) + contact.friction * by.friction


@wp.func
def work_of_particle(points: FOUR, moving: FOUR, thickness: float, step_seconds: float, by: Contact):
    """Return a contact of a triangle and a particle as a substep begins, times the derivatives by it."""
    return worth_of_contact(particle_contact(points - step_seconds * moving, thickness), by)


@cache
def edges_found(features: Features) -> Any:
    """Return the adjoint of finding a contact of edges."""
    thickness_between, _ = skin_functions(features)

    @wp.func
    def find_back(
        t: Tables, state: WorldState, working: Working, world: wp.int32, contact: Contact, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], by: Contact,
    ):  # fmt: skip
        first = t.particles.balloon[contact.ends[0]]
        last = t.particles.balloon[contact.ends[3]]
        skin = thickness_between(t, world, first, last)
        places = four_of(points, contact.ends)
        moving = four_of(velocities, contact.ends)
        found = ContactBars()
        if working.edge_pairs[world, contact.pair][0] < 0:
            of_points, of_moving, of_thickness, _seconds, _worth = wp.grad(work_of_particle)(
                places, moving, skin, t.step_seconds, by
            )
            found.points = of_points
            found.moving = of_moving
            found.thickness = of_thickness
        else:
            by_points, by_moving, by_thickness, by_friction, _step, _by = wp.grad(work_of_edges)(
                places, moving, skin, friction_of_balloons(t, world, first, last), t.step_seconds, by
            )
            found.points = by_points
            found.moving = by_moving
            found.thickness = by_thickness
            found.friction = by_friction
        return found

    return find_back


@wp.func
def work_of_ridge(
    points: FOUR, moving: FOUR, placed: Placed, ridge: Ridge, feature: wp.vec4i, step_seconds: float, by: Contact
):
    """Return a contact of a feature and a ridge as a substep begins, times the derivatives by it."""
    starts = points - step_seconds * moving
    contact = ridge_contact(
        placed, ridge, feature, seen_from(placed, starts[0]), seen_from(placed, starts[1]), seen_from(placed, starts[2])
    )
    return worth_of_contact(contact, by)


@cache
def ridges_found(features: Features) -> Any:
    """Return the adjoint of finding a contact with a ridge."""
    place_of = placing_function(features)

    @wp.func
    def find_back(
        t: Tables, state: WorldState, working: Working, world: wp.int32, contact: Contact, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], by: Contact,
    ):  # fmt: skip
        pair = working.ridge_pairs[world, contact.pair]
        placed = place_of(t, state, working, world, contact.solid, end)
        by_points, by_moving, by_placed, _ridge, _feature, _step, _by = wp.grad(work_of_ridge)(
            four_of(points, contact.ends), four_of(velocities, contact.ends), placed, t.ridges.ridges[pair[1]],
            t.ridges.features[pair[0]], t.step_seconds, by,
        )  # fmt: skip
        found = ContactBars()
        found.points = by_points
        found.moving = by_moving
        found.ball.start = by_placed.center
        found.ball.radius = by_placed.radius
        return found

    return find_back


EDGES_BACK, RIDGES_BACK = SweepBack(AT_LAST, edges_found), SweepBack(BESIDE_RIDGES, ridges_found)
"""Sweeps that run backwards"""

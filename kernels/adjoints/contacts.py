"""Contacts of a particle with obstacles and the ground in a substep, one after the other, found again."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import leave_ground, stand_on
from balloon_warp.kernels.laws.fixture import FAR_AWAY, MOST_TURNS, is_settled
from balloon_warp.kernels.loops.fixture_looks import SURELY
from balloon_warp.kernels.loops.fixtures import (
    NOBODY,
    ON_GROUND,
    Around,
    Meeting,
    meeting_function,
    with_another,
)
from balloon_warp.kernels.loops.friction import GROUND, friction_on, number_of_obstacle
from balloon_warp.kernels.tables import Tables

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
    met: Meeting
    friction: float
    at_once: bool  # whether it stops all of an approach, see `stand_on`
    partner: wp.int32  # of all contacts so far, see `with_another`


@cache
def contact_function(features: Features) -> Any:
    """Return the function that finds the contacts of a particle in a substep, one after the other."""
    meet = meeting_function(features)

    @wp.func
    def last_contact(
        t: Tables, around: Around, start: wp.vec3, end: wp.vec3, course: wp.vec3, before: wp.int32, foreseen: bool,
        at_once: bool,
    ):  # fmt: skip
        """Return the last contact of a particle before that of a number, see `loops.obstacles`.

        Args:
            foreseen: whether contacts are those of `detour_function`, in one turn at one velocity.
            at_once: whether contacts stop all of an approach.
        """
        found = Contact()
        found.number = -1
        found.start = start
        found.at_once = at_once
        h = t.step_seconds
        point = end
        velocity = course
        found.partner = NOBODY
        seen = wp.int32(0)
        turns = wp.int32(0)
        while turns < wp.where(foreseen, 1, MOST_TURNS):
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
                    stood, slowed = stand_on(
                        point, met.let, velocity, met.moving, met.normal, friction, h, once, met.part
                    )
                    point = stood
                    velocity = wp.where(foreseen, course, slowed)
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
                    velocity = wp.where(foreseen, course, slowed)
            if seen >= before or not again or is_settled(start, came, point):
                turns = MOST_TURNS
        return found

    return last_contact

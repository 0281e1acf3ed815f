"""Contacts of free rigid bodies: a list of their points near other things, in a world and a step."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.grip import Grip, clear_gap
from balloon_warp.kernels.laws.rigid import carried_along
from balloon_warp.kernels.loops.friction import friction_between
from balloon_warp.kernels.loops.nearest import Thing, thing_functions
from balloon_warp.kernels.loops.settling import ease_at
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working

LOOKED_AHEAD = wp.constant(1.5)
"""Distance ahead at which contacts are listed, in steps of the current speed"""


@wp.func
def speed_of(t: Tables, state: WorldState, working: Working, world: wp.int32, body: wp.int32, pull: float):
    """Return the largest speed of a point of a body after gravity has acted [m/s]."""
    spin = working.body_eases[world, body] * wp.vec3d(state.body_momenta[world, body])
    speed = wp.length(state.body_velocities[world, body]) + float(wp.length(spin)) * t.bodies.solids[body].reach
    return speed + t.step_seconds * wp.abs(pull)


@wp.func
def last_impulse(touches: wp.array[wp.int32], impulses: wp.array[wp.vec3d], key: wp.int32, place: wp.int32):
    """Return the warm start of a point: its impulse in the previous step [N s], zero without contact then.

    Also the place in that step's list at which to look for the next point.
    """
    while place < touches.shape[0] and touches[place] >= 0:
        found = touches[place]
        if found >= key:
            return wp.where(found == key, impulses[place], wp.vec3d()), place
        place += 1
    return wp.vec3d(), place


@wp.func
def end_of_samples(t: Tables, body: wp.int32, thing: Thing):
    """Return the end of those of a body's samples that a thing may touch."""
    ends = t.bodies.sample_ends[body]
    if thing.other >= 0:
        return ends[2]
    return wp.where(thing.fixture >= 0, ends[3], ends[1])


@wp.func
def hold_point(
    state: WorldState,
    working: Working,
    world: wp.int32,
    own: Thing,
    thing: Thing,
    key: wp.int32,
    point: wp.vec3,
    normal: wp.vec3,
    gap: float,
    places: wp.vec2i,
    step_seconds: float,
):
    """Append a point at which a body touches a thing to the list.

    Args:
        own: Index of the body.
        places: Length of the list, and place to look at in that of the previous step.
    """
    grip = Grip()
    grip.key = key
    grip.body = own.other
    grip.other = thing.other
    grip.normal = normal
    grip.arm = point - own.center
    grip.other_arm = point - thing.center
    center_arm = own.center - thing.center
    grip.moving = carried_along(thing.velocity, thing.spin, center_arm, grip.arm, normal, step_seconds)
    grip.gap = clear_gap(gap, own.reach, own.center)
    grip.ease = ease_at(working, world, grip, normal)
    grip.friction = thing.friction
    grip.restitution = wp.sqrt(own.restitution * thing.restitution)
    impulse, place = last_impulse(state.body_touches[world], state.body_impulses[world], key, places[1])
    grip.impulse = impulse
    working.grips[world, places[0]] = grip
    return wp.vec2i(places[0] + 1, place)


@cache
def thing_holding_function(features: Features) -> Any:
    """Make the function that puts a body and one thing into the list."""
    _, _, _, gap_to = thing_functions(features)

    @wp.func
    def hold_thing(
        t: Tables,
        state: WorldState,
        working: Working,
        world: wp.int32,
        own: Thing,
        thing: Thing,
        first_key: wp.int32,
        within: float,
        places: wp.vec2i,
    ):
        """Append the points at which a body is near a thing: its own points, and then those of an obstacle.

        Args:
            own: Index of the body.
            first_key: Key of the body's first point there.
            within: Distance beyond which there is no contact [m].
            places: As in `hold_point`.
        """
        first = t.bodies.sample_ends[own.other][0]
        count = end_of_samples(t, own.other, thing) - first
        all_points = count
        if wp.static(features.fixtures):
            if thing.fixture >= 0:
                all_points += t.fixtures.sample_ends[thing.fixture][1] - t.fixtures.sample_ends[thing.fixture][0]
        for number in range(all_points):
            bearer = own
            met = thing
            side = float(1.0)
            told = t.bodies.samples[first + wp.min(number, count - 1)]
            if wp.static(features.fixtures):
                if number >= count:  # a point of the obstacle, at the body
                    bearer = thing
                    met = own
                    side = -1.0
                    told = t.fixtures.samples[t.fixtures.sample_ends[thing.fixture][0] + number - count]
            point = bearer.center + wp.quat_rotate(bearer.turn, wp.vec3(told[0], told[1], told[2]))
            gap, normal = gap_to(t, met, point, told[3], within)
            if gap < within and places[0] < working.grips.shape[1]:
                point -= told[3] * normal
                places = hold_point(
                    state, working, world, own, thing, first_key + number, point, side * normal, gap, places,
                    t.step_seconds,
                )  # fmt: skip
        return places

    return hold_thing


@cache
def holding_function(features: Features) -> Any:
    """Make the function that makes the list."""
    count_of, body_in, thing_at, _ = thing_functions(features)
    hold_thing = thing_holding_function(features)

    @wp.func
    def take_hold(t: Tables, state: WorldState, working: Working, world: wp.int32, begin: float, pull: float):
        """List the contacts in a step that begins at a time in the frame, and return their number."""
        bodies = state.body_positions.shape[1]
        things = count_of(t, state)
        fastest = t.fixtures.fastest
        most = wp.int32(0)
        for body in range(bodies):
            fastest = wp.max(fastest, speed_of(t, state, working, world, body, pull))
            most = wp.max(most, t.bodies.sample_ends[body][3] - t.bodies.sample_ends[body][0])
        if wp.static(features.fixtures):
            most += t.fixtures.samples.shape[0]
        places = wp.vec2i(0, 0)
        for body in range(bodies):
            own = body_in(t, state, world, body)
            within = LOOKED_AHEAD * t.step_seconds * (speed_of(t, state, working, world, body, pull) + fastest)
            for number in range(things):
                thing = thing_at(t, state, world, number, begin)
                if thing.other != body:
                    away = wp.length(own.center - thing.center)
                    if thing.fixture < 0 and thing.other < 0:
                        away = wp.dot(own.center - thing.center, t.up)
                    if away - own.reach - thing.reach < within:
                        key = (body * things + number) * most
                        thing.friction = friction_between(t, world, own.number, thing.number)
                        places = hold_thing(t, state, working, world, own, thing, key, within, places)
        return places[0]

    return take_hold

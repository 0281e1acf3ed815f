"""Where free rigid bodies touch: a list of points of theirs at what is near, in a world and a step."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.contact import friction_between
from balloon_warp.kernels.laws.grip import Grip, clear_gap
from balloon_warp.kernels.loops.nearest import Thing, thing_functions
from balloon_warp.kernels.loops.settling import ease_at
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
from balloon_warp.kernels.traits import Traits

LOOKED_AHEAD = wp.constant(1.5)
"""steps, as things move before they touch"""


@wp.func
def speed_of(t: Tables, state: WorldState, working: Any, world: wp.int32, body: wp.int32, pull: float):
    """How fast a point of a body may be after gravity has acted [m/s]."""
    spin = working.body_eases[world, body] * wp.vec3d(state.body_momenta[world, body])
    speed = wp.length(state.body_velocities[world, body]) + float(wp.length(spin)) * t.bodies.solids.reaches[body]
    return speed + t.step_seconds * wp.abs(pull)


@wp.func
def last_impulse(state: WorldState, world: wp.int32, key: wp.int32, place: wp.int32):
    """What a point ended with in the step before [N s], zero if it touched nothing then; and where in the list of that
    step to look for the next."""
    while place < state.body_touches.shape[1] and state.body_touches[world, place] >= 0:
        found = state.body_touches[world, place]
        if found >= key:
            return wp.where(found == key, state.body_impulses[world, place], wp.vec3()), place
        place += 1
    return wp.vec3(), place


@wp.func
def end_of_samples(t: Tables, body: wp.int32, thing: Thing):
    """Of those of a body that a thing may touch, if any does."""
    ends = t.bodies.sample_ends[body]
    if thing.other >= 0:
        return ends[2]
    return wp.where(thing.fixture >= 0, ends[3], ends[1])


@cache
def holding_function(traits: Traits) -> Any:
    """The function that makes the list."""
    count_of, body_in, thing_at, gap_to = thing_functions(traits)

    @wp.func
    def hold_point(
        t: Tables,
        state: WorldState,
        working: Any,
        world: wp.int32,
        body: wp.int32,
        thing: Thing,
        key: wp.int32,
        point: wp.vec3,
        normal: wp.vec3,
        gap: float,
        places: wp.vec2i,
    ):
        """Put a point at which a body touches a thing into the list.

        Args:
            places: how long the list is, and where to look in that of the step before.
        """
        center = state.body_positions[world, body]
        grip = Grip()
        grip.key = key
        grip.body = body
        grip.other = thing.other
        grip.normal = normal
        grip.arm = point - center
        grip.other_arm = point - thing.center
        grip.moving = thing.velocity + wp.cross(thing.spin, grip.other_arm)
        grip.gap = clear_gap(gap, t.bodies.solids.reaches[body], center)
        grip.ease = ease_at(t, working, world, grip, normal)
        own = t.bodies.friction[row_of_world(world, t.bodies.friction.shape[0]), body]
        grip.friction = friction_between(own, thing.friction)
        own = t.bodies.restitution[row_of_world(world, t.bodies.restitution.shape[0]), body]
        grip.restitution = wp.sqrt(own * thing.restitution)
        impulse, place = last_impulse(state, world, key, places[1])
        grip.impulse = impulse
        working.grips[world, places[0]] = grip
        return wp.vec2i(places[0] + 1, place)

    @wp.func
    def hold_thing(
        t: Tables,
        state: WorldState,
        working: Any,
        world: wp.int32,
        body: wp.int32,
        thing: Thing,
        first_key: wp.int32,
        within: float,
        places: wp.vec2i,
    ):
        """Put the points at which a body is near a thing into the list: its own, and then those of an obstacle.

        Args:
            first_key: of the body's first point there.
            within: what is no nearer is not met [m].
            places: as in `hold_point`.
        """
        key = first_key
        center = state.body_positions[world, body]
        turn = state.body_turns[world, body]
        for sample in range(t.bodies.sample_ends[body][0], end_of_samples(t, body, thing)):
            told = t.bodies.samples[sample]
            point = center + wp.quat_rotate(turn, wp.vec3(told[0], told[1], told[2]))
            gap, normal = gap_to(t, thing, point, told[3], within)
            if gap < within and places[0] < working.grips.shape[1]:
                point -= told[3] * normal
                places = hold_point(t, state, working, world, body, thing, key, point, normal, gap, places)
            key += 1
        if wp.static(traits.fixtures):
            if thing.fixture >= 0:
                own = body_in(t, state, world, body)
                ends = t.fixtures.sample_ends[thing.fixture]
                for sample in range(ends[0], ends[1]):
                    told = t.fixtures.samples[sample]
                    point = thing.center + wp.quat_rotate(thing.turn, wp.vec3(told[0], told[1], told[2]))
                    gap, normal = gap_to(t, own, point, told[3], within)
                    if gap < within and places[0] < working.grips.shape[1]:
                        point -= told[3] * normal
                        places = hold_point(t, state, working, world, body, thing, key, point, -normal, gap, places)
                    key += 1
        return places

    @wp.func
    def take_hold(t: Tables, state: WorldState, working: Any, world: wp.int32, time: float, pull: float):
        """How many points touch something in a step that begins at a time."""
        bodies = state.body_positions.shape[1]
        things = count_of(t, state)
        fastest = t.fixtures.fastest
        most = wp.int32(0)
        for body in range(bodies):
            fastest = wp.max(fastest, speed_of(t, state, working, world, body, pull))
            most = wp.max(most, t.bodies.sample_ends[body][3] - t.bodies.sample_ends[body][0])
        if wp.static(traits.fixtures):
            most += t.fixtures.samples.shape[0]
        places = wp.vec2i(0, 0)
        for body in range(bodies):
            own = speed_of(t, state, working, world, body, pull)
            within = LOOKED_AHEAD * t.step_seconds * (own + fastest)
            for number in range(things):
                thing = thing_at(t, state, world, number, time)
                if thing.other != body:
                    away = wp.length(state.body_positions[world, body] - thing.center)
                    if thing.fixture < 0 and thing.other < 0:
                        away = wp.dot(state.body_positions[world, body] - thing.center, t.up)
                    if away - t.bodies.solids.reaches[body] - thing.reach < within:
                        key = (body * things + number) * most
                        places = hold_thing(t, state, working, world, body, thing, key, within, places)
        return places[0]

    return take_hold

"""Contacts of free rigid bodies: things that are near, points, rebounds, and impulses from sweep to sweep.

Impulses at all points at which free bodies touch, from sweep to sweep until they agree, see `laws.rigid`. They act on
how bodies move in working memory: as fast as they are, or as far as they are to be moved out of overlaps in a step of
one second. A light body between heavy ones gets large impulses from both sides, of which little is left: so they are in
float64.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.rigid import (
    Grip,
    carried_along,
    clear_gap,
    grip_impulse,
    max_sweeps,
    momentum_factor,
    push_share,
    rebound_share,
    sweep_has_converged,
    turned_by,
)
from balloon_warp.kernels.loops.fixtures import (
    GROUND,
    friction_between,
    number_of_body,
    number_of_obstacle,
    pose_function,
)
from balloon_warp.kernels.loops.paths import surface_function
from balloon_warp.kernels.tables import Solid, Tables, WorldState, row_of_world
from balloon_warp.kernels.working import Working


@wp.struct
class Thing:
    """Obstacle, body, sphere or ground, in a step."""

    fixture: wp.int32  # its number if it is an obstacle, or -1
    other: wp.int32  # its number if it is a body, or -1
    center: wp.vec3
    turn: wp.quat
    reach: float  # from there [m]
    solid: Solid  # of an obstacle or a body
    velocity: wp.vec3  # if it goes where it is told [m/s]
    spin: wp.vec3  # likewise [rad/s]
    number: wp.int32  # among all, as friction has it
    friction: float  # with the body that is near it
    restitution: float


@wp.func
def body_in(t: Tables, state: WorldState, world: wp.int32, body: wp.int32):
    """Return a body as a thing that bodies may touch."""
    thing = Thing()
    thing.fixture = -1
    thing.other = body
    thing.center = state.body_positions[world, body]
    thing.turn = state.body_turns[world, body]
    thing.solid = t.bodies.solids[body]
    thing.reach = thing.solid.reach
    thing.number = number_of_body(t, body)
    thing.restitution = t.bodies.restitution[row_of_world(world, t.bodies.restitution.shape[0]), body]
    return thing


@wp.func
def count_of(t: Tables, state: WorldState):
    """Return the number of things: the ground, obstacles and bodies."""
    return 1 + t.fixtures.solids.shape[0] + state.body_positions.shape[1]


@cache
def thing_functions(features: Features) -> tuple[Any, Any]:
    """Return functions for a thing, and for its distance to a point."""
    pose_at = pose_function(features) if features.fixtures else None
    surface_at = surface_function(features.body_meshes or features.fixture_meshes)
    split = features.columns.balloon_width
    height, ground_restitution = (
        features.columns.places[name] - split for name in ("ground_height", "ground_restitution")
    )

    @wp.func
    def thing_at(t: Tables, state: WorldState, world: wp.int32, number: wp.int32, begin: float):
        """Return a thing as it is and moves when a step begins at a time in the frame."""
        thing = Thing()
        thing.fixture = -1
        thing.other = number - 1
        if number == 0:
            row = row_of_world(world, t.world_numbers.shape[0])
            thing.reach = wp.where(wp.static(features.ground), wp.inf, -wp.inf)
            thing.center = t.world_numbers[row, height] * t.up
            thing.number = GROUND
            thing.restitution = t.world_numbers[row, ground_restitution]
        elif wp.static(features.fixtures):
            fixture = number - 1
            thing.other = fixture - t.fixtures.solids.shape[0]
            if thing.other < 0:
                pose = pose_at(t, world, fixture, begin + t.step_seconds)  # as the step ends, then back
                thing.fixture = fixture
                thing.other = -1
                thing.center = pose.center - t.step_seconds * pose.velocity
                thing.turn = turned_by(pose.turn, -t.step_seconds * pose.spin)
                thing.solid = t.fixtures.solids[fixture]
                thing.reach = thing.solid.reach
                thing.velocity = pose.velocity
                thing.spin = pose.spin
                thing.number = number_of_obstacle(fixture)
                row = row_of_world(world, t.fixtures.restitutions.shape[0])
                thing.restitution = t.fixtures.restitutions[row, fixture]
        if thing.other >= 0:
            thing = body_in(t, state, world, thing.other)
        return thing

    @wp.func
    def gap_to(t: Tables, thing: Thing, point: wp.vec3, radius: float, within: float):
        """Return the gap from a thing's surface to a point's [m], up to `within`, and the normal there."""
        arm = point - thing.center
        gap = wp.dot(arm, t.up) - radius
        normal = t.up
        if thing.other >= 0 or thing.fixture >= 0:
            gap = wp.length(arm) - thing.reach - radius
            if gap < within:
                place, farthest = wp.quat_rotate_inv(thing.turn, arm), within + radius + 0.1 * thing.reach
                distance, outward = surface_at(thing.solid, t.up, place, radius, farthest)
                gap = distance
                normal = wp.quat_rotate(thing.turn, outward)
        return gap, normal

    return thing_at, gap_to


@wp.func
def inverse_mass_of_point(working: Working, world: wp.int32, body: wp.int32, arm: wp.vec3, direction: wp.vec3):
    """Return the inverse effective mass of a body's point along a unit vector [1/kg]."""
    torque = wp.vec3d(wp.cross(arm, direction))
    return 1.0 / working.body_masses[world, body] + float(
        wp.dot(torque, working.body_inverse_inertias[world, body] * torque)
    )


@wp.func
def inverse_mass_at(working: Working, world: wp.int32, grip: Grip, direction: wp.vec3):
    """Return the inverse effective mass of a contact along a unit vector [1/kg]."""
    inverse_mass = inverse_mass_of_point(working, world, grip.body, grip.arm, direction)
    if grip.other >= 0:
        inverse_mass += inverse_mass_of_point(working, world, grip.other, grip.other_arm, direction)
    return inverse_mass


@wp.func
def speed_at(working: Working, world: wp.int32, body: wp.int32, arm: wp.vec3):
    """Return the velocity of a body's point [m/s]."""
    spin = working.body_inverse_inertias[world, body] * working.body_turning[world, body]
    return working.body_going[world, body] + wp.cross(spin, wp.vec3d(arm))


@wp.func
def relative_velocity_at(working: Working, world: wp.int32, grip: Grip):
    """Return the relative velocity at a contact [m/s]."""
    speed = speed_at(working, world, grip.body, grip.arm) - wp.vec3d(grip.moving)
    if grip.other >= 0:
        speed -= speed_at(working, world, grip.other, grip.other_arm)
    return speed


@wp.func
def tug_at(working: Working, world: wp.int32, grip: Grip):
    """Return the part of the relative velocity at a contact that strings add in this substep [m/s]."""
    tug = wp.vec3d()
    if working.body_tugs.shape[1] > 0:
        tug = tug_of(working, world, grip.body, grip.arm)
        if grip.other >= 0:
            tug -= tug_of(working, world, grip.other, grip.other_arm)
    return tug


@wp.func
def tug_of(working: Working, world: wp.int32, body: wp.int32, arm: wp.vec3):
    """Return the velocity of a body's point that strings add in this substep [m/s]."""
    spin = working.body_inverse_inertias[world, body] * wp.vec3d(working.body_twists[world, body])
    return wp.vec3d(working.body_tugs[world, body]) + wp.cross(spin, wp.vec3d(arm))


@wp.func
def along_normal(grip: Grip, velocity: wp.vec3d):
    """Return the part of a velocity along a contact's normal [m/s]."""
    return wp.dot(wp.vec3d(grip.normal), velocity)


@wp.func
def push(working: Working, world: wp.int32, body: wp.int32, arm: wp.vec3, impulse: wp.vec3d):
    """Apply an impulse at a body's point [N s]."""
    mass = wp.float64(working.body_masses[world, body])
    working.body_going[world, body] = working.body_going[world, body] + impulse / mass
    working.body_turning[world, body] = working.body_turning[world, body] + wp.cross(wp.vec3d(arm), impulse)


@wp.func
def push_apart(working: Working, world: wp.int32, grip: Grip, impulse: wp.vec3d):
    """Apply an impulse at a contact, and the opposite one on the other thing [N s]."""
    push(working, world, grip.body, grip.arm, impulse)
    if grip.other >= 0:
        push(working, world, grip.other, grip.other_arm, -impulse)


@wp.func
def added_at(working: Working, world: wp.int32, grip: Grip, beside: wp.vec3d, rubs: bool):
    """Return the increment of a contact's impulse for the current velocities [N s]."""
    across = grip.inverse_mass
    friction = float(0.0)
    if rubs:
        friction = grip.friction
        sliding = wp.vec3(beside - along_normal(grip, beside) * wp.vec3d(grip.normal))
        if wp.length_sq(sliding) > 0.0:
            across = inverse_mass_at(working, world, grip, wp.normalize(sliding))
    return grip_impulse(grip, beside, across, friction)


@wp.func
def settle(working: Working, world: wp.int32, count: wp.int32, rubs: bool, allowed: float, most: wp.int32):
    """Iterate the contact impulses of a world's list to convergence, and return the number of sweeps.

    Args:
        count: Number of contacts.
        rubs: Whether there is friction.
        allowed: Largest change of a speed in a sweep at convergence [m/s].
        most: Largest number of sweeps.
    """
    for number in range(count):
        grip = working.grips[world, number]
        push_apart(working, world, grip, grip.impulse)
        grip.ahead = wp.vec3d()
        working.grips[world, number] = grip
    sweeps = wp.int32(0)
    age = float(0.0)
    before = float(wp.inf)
    agreed = bool(False)
    while not agreed and sweeps < most:
        agreed = bool(True)
        along = float(0.0)
        changed = float(0.0)
        for number in range(count):
            grip = working.grips[world, number]
            beside = relative_velocity_at(working, world, grip)
            grip.added = added_at(working, world, grip, beside, rubs)
            grip.impulse += grip.added
            push_apart(working, world, grip, grip.added)
            agreed = agreed and sweep_has_converged(grip, allowed)
            along += grip.inverse_mass * float(wp.dot(grip.added, grip.ahead + grip.added))
            changed += grip.inverse_mass * float(wp.length_sq(grip.added))
            working.grips[world, number] = grip
        sweeps += 1
        age = wp.where(along < 0.0 or changed > 2.0 * before, 0.0, age + 1.0)
        before = changed
        if not agreed and sweeps < most:
            for number in range(count):
                grip = working.grips[world, number]
                grip.ahead = wp.float64(momentum_factor(age)) * (grip.ahead + grip.added)
                grip.impulse += grip.ahead
                push_apart(working, world, grip, grip.ahead)
                working.grips[world, number] = grip
    return sweeps


LOOKED_AHEAD = wp.constant(1.5)
"""Distance ahead at which contacts are listed, in steps of the current speed"""


@wp.func
def speed_of(t: Tables, state: WorldState, working: Working, world: wp.int32, body: wp.int32, pull: float):
    """Return the largest speed of a point of a body after gravity has acted [m/s]."""
    spin = working.body_inverse_inertias[world, body] * wp.vec3d(state.body_momenta[world, body])
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
def append_contact_point(
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
    grip.inverse_mass = inverse_mass_at(working, world, grip, normal)
    grip.friction = thing.friction
    grip.restitution = wp.sqrt(own.restitution * thing.restitution)
    impulse, place = last_impulse(state.body_touches[world], state.body_impulses[world], key, places[1])
    grip.impulse = impulse
    working.grips[world, places[0]] = grip
    return wp.vec2i(places[0] + 1, place)


@cache
def contacts_function(features: Features) -> Any:
    """Make the function that puts a body and one thing into the list."""
    _, gap_to = thing_functions(features)

    @wp.func
    def list_contacts(
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
            places: As in `append_contact_point`.
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
                places = append_contact_point(
                    state, working, world, own, thing, first_key + number, point, side * normal, gap, places,
                    t.step_seconds,
                )  # fmt: skip
        return places

    return list_contacts


@cache
def contact_list_function(features: Features) -> Any:
    """Make the function that makes the list."""
    thing_at, _ = thing_functions(features)
    list_contacts = contacts_function(features)

    @wp.func
    def list_body_contacts(t: Tables, state: WorldState, working: Working, world: wp.int32, begin: float, pull: float):
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
                        places = list_contacts(t, state, working, world, own, thing, key, within, places)
        return places[0]

    return list_body_contacts


NO_GAIN = wp.constant(wp.float64(1.0e-5))
"""Gain of energy that counts as none, over the work that contacts exchange"""
JAMMED = wp.constant(wp.float64(1.0e-2))
"""Gain of energy, over the work that contacts exchange, below which impulses that do not agree are so large that bodies
have jammed: they do without friction then, since that agrees, and without rebound"""
NOT, DOES, JAMS = (wp.constant(number) for number in range(3))
"""Whether contacts give energy, and whether bodies have jammed"""


@wp.func
def apply_gravity(t: Tables, state: WorldState, working: Working, world: wp.int32, pull: float):
    """Give all bodies the velocities that they have without contact, by a step of gravity [m/s^2]."""
    fallen = wp.vec3d((t.step_seconds * pull) * t.up)
    for body in range(state.body_positions.shape[1]):
        working.body_going[world, body] = wp.vec3d(state.body_velocities[world, body]) - fallen
        working.body_turning[world, body] = wp.vec3d(state.body_momenta[world, body])


@wp.func
def group_of(working: Working, world: wp.int32, body: wp.int32):
    """Return the least number of the bodies that touch a body, or that touch these."""
    while working.body_groups[world, body] != body:
        body = working.body_groups[world, body]
    return body


@wp.func
def find_groups(working: Working, world: wp.int32, count: wp.int32):
    """Group bodies that touch each other."""
    for body in range(working.body_groups.shape[1]):
        working.body_groups[world, body] = body
    for number in range(count):
        grip = working.grips[world, number]
        if grip.other >= 0:
            one = group_of(working, world, grip.body)
            other = group_of(working, world, grip.other)
            working.body_groups[world, wp.max(one, other)] = wp.min(one, other)


@wp.func
def work_of(impulse: wp.vec3d, before: wp.vec3d, after: wp.vec3d):
    """Return the work of an impulse at a contact, beside the surface that is met [J]."""
    return wp.float64(0.5) * wp.dot(impulse, before + after)


@wp.func
def gains_energy(working: Working, world: wp.int32, count: wp.int32, agrees: bool):
    """Return how contacts have given groups of bodies energy, which is noted: `NOT`, `DOES` or `JAMS`.

    Args:
        agrees: Whether impulses have converged.
    """
    least = wp.where(agrees, NO_GAIN, wp.float64(0.0))
    gains = wp.int32(NOT)
    find_groups(working, world, count)
    for body in range(working.body_groups.shape[1]):
        working.body_gains[world, body] = wp.vec4d()
    for number in range(count):
        grip = working.grips[world, number]
        group = group_of(working, world, grip.body)
        grip.rebound = grip.impulse
        grip.leaving = relative_velocity_at(working, world, grip)
        working.grips[world, number] = grip
        whole = work_of(grip.impulse, grip.before, grip.leaving)
        exchanged = wp.abs(work_of(grip.impulse, grip.before, wp.vec3d()))
        more = wp.vec4d(whole, exchanged, wp.float64(0.0), wp.float64(0.0))
        working.body_gains[world, group] = working.body_gains[world, group] + more
    for body in range(working.body_groups.shape[1]):
        found = working.body_gains[world, body]
        if found[0] > least * found[1]:
            gains = wp.max(gains, wp.where(agrees or found[0] > JAMMED * found[1], DOES, JAMS))
    return gains


@wp.func
def swap_least(working: Working, world: wp.int32, number: wp.int32):
    """Ask a contact for no rebound, or for the one that it was asked for before."""
    grip = working.grips[world, number]
    least = grip.least
    grip.least = grip.closing
    grip.closing = least
    working.grips[world, number] = grip


@wp.func
def push_less(working: Working, world: wp.int32, count: wp.int32, jams: bool, fallen: wp.vec3):
    """Set impulses between those without rebound, which act, and those with, so that no group gains energy.

    Args:
        jams: Whether a group takes all of those with rebounds, or none.
        fallen: Change of velocity by a step of gravity, downward positive [m/s].
    """
    for body in range(working.body_groups.shape[1]):
        whole = working.body_gains[world, body][0]
        working.body_gains[world, body] = wp.vec4d(whole, wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    for number in range(count):
        grip = working.grips[world, number]
        group = group_of(working, world, grip.body)
        now = relative_velocity_at(working, world, grip)
        free = grip.before + tug_at(working, world, grip)
        if grip.other < 0:
            free -= wp.vec3d(fallen)
        without = work_of(grip.impulse, grip.before, now)
        curve = work_of(grip.rebound - grip.impulse, grip.leaving, -now)
        more = wp.vec4d(wp.float64(0.0), without, curve, work_of(grip.impulse, grip.before, free))
        working.body_gains[world, group] = working.body_gains[world, group] + more
    for number in range(count):
        grip = working.grips[world, number]
        gains = working.body_gains[world, group_of(working, world, grip.body)]
        share = rebound_share(gains[1], gains[0], gains[2])
        if jams and gains[0] > wp.float64(0.0):
            share = wp.float64(0.0)
        grip.impulse += share * (grip.rebound - grip.impulse)
        grip.impulse *= push_share(gains[1], gains[3])
        working.grips[world, number] = grip


@wp.func
def apply_contact_impulses(
    t: Tables, state: WorldState, working: Working, world: wp.int32, count: wp.int32, pull: float, allowed: float
):
    """Set velocities of bodies after gravity [m/s^2] and all contacts of the list.

    Args:
        allowed: Largest change of a speed in a sweep at convergence [m/s].
    """
    apply_gravity(t, state, working, world, pull)
    agrees = settle(working, world, count, True, allowed, max_sweeps(count)) < max_sweeps(count)
    rebounds = bool(False)
    for number in range(count):
        rebounds = rebounds or working.grips[world, number].least > 0.0
    if rebounds or not agrees:
        gains = gains_energy(working, world, count, agrees)
        if gains != NOT:
            if rebounds:
                for number in range(count):
                    swap_least(working, world, number)
                    grip = working.grips[world, number]
                    grip.impulse = state.body_impulses[world, number]
                    working.grips[world, number] = grip
                apply_gravity(t, state, working, world, pull)
                settle(working, world, count, gains != JAMS, allowed, max_sweeps(count))
                for number in range(count):
                    swap_least(working, world, number)
            push_less(working, world, count, gains == JAMS, (t.step_seconds * pull) * t.up)
            apply_gravity(t, state, working, world, pull)
            for number in range(count):
                push_apart(working, world, working.grips[world, number], working.grips[world, number].impulse)

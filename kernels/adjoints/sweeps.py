"""Adjoint of sweeps over contacts, a block a world: the same for every kind.

Warp derives one contact of the functions of all kinds, see `contact.contact`. Frozen is which features they are, and
whether they come too near.

A substep's sweeps are done again, and the velocities before each are kept. Then the sweeps run backwards: each adds the
gains by its impulses to velocities, so that the derivatives by its inputs add up; those by the contacts themselves are
summed over sweeps, and come back to places and velocities last. All adds up exactly, see `adjoints.sums`.

The ground stops particles that contacts push into it: how is noted in each sweep. Frozen is which particles it stops,
and whether it takes all of their speed.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.spheres import (
    KINDS_OF_BALLS,
    BallShare,
    BarsOfSpheres,
    add_ball,
    keep_balls,
    note_ball,
    restore_balls,
    take_ball,
)
from balloon_warp.kernels.adjoints.sums import (
    OF_INVERSE_MASSES,
    OF_PLACES,
    OF_VELOCITIES,
    add_exactly,
    add_to_sums,
    mass_adjoint_function,
    note_size,
    parts_per_unit,
    sum_at,
    take_sums,
)
from balloon_warp.kernels.contact.contact import (
    BALL,
    Bearing,
    Contact,
    ContactImpulses,
    Motion,
    on_end,
    resolving_functions,
)
from balloon_warp.kernels.contact.edges import edge_contact, particle_contact
from balloon_warp.kernels.contact.ends import (
    bearing_function,
    four_of,
    gains_of_ball_function,
    mover_of,
    stop_by_ground,
)
from balloon_warp.kernels.contact.kind import MARKED, Sweep, sweep_listing
from balloon_warp.kernels.contact.ridges import Placed, placing_function, ridge_contact, seen_from, sphere_of
from balloon_warp.kernels.contact.sweeps import AT_LAST, BESIDE_RIDGES, marking_functions, pushing_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.touch import FOUR, Ridge
from balloon_warp.kernels.loops.contact import skin_functions
from balloon_warp.kernels.loops.fixtures import friction_of_balloons
from balloon_warp.kernels.phase import Access, Adjoint, NoAdjointError, Phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_block, block_barrier
from balloon_warp.kernels.working import Working


@cache
def contact_pairings(features: Features) -> tuple[Any, Any]:
    """Pairings of all ends' gains by a push, and by a separation, with their bars."""
    relative_of, impulses_of, parting_of = resolving_functions(features)
    gains_of_ball = gains_of_ball_function(features)

    @wp.func
    def impulses_pairing(
        contact: Contact, bearing: Bearing, impulses: ContactImpulses, gain_bars: FOUR, of_solid: Motion
    ):
        pairing = float(0.0)
        pairing += bearing.inverse_masses[0] * wp.dot(on_end(contact, impulses, 0), gain_bars[0])
        pairing += bearing.inverse_masses[1] * wp.dot(on_end(contact, impulses, 1), gain_bars[1])
        pairing += bearing.inverse_masses[2] * wp.dot(on_end(contact, impulses, 2), gain_bars[2])
        pairing += bearing.inverse_masses[3] * wp.dot(on_end(contact, impulses, 3), gain_bars[3])
        if wp.static(features.round_ridges):
            if bearing.kind == BALL:
                torque = wp.cross(contact.arm, -impulses.impulse)
                gains = gains_of_ball(bearing.mass, bearing.radius, -impulses.impulse, torque)
                pairing += wp.dot(gains.velocity, of_solid.velocity) + wp.dot(gains.spin, of_solid.spin)
        return pairing

    @wp.func
    def push_pairing(
        contact: Contact, moving: FOUR, solid: Motion, bearing: Bearing, step_seconds: float, gain_bars: FOUR,
        of_solid: Motion,
    ):  # fmt: skip
        relative = relative_of(contact, moving, bearing.kind, solid)
        impulses = impulses_of(contact, bearing, moving, relative, step_seconds)
        return impulses_pairing(contact, bearing, impulses, gain_bars, of_solid)

    @wp.func
    def parting_pairing(contact: Contact, bearing: Bearing, gain_bars: FOUR, of_solid: Motion):
        return impulses_pairing(contact, bearing, parting_of(contact, bearing), gain_bars, of_solid)

    return push_pairing, parting_pairing


@wp.func
def contact_pairing(contact: Contact, by: Contact):
    """Pairing of a contact's numbers with their bars."""
    found = wp.dot(contact.weights, by.weights) + wp.dot(contact.normal, by.normal) + contact.gap * by.gap
    found += contact.kept * by.kept + contact.overlap * by.overlap + wp.dot(contact.couple, by.couple)
    found += wp.dot(contact.other_couple, by.other_couple)
    return found + wp.dot(contact.arm, by.arm) + wp.dot(contact.moving, by.moving)


@wp.func
def sum_of_contacts(one: Contact, other: Contact):
    """Sum of two contacts' bars."""
    total = Contact()
    total.weights = one.weights + other.weights
    total.normal = one.normal + other.normal
    total.gap = one.gap + other.gap
    total.kept = one.kept + other.kept
    total.overlap = one.overlap + other.overlap
    total.friction = one.friction + other.friction
    total.couple = one.couple + other.couple
    total.other_couple = one.other_couple + other.other_couple
    total.arm = one.arm + other.arm
    total.moving = one.moving + other.moving
    return total


OF_FRICTION, OF_THICKNESS = (wp.constant(3 + KINDS_OF_BALLS + kind) for kind in range(2))
KINDS = 5 + KINDS_OF_BALLS
"""Number of kinds of sums, see `adjoints.sums` and `adjoints.spheres`; the last are of pairs of balloons"""


@wp.struct
class SweepBars:
    """Derivatives by the inputs and results of sweeps over contacts, and the records of a substep."""

    points: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    inverse_masses: wp.array2d[float]
    """Derivatives by the inverse mass of each particle"""
    gas_masses: wp.array2d[float]
    numbers: wp.array3d[float]
    listed_contacts: wp.array2d[Contact]
    """Derivatives by each contact, summed over sweeps"""
    sweep_velocities: wp.array3d[wp.vec3]
    """Velocities before each sweep, shape (sweeps, W, P)"""
    rises: wp.array3d[float]
    """Heights by which the ground raises particles in each sweep, and as features part [m], shape (sweeps + 1, W, P)"""
    falls: wp.array3d[float]
    """Upward speeds of those, 0 where they rise [m/s]"""
    sums: wp.array3d[wp.int64]
    pairs: wp.array3d[wp.int64]
    """Sums by friction and thickness of each pair of balloons, shape (W, B^2, 2); empty where balloons meet solids"""
    largest: wp.array2d[float]
    totals: wp.array3d[wp.vec3d]
    """Sums by stiffness, friction and thickness between balloons, since they were last taken"""
    spheres: BarsOfSpheres
    ball_velocities: wp.array3d[wp.vec3]
    """Velocities of spheres before each sweep, shape (sweeps, W, S)"""
    ball_spins: wp.array3d[wp.vec3]
    ball_sums: wp.array3d[wp.int64]
    """Sums of derivatives by spheres, shape (W, S, BALL_SUMS)"""


@wp.struct
class ContactBars:
    """Derivatives by the inputs of a contact: of its four ends, of a sphere, and of a pair of balloons."""

    points: FOUR
    moving: FOUR
    inverse_masses: wp.vec4
    ball: BallShare
    friction: float
    thickness: float


class SweepBack(NamedTuple):
    """Sweeps that run backwards, over contacts of one kind."""

    of: Sweep
    find_back: Callable[[Features], Any]
    """Function of (t, state, working, world, contact, end, points, velocities, by) that returns the derivatives by all
    from which a contact was found, see `ContactBars`"""


@wp.func
def largest_of(rows: FOUR):
    """Return the size of the largest entry."""
    most = wp.max(wp.max(wp.abs(rows[0])), wp.max(wp.abs(rows[1])))
    return wp.max(most, wp.max(wp.max(wp.abs(rows[2])), wp.max(wp.abs(rows[3]))))


@cache
def spreading_function(features: Features) -> Any:
    """Accumulator of a contact's bars at its ends, its sphere and its pair."""

    @wp.func
    def spread(t: Tables, bars: SweepBars, world: wp.int32, contact: Contact, found: ContactBars, adds: bool):
        """Add the derivatives by a contact, or note how large they are."""
        if not adds:
            note_size(bars.largest, world, OF_PLACES, largest_of(found.points))
            note_size(bars.largest, world, OF_VELOCITIES, largest_of(found.moving))
            note_size(bars.largest, world, OF_INVERSE_MASSES, wp.max(wp.abs(found.inverse_masses)))
            note_size(bars.largest, world, OF_FRICTION, wp.abs(found.friction))
            note_size(bars.largest, world, OF_THICKNESS, wp.abs(found.thickness))
        else:
            for end in range(4):
                add_to_sums(
                    bars, world, contact.ends[end], found.points[end], found.moving[end], found.inverse_masses[end]
                )
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, contact.solid)
            if sphere >= 0 and adds:
                add_ball(bars, world, sphere, found.ball)
            elif sphere >= 0:
                note_ball(bars, world, found.ball)
        if adds and bars.pairs.shape[1] > 0:
            own = t.particles.balloon[contact.ends[0]]
            pair = own * t.inflation_kind.shape[0] + t.particles.balloon[contact.ends[2]]
            add_exactly(bars.pairs, world, pair, 0, parts_per_unit(bars.largest, world, OF_FRICTION), found.friction)
            add_exactly(bars.pairs, world, pair, 1, parts_per_unit(bars.largest, world, OF_THICKNESS), found.thickness)

    return spread


@wp.func
def take_pairs(bars: SweepBars, world: wp.int32):
    """Add the sums of all pairs of balloons to their totals."""
    for pair in range(bars.pairs.shape[1]):
        if bars.pairs[world, pair, 0] != wp.int64(0) or bars.pairs[world, pair, 1] != wp.int64(0):
            friction = wp.float64(sum_at(bars.pairs, bars.largest, world, pair, 0, OF_FRICTION))
            thickness = wp.float64(sum_at(bars.pairs, bars.largest, world, pair, 1, OF_THICKNESS))
            more = wp.vec3d(wp.float64(0.0), friction, thickness)
            own = pair // bars.totals.shape[1]
            other = pair - own * bars.totals.shape[1]
            bars.totals[world, own, other] = bars.totals[world, own, other] + more
            bars.pairs[world, pair, 0] = wp.int64(0)
            bars.pairs[world, pair, 1] = wp.int64(0)


@wp.func
def keep_velocities(
    working: Working, bars: SweepBars, world: wp.int32, thread: wp.int32, count: wp.int32, sweep: wp.int32,
    velocities: wp.array[wp.vec3],
):  # fmt: skip
    """Keep the velocities of all ends before a sweep."""
    for place in range(thread, count, wp.block_dim()):
        ends = working.listed_contacts[world, place].ends
        for end in range(4):
            bars.sweep_velocities[sweep, world, ends[end]] = velocities[ends[end]]
    block_barrier()


@cache
def ball_functions(features: Features) -> tuple[Any, Any]:
    """Functions of a contact's sphere: its motion before a sweep, and the bars of its gains."""

    @wp.func
    def ball_of(t: Tables, bars: SweepBars, world: wp.int32, sweep: wp.int32, contact: Contact):
        ball = Motion()
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, contact.solid)
            if sphere >= 0:
                ball.velocity = bars.ball_velocities[sweep, world, sphere]
                ball.spin = bars.ball_spins[sweep, world, sphere]
        return ball

    @wp.func
    def ball_gain_bars(
        t: Tables, bars: SweepBars, world: wp.int32, contact: Contact, step_seconds: float, speeds: float
    ):
        gain_bars = Motion()
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, contact.solid)
            if sphere >= 0:
                by_velocity = speeds * bars.spheres.velocities[world, sphere]
                gain_bars.velocity = step_seconds * bars.spheres.positions[world, sphere] + by_velocity
                gain_bars.spin = speeds * bars.spheres.spins[world, sphere]
        return gain_bars

    return ball_of, ball_gain_bars


@wp.func
def worth_of_ends(bars: SweepBars, world: wp.int32, contact: Contact, step_seconds: float, speeds: float):
    """Return the derivatives by gains of ends, row by row."""
    worth = FOUR()
    for end in range(4):
        particle = contact.ends[end]
        if contact.weights[end] != 0.0:
            worth[end] = step_seconds * bars.points[world, particle] + speeds * bars.velocities[world, particle]
    return worth


@cache
def contact_functions(features: Features) -> tuple[Any, Any]:
    """Adjoints of a contact's push, and of its separation."""
    bearing_of = bearing_function(features)
    push_pairing, parting_pairing = contact_pairings(features)
    ball_of, ball_gain_bars = ball_functions(features)

    @wp.func
    def push_back(t: Tables, working: Working, bars: SweepBars, world: wp.int32, contact: Contact, sweep: wp.int32):
        by_contact, by_moving, by_ball, by_bearing, _step, _bars, _ball = wp.grad(push_pairing)(
            contact, four_of(bars.sweep_velocities[sweep][world], contact.ends),
            ball_of(t, bars, world, sweep, contact), bearing_of(t, working, world, contact), t.step_seconds,
            worth_of_ends(bars, world, contact, t.step_seconds, 1.0),
            ball_gain_bars(t, bars, world, contact, t.step_seconds, 1.0),
        )  # fmt: skip
        found = ContactBars()
        found.moving = by_moving
        found.inverse_masses = by_bearing.inverse_masses
        found.ball.velocity = by_ball.velocity
        found.ball.spin = by_ball.spin
        found.ball.mass = by_bearing.mass
        found.ball.radius = by_bearing.radius
        return found, by_contact

    @wp.func
    def part_back(t: Tables, working: Working, bars: SweepBars, world: wp.int32, contact: Contact):
        by_contact, by_bearing, _bars, _ball = wp.grad(parting_pairing)(
            contact, bearing_of(t, working, world, contact), worth_of_ends(bars, world, contact, 1.0, 0.0),
            ball_gain_bars(t, bars, world, contact, 1.0, 0.0),
        )  # fmt: skip
        found = ContactBars()
        found.inverse_masses = by_bearing.inverse_masses
        found.ball.mass = by_bearing.mass
        found.ball.radius = by_bearing.radius
        return found, by_contact

    return push_back, part_back


PUSHES, PARTS, FINDS = wp.constant(0), wp.constant(1), wp.constant(2)
"""Stages that run backwards"""


@cache
def stage_function(back: SweepBack, every: Features) -> Any:
    """Adjoint of a stage of sweeps over all contacts, by all threads of a block."""
    features = back.of.seen(every)
    push_back, part_back = contact_functions(features)
    find_back, spread = back.find_back(every), spreading_function(features)

    @wp.func
    def contact_back(
        t: Tables, state: WorldState, working: Working, bars: SweepBars, world: wp.int32, item: wp.int32,
        stage: wp.int32, sweep: wp.int32, end: float, points: wp.array[wp.vec3], adds: bool,
    ):  # fmt: skip
        place = wp.where(stage == FINDS, item, working.listed_contacts[world, item].marked)
        contact = working.listed_contacts[world, place]
        found = ContactBars()
        by_contact = Contact()
        if stage == FINDS:
            by = bars.listed_contacts[world, place]
            found = find_back(t, state, working, world, contact, end, points, bars.sweep_velocities[0][world], by)
        elif stage == PUSHES:
            found, by_contact = push_back(t, working, bars, world, contact, sweep)
        else:
            found, by_contact = part_back(t, working, bars, world, contact)
        spread(t, bars, world, contact, found, adds)
        if stage == FINDS and adds:
            bars.listed_contacts[world, place] = Contact()
        elif not adds:
            bars.listed_contacts[world, place] = sum_of_contacts(bars.listed_contacts[world, place], by_contact)
            if stage == FINDS:  # who comes first takes the sums
                for number in range(4):
                    working.contact_shares[world, contact.ends[number]] = 1
                if wp.static(features.round_ridges):
                    if sphere_of(t, contact.solid) >= 0:
                        working.solid_shares[world, mover_of(t, contact)] = 1

    @wp.func
    def take_all(t: Tables, working: Working, bars: SweepBars, world: wp.int32, contact: Contact):
        """Add the sums of a contact's ends and its sphere to their derivatives; the first thread that comes does it."""
        for number in range(4):
            if wp.atomic_exch(working.contact_shares, world, contact.ends[number], 0) > 0:
                take_sums(bars, world, contact.ends[number])
        if wp.static(features.round_ridges):
            if sphere_of(t, contact.solid) >= 0:
                if wp.atomic_exch(working.solid_shares, world, mover_of(t, contact), 0) > 0:
                    take_ball(bars, world, sphere_of(t, contact.solid))

    @wp.func
    def stage_back(
        t: Tables, state: WorldState, working: Working, bars: SweepBars, world: wp.int32, thread: wp.int32,
        count: wp.int32, stage: wp.int32, sweep: wp.int32, end: float, points: wp.array[wp.vec3],
    ):  # fmt: skip
        for kind in range(thread, KINDS, wp.block_dim()):
            bars.largest[world, kind] = 0.0
        items = wp.where(stage == FINDS, count, working.listed_contact_counts[world, MARKED])
        block_barrier()
        for turn in range(2):
            for item in range(thread, items, wp.block_dim()):
                contact_back(t, state, working, bars, world, item, stage, sweep, end, points, turn == 1)
            block_barrier()
        if thread == 0:
            working.listed_contact_counts[world, MARKED] = 0
        for place in range(thread, count, wp.block_dim()):
            take_all(t, working, bars, world, working.listed_contacts[world, place])
        block_barrier()

    return stage_back


@wp.func
def note_stop(working: Working, world: wp.int32, particle: wp.int32, rise: float, fall: float):
    """Record the stop of a particle by the ground in this sweep."""
    working.contact_stops[world, particle] = wp.vec2(rise, fall)


@wp.func
def forget_stops(working: Working, world: wp.int32, thread: wp.int32, count: wp.int32):
    """Clear the stops of the ends of all contacts."""
    if working.contact_stops.shape[1] > 0:
        for place in range(thread, count, wp.block_dim()):
            ends = working.listed_contacts[world, place].ends
            for end in range(4):
                working.contact_stops[world, ends[end]] = wp.vec2()
        block_barrier()


@wp.func
def keep_stops(working: Working, bars: Any, world: wp.int32, thread: wp.int32, count: wp.int32, sweep: wp.int32):
    """Keep the stops that a sweep has noted of the ends of all contacts."""
    if working.contact_stops.shape[1] > 0:
        for place in range(thread, count, wp.block_dim()):
            ends = working.listed_contacts[world, place].ends
            for end in range(4):
                stop = working.contact_stops[world, ends[end]]
                bars.rises[sweep, world, ends[end]] = stop[0]
                bars.falls[sweep, world, ends[end]] = stop[1]
        block_barrier()


@wp.func
def stop_pairing(rise: float, fall: float, step_seconds: float, by_place: float, by_speed: float):
    """Pairing of a particle's rise and speed gain with their bars."""
    return rise * by_place + stop_by_ground(rise, fall, step_seconds) * by_speed


@cache
def stops_function(features: Features, columns: tuple[int, ...]) -> Any:
    """Adjoint of the ground's stops in a sweep, by all threads of a block.

    Args:
        columns: of the numbers that are derived by.
    """
    column = features.columns.places["ground_height"]
    place_of_height = columns.index(column) if column in columns else -1

    @wp.func
    def stop_back(t: Tables, bars: Any, world: wp.int32, particle: wp.int32, rise: float, fall: float, speeds: float):
        place = bars.points[world, particle]
        velocity = bars.velocities[world, particle]
        by_rise, by_fall, _step, _place, _speed = wp.grad(stop_pairing)(
            rise, fall, t.step_seconds, wp.dot(place, t.up), speeds * wp.dot(velocity, t.up)
        )
        bars.points[world, particle] = place - by_rise * t.up
        if fall < 0.0:
            bars.velocities[world, particle] = velocity + by_fall * t.up
        if wp.static(place_of_height >= 0):
            before = bars.numbers[world, particle, wp.static(place_of_height)]
            bars.numbers[world, particle, wp.static(place_of_height)] = before + by_rise

    @wp.func
    def stops_back(
        t: Tables, working: Working, bars: Any, world: wp.int32, thread: wp.int32, count: wp.int32, sweep: wp.int32,
        speeds: float,
    ):  # fmt: skip
        """Backward pass of the stops of a sweep.

        Args:
            speeds: 1, or 0 where particles were moved without speed.
        """
        if wp.static(features.ground):
            for place in range(thread, count, wp.block_dim()):
                ends = working.listed_contacts[world, place].ends
                for end in range(4):
                    rise = wp.atomic_exch(bars.rises, sweep, world, ends[end], 0.0)  # who comes first
                    if rise > 0.0:
                        stop_back(t, bars, world, ends[end], rise, bars.falls[sweep, world, ends[end]], speeds)
            block_barrier()

    return stops_back


@cache
def sweeping_function(back: SweepBack, every: Features) -> Any:
    """Recomputation of the sweeps, which stores the velocities before each and returns their number."""
    features, max_sweeps = back.of.seen(every), back.of.most(every)
    mark_pushed, _ = marking_functions(features)
    push_all = pushing_function(features, note_stop)

    @wp.func
    def sweep_again(
        t: Tables, state: WorldState, working: Working, bars: SweepBars, world: wp.int32, thread: wp.int32,
        count: wp.int32, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        sweep = wp.int32(0)
        again = count > 0
        while again and sweep < max_sweeps:
            keep_balls(state, bars, world, thread, sweep)
            keep_velocities(working, bars, world, thread, count, sweep, velocities)
            forget_stops(working, world, thread, count)
            again = any_in_block(mark_pushed(t, state, working, world, thread, count, velocities))
            push_all(t, state, working, world, thread, points, velocities, 1.0)
            keep_stops(working, bars, world, thread, count, sweep)
            sweep += 1
        return sweep

    return sweep_again


@cache
def sweeps_back_kernel(back: SweepBack, every: Features, columns: tuple[int, ...]) -> Any:
    """Backward kernel of the sweeps over a kind of contacts.

    Args:
        columns: of the numbers that are derived by.
    """
    features = back.of.seen(every)
    list_all, sweep_again = sweep_listing(back.of, every, True), sweeping_function(back, every)
    mark_pushed, mark_overlaps = marking_functions(features)
    part_all, stops_back = pushing_function(features, note_stop), stops_function(features, columns)
    stage_back, mass_adjoint = stage_function(back, every), mass_adjoint_function(features, columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def turn_sweeps_back(
        t: Tables, state: WorldState, working: Working, time_in_frame: float, first_points: wp.array2d[wp.vec3],
        all_points: wp.array2d[wp.vec3], all_velocities: wp.array2d[wp.vec3], bars: SweepBars,
    ):  # fmt: skip
        """Backward pass of contacts; a block a world.

        Args:
            state: whose spheres are as they came to contacts, and are moved again.
            first_points: Places before contacts.
            all_points: The same, which are moved again.
        """
        world, thread = wp.tid()
        end = time_in_frame + t.step_seconds
        points = first_points[world]
        velocities = all_velocities[world]
        count, overlaps = list_all(t, state, working, world, thread, end, all_points[world], velocities)
        sweeps = sweep_again(t, state, working, bars, world, thread, count, all_points[world], velocities)
        if overlaps:
            if wp.static(features.ground):
                mark_overlaps(t, working, world, thread, count)
                block_barrier()
                forget_stops(working, world, thread, count)
                part_all(t, state, working, world, thread, all_points[world], velocities, 0.0)
                keep_stops(working, bars, world, thread, count, sweeps)
                stops_back(t, working, bars, world, thread, count, sweeps, 0.0)
            mark_overlaps(t, working, world, thread, count)
            block_barrier()
            stage_back(t, state, working, bars, world, thread, count, PARTS, 0, end, points)
        while sweeps > 0:
            sweeps -= 1
            restore_balls(state, bars, world, thread, sweeps)
            stops_back(t, working, bars, world, thread, count, sweeps, 1.0)
            mark_pushed(t, state, working, world, thread, count, bars.sweep_velocities[sweeps][world])
            block_barrier()
            stage_back(t, state, working, bars, world, thread, count, PUSHES, sweeps, end, points)
        if count > 0:
            stage_back(t, state, working, bars, world, thread, count, FINDS, 0, end, points)
            if thread == 0:
                take_pairs(bars, world)
            for particle in range(thread, t.particles.balloon.shape[0], wp.block_dim()):
                mass_adjoint(t, working, bars, world, particle)

    return turn_sweeps_back


def swept_backwards(phase: Phase, features: Features, access: Access) -> tuple[Adjoint, ...]:
    """Empty adjoint of a phase of sweeps: a separate kernel runs them backwards.

    Raises:
        NoAdjointError: contacts push free bodies, too.
    """
    if features.bodies:
        raise NoAdjointError("free bodies")
    return ()


@wp.func
def edges_pairing(points: FOUR, moving: FOUR, thickness: float, friction: float, step_seconds: float, by: Contact):
    """Pairing of an edge contact at the start of a substep with its bars."""
    contact = edge_contact(points - step_seconds * moving, thickness, friction)
    return contact_pairing(contact, by) + contact.friction * by.friction


@wp.func
def particle_pairing(points: FOUR, moving: FOUR, thickness: float, step_seconds: float, by: Contact):
    """Pairing of a triangle-particle contact at the start of a substep with its bars."""
    return contact_pairing(particle_contact(points - step_seconds * moving, thickness), by)


@cache
def edges_found(features: Features) -> Any:
    """Adjoint of the detection of an edge contact."""
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
            of_points, of_moving, of_thickness, _seconds, _bars = wp.grad(particle_pairing)(
                places, moving, skin, t.step_seconds, by
            )
            found.points = of_points
            found.moving = of_moving
            found.thickness = of_thickness
        else:
            by_points, by_moving, by_thickness, by_friction, _step, _by = wp.grad(edges_pairing)(
                places, moving, skin, friction_of_balloons(t, world, first, last), t.step_seconds, by
            )
            found.points = by_points
            found.moving = by_moving
            found.thickness = by_thickness
            found.friction = by_friction
        return found

    return find_back


@wp.func
def ridge_pairing(
    points: FOUR, moving: FOUR, placed: Placed, ridge: Ridge, feature: wp.vec4i, step_seconds: float, by: Contact
):
    """Pairing of a feature-ridge contact at the start of a substep with its bars."""
    starts = points - step_seconds * moving
    contact = ridge_contact(
        placed, ridge, feature, seen_from(placed, starts[0]), seen_from(placed, starts[1]), seen_from(placed, starts[2])
    )
    return contact_pairing(contact, by)


@cache
def ridges_found(features: Features) -> Any:
    """Adjoint of the detection of a contact with a ridge."""
    place_of = placing_function(features)

    @wp.func
    def find_back(
        t: Tables, state: WorldState, working: Working, world: wp.int32, contact: Contact, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], by: Contact,
    ):  # fmt: skip
        pair = working.ridge_pairs[world, contact.pair]
        placed = place_of(t, state, working, world, contact.solid, end)
        by_points, by_moving, by_placed, _ridge, _feature, _step, _by = wp.grad(ridge_pairing)(
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

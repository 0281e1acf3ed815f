"""Adjoint of sweeps over contacts, a block a world: the same for every kind.

A substep's sweeps are done again, and the velocities before each are kept. Then the sweeps run backwards: each adds the
gains by its impulses to velocities, so that the derivatives by its inputs add up; those by the contacts themselves are
summed over sweeps, and come back to places and velocities last. All adds up exactly, see `exact_sums`.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.adjoints.contact_works import sum_of_contacts, works_of_contact
from balloon_warp.kernels.adjoints.exact_sums import add_exactly, note_size, parts_per_unit, sum_at
from balloon_warp.kernels.adjoints.particle_sums import OF_EASES, OF_PLACES, OF_VELOCITIES, add_to_sums, take_sums
from balloon_warp.kernels.adjoints.ridge_balls import KINDS_OF_BALLS, BallShare, add_ball, note_ball, take_ball
from balloon_warp.kernels.adjoints.sphere_bars import BarsOfSpheres
from balloon_warp.kernels.contact.contact import Contact, Motion
from balloon_warp.kernels.contact.ends import bearing_function, four_of, mover_of
from balloon_warp.kernels.contact.kind import MARKED, Sweep
from balloon_warp.kernels.contact.ridge_poses import sphere_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.ridges import FOUR
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working

OF_FRICTION, OF_THICKNESS = (wp.constant(3 + KINDS_OF_BALLS + kind) for kind in range(2))
KINDS = 5 + KINDS_OF_BALLS
"""Number of kinds of sums, see `particle_sums` and `ridge_balls`; the last are of pairs of balloons"""


@wp.struct
class SweepBars:
    """Derivatives by the inputs and results of sweeps over contacts, and the records of a substep."""

    points: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    eases: wp.array2d[float]
    """Derivatives by the inverse mass of each particle"""
    gas_masses: wp.array2d[float]
    numbers: wp.array3d[float]
    catches: wp.array2d[Contact]
    """Derivatives by each contact, summed over sweeps"""
    courses: wp.array3d[wp.vec3]
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
    eases: wp.vec4
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
    """Return the function that adds the derivatives by a contact to the sums of its ends, its sphere and its pair."""

    @wp.func
    def spread(t: Tables, bars: SweepBars, world: wp.int32, contact: Contact, found: ContactBars, adds: bool):
        """Add the derivatives by a contact, or note how large they are."""
        if not adds:
            note_size(bars.largest, world, OF_PLACES, largest_of(found.points))
            note_size(bars.largest, world, OF_VELOCITIES, largest_of(found.moving))
            note_size(bars.largest, world, OF_EASES, wp.max(wp.abs(found.eases)))
            note_size(bars.largest, world, OF_FRICTION, wp.abs(found.friction))
            note_size(bars.largest, world, OF_THICKNESS, wp.abs(found.thickness))
        else:
            for end in range(4):
                add_to_sums(bars, world, contact.ends[end], found.points[end], found.moving[end], found.eases[end])
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
def keep_course(
    working: Working, bars: SweepBars, world: wp.int32, thread: wp.int32, count: wp.int32, sweep: wp.int32,
    velocities: wp.array[wp.vec3],
):  # fmt: skip
    """Keep the velocities of all ends before a sweep."""
    for place in range(thread, count, wp.block_dim()):
        ends = working.catches[world, place].ends
        for end in range(4):
            bars.courses[sweep, world, ends[end]] = velocities[ends[end]]
    block_barrier()


@cache
def ball_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions of the motion of a contact's sphere before a sweep, and of the bars of its gains."""

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
    def worth_of_ball(
        t: Tables, bars: SweepBars, world: wp.int32, contact: Contact, step_seconds: float, speeds: float
    ):
        worth = Motion()
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, contact.solid)
            if sphere >= 0:
                by_velocity = speeds * bars.spheres.velocities[world, sphere]
                worth.velocity = step_seconds * bars.spheres.positions[world, sphere] + by_velocity
                worth.spin = speeds * bars.spheres.spins[world, sphere]
        return worth

    return ball_of, worth_of_ball


@cache
def contact_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions that run a contact's push, and its parting, backwards."""
    bearing_of = bearing_function(features)
    work_of_push, work_of_parting = works_of_contact(features)
    ball_of, worth_of_ball = ball_functions(features)

    @wp.func
    def worth_of(bars: SweepBars, world: wp.int32, contact: Contact, step_seconds: float, speeds: float):
        """Return the derivatives by gains of ends, row by row."""
        worth = FOUR()
        for end in range(4):
            particle = contact.ends[end]
            if contact.weights[end] != 0.0:
                worth[end] = step_seconds * bars.points[world, particle] + speeds * bars.velocities[world, particle]
        return worth

    @wp.func
    def push_back(t: Tables, working: Working, bars: SweepBars, world: wp.int32, contact: Contact, sweep: wp.int32):
        by_contact, by_moving, by_ball, by_bearing, _step, _worth, _ball = wp.grad(work_of_push)(
            contact, four_of(bars.courses[sweep][world], contact.ends), ball_of(t, bars, world, sweep, contact),
            bearing_of(t, working, world, contact), t.step_seconds, worth_of(bars, world, contact, t.step_seconds, 1.0),
            worth_of_ball(t, bars, world, contact, t.step_seconds, 1.0),
        )  # fmt: skip
        found = ContactBars()
        found.moving = by_moving
        found.eases = by_bearing.eases
        found.ball.velocity = by_ball.velocity
        found.ball.spin = by_ball.spin
        found.ball.mass = by_bearing.mass
        found.ball.radius = by_bearing.radius
        return found, by_contact

    @wp.func
    def part_back(t: Tables, working: Working, bars: SweepBars, world: wp.int32, contact: Contact):
        by_contact, by_bearing, _worth, _ball = wp.grad(work_of_parting)(
            contact, bearing_of(t, working, world, contact), worth_of(bars, world, contact, 1.0, 0.0),
            worth_of_ball(t, bars, world, contact, 1.0, 0.0),
        )  # fmt: skip
        found = ContactBars()
        found.eases = by_bearing.eases
        found.ball.mass = by_bearing.mass
        found.ball.radius = by_bearing.radius
        return found, by_contact

    return push_back, part_back


PUSHES, PARTS, FINDS = wp.constant(0), wp.constant(1), wp.constant(2)
"""Stages that run backwards"""


@cache
def stage_function(back: SweepBack, every: Features) -> Any:
    """Return the function that runs a stage backwards for all its contacts, by all threads of a block."""
    features = back.of.seen(every)
    push_back, part_back = contact_functions(features)
    find_back, spread = back.find_back(every), spreading_function(features)

    @wp.func
    def contact_back(
        t: Tables, state: WorldState, working: Working, bars: SweepBars, world: wp.int32, item: wp.int32,
        stage: wp.int32, sweep: wp.int32, end: float, points: wp.array[wp.vec3], adds: bool,
    ):  # fmt: skip
        place = wp.where(stage == FINDS, item, working.catches[world, item].marked)
        contact = working.catches[world, place]
        found = ContactBars()
        by_contact = Contact()
        if stage == FINDS:
            by = bars.catches[world, place]
            found = find_back(t, state, working, world, contact, end, points, bars.courses[0][world], by)
        elif stage == PUSHES:
            found, by_contact = push_back(t, working, bars, world, contact, sweep)
        else:
            found, by_contact = part_back(t, working, bars, world, contact)
        spread(t, bars, world, contact, found, adds)
        if stage == FINDS and adds:
            bars.catches[world, place] = Contact()
        elif not adds:
            bars.catches[world, place] = sum_of_contacts(bars.catches[world, place], by_contact)
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
        items = wp.where(stage == FINDS, count, working.catch_counts[world, MARKED])
        block_barrier()
        for turn in range(2):
            for item in range(thread, items, wp.block_dim()):
                contact_back(t, state, working, bars, world, item, stage, sweep, end, points, turn == 1)
            block_barrier()
        if thread == 0:
            working.catch_counts[world, MARKED] = 0
        for place in range(thread, count, wp.block_dim()):
            take_all(t, working, bars, world, working.catches[world, place])
        block_barrier()

    return stage_back

"""Adjoint of edges that push each other apart, a block a world.

A substep's sweeps are done again, and the velocities before each are kept. Then the sweeps run backwards: each adds the
gains by its impulses to velocities, so that the derivatives by its inputs add up; those by the contacts themselves are
summed over sweeps, and come back to places and velocities last. All adds up exactly, see `exact_sums`.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.adjoints.exact_sums import add_exactly, note_size, parts_per_unit, sum_at
from balloon_warp.kernels.adjoints.one_crossing import (
    CrossingBars,
    crossing_back,
    sum_of_catches,
    work_of_parting,
    work_of_push,
)
from balloon_warp.kernels.adjoints.particle_sums import OF_EASES, OF_PLACES, OF_VELOCITIES, add_to_sums, take_sums
from balloon_warp.kernels.contact.catch import EdgeCatch
from balloon_warp.kernels.contact.edge_catch import four_of
from balloon_warp.kernels.contact.edge_push import friction_of_catch
from balloon_warp.kernels.contact.list_lengths import MARKED
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.edges import FOUR
from balloon_warp.kernels.loops.inertia import ease_function
from balloon_warp.kernels.loops.meeting import skin_functions
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working

OF_FRICTION, OF_THICKNESS, KINDS = wp.constant(3), wp.constant(4), 5
"""Kinds of sums, after those of particles, and their number"""


@wp.struct
class EdgeBars:
    """Derivatives by the inputs and results of meeting edges, and the records of a substep."""

    points: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    eases: wp.array2d[float]
    """Derivatives by the inverse mass of each particle"""
    gas_masses: wp.array2d[float]
    numbers: wp.array3d[float]
    catches: wp.array2d[EdgeCatch]
    """Derivatives by each contact, summed over sweeps"""
    frictions: wp.array2d[float]
    courses: wp.array3d[wp.vec3]
    """Velocities before each sweep, and after the last, shape (sweeps, W, P)"""
    rises: wp.array3d[float]
    """Heights by which the ground raises particles in each sweep, and as edges part [m], shape (sweeps + 1, W, P)"""
    falls: wp.array3d[float]
    """Upward speeds of those, 0 where they rise [m/s]"""
    sums: wp.array3d[wp.int64]
    pairs: wp.array3d[wp.int64]
    """Sums by friction and thickness of each pair of balloons, shape (W, B^2, 2)"""
    largest: wp.array2d[float]
    totals: wp.array3d[wp.vec3d]
    """Sums by stiffness, friction and thickness between balloons, since they were last taken"""


def edges_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint of meeting edges: a kernel of its own runs them backwards."""
    return ()


@wp.func
def largest_of(rows: FOUR):
    """Return the size of the largest entry."""
    most = wp.max(wp.max(wp.abs(rows[0])), wp.max(wp.abs(rows[1])))
    return wp.max(most, wp.max(wp.max(wp.abs(rows[2])), wp.max(wp.abs(rows[3]))))


@wp.func
def spread(t: Tables, bars: EdgeBars, world: wp.int32, ends: wp.vec4i, found: CrossingBars, adds: bool):
    """Add the derivatives by a contact to the sums of its ends and of its pair, or note how large they are."""
    if not adds:
        note_size(bars.largest, world, OF_PLACES, largest_of(found.points))
        note_size(bars.largest, world, OF_VELOCITIES, largest_of(found.moving))
        note_size(bars.largest, world, OF_EASES, wp.max(wp.abs(found.movers)))
        note_size(bars.largest, world, OF_FRICTION, wp.abs(found.friction))
        note_size(bars.largest, world, OF_THICKNESS, wp.abs(found.thickness))
        return
    for end in range(4):
        add_to_sums(bars, world, ends[end], found.points[end], found.moving[end], found.movers[end])
    pair = t.particles.balloon[ends[0]] * t.inflation_kind.shape[0] + t.particles.balloon[ends[2]]
    add_exactly(bars.pairs, world, pair, 0, parts_per_unit(bars.largest, world, OF_FRICTION), found.friction)
    add_exactly(bars.pairs, world, pair, 1, parts_per_unit(bars.largest, world, OF_THICKNESS), found.thickness)


@wp.func
def take_pairs(bars: EdgeBars, world: wp.int32):
    """Add the sums of all pairs of balloons to their totals."""
    balloons = bars.totals.shape[1]
    for pair in range(balloons * balloons):
        if bars.pairs[world, pair, 0] != wp.int64(0) or bars.pairs[world, pair, 1] != wp.int64(0):
            friction = wp.float64(sum_at(bars.pairs, bars.largest, world, pair, 0, OF_FRICTION))
            thickness = wp.float64(sum_at(bars.pairs, bars.largest, world, pair, 1, OF_THICKNESS))
            more = wp.vec3d(wp.float64(0.0), friction, thickness)
            own = pair // balloons
            other = pair - own * balloons
            bars.totals[world, own, other] = bars.totals[world, own, other] + more
            bars.pairs[world, pair, 0] = wp.int64(0)
            bars.pairs[world, pair, 1] = wp.int64(0)


@wp.func
def keep_course(
    working: Working, bars: EdgeBars, world: wp.int32, thread: wp.int32, count: wp.int32, sweep: wp.int32,
    velocities: wp.array[wp.vec3],
):  # fmt: skip
    """Keep the velocities of all ends before a sweep."""
    for place in range(thread, count, wp.block_dim()):
        ends = working.edge_catches[world, place].ends
        for end in range(4):
            bars.courses[sweep, world, ends[end]] = velocities[ends[end]]
    block_barrier()


@cache
def pair_functions(features: Features) -> tuple[Any, Any, Any]:
    """Return the functions that run a pair's push, its parting and its finding backwards."""
    ease_of_moving = ease_function(features)
    thickness_between, _ = skin_functions(features)

    @wp.func
    def worth_and_eases(
        t: Tables, working: Working, bars: EdgeBars, world: wp.int32, catch: EdgeCatch, step_seconds: float,
        speeds: float,
    ):  # fmt: skip
        """Return the derivatives by gains of ends, their inverse masses, and the contacts that share these."""
        worth = FOUR()
        movers = wp.vec4()
        shares = wp.vec4()
        for end in range(4):
            particle = catch.ends[end]
            if catch.weights[end] != 0.0:
                worth[end] = step_seconds * bars.points[world, particle] + speeds * bars.velocities[world, particle]
            movers[end] = ease_of_moving(t, working, world, particle)
            shares[end] = float(working.edge_shares[world, particle])
        return worth, movers, shares

    @wp.func
    def push_back(
        t: Tables, working: Working, bars: EdgeBars, world: wp.int32, place: wp.int32, sweep: wp.int32, adds: bool
    ):
        catch = working.edge_catches[world, place]
        worth, movers, shares = worth_and_eases(t, working, bars, world, catch, t.step_seconds, 1.0)
        by_catch, by_moving, by_movers, _shares, by_friction, _step, _worth = wp.grad(work_of_push)(
            catch, four_of(bars.courses[sweep][world], catch.ends), movers, shares,
            friction_of_catch(t, world, catch), t.step_seconds, worth,
        )  # fmt: skip
        found = CrossingBars()
        found.moving = by_moving
        found.movers = by_movers
        spread(t, bars, world, catch.ends, found, adds)
        if not adds:
            bars.catches[world, place] = sum_of_catches(bars.catches[world, place], by_catch)
            bars.frictions[world, place] = bars.frictions[world, place] + by_friction

    @wp.func
    def part_back(t: Tables, working: Working, bars: EdgeBars, world: wp.int32, place: wp.int32, adds: bool):
        catch = working.edge_catches[world, place]
        worth, movers, shares = worth_and_eases(t, working, bars, world, catch, 1.0, 0.0)
        by_catch, by_movers, _shares, _worth = wp.grad(work_of_parting)(catch, movers, shares, worth)
        found = CrossingBars()
        found.movers = by_movers
        spread(t, bars, world, catch.ends, found, adds)
        if not adds:
            bars.catches[world, place] = sum_of_catches(bars.catches[world, place], by_catch)

    @wp.func
    def find_back(
        t: Tables, working: Working, bars: EdgeBars, world: wp.int32, place: wp.int32, points: wp.array[wp.vec3],
        adds: bool,
    ):  # fmt: skip
        catch = working.edge_catches[world, place]
        first = t.particles.balloon[catch.ends[0]]
        skin = thickness_between(t, world, first, t.particles.balloon[catch.ends[3]])
        found = crossing_back(
            catch, four_of(points, catch.ends), four_of(bars.courses[0][world], catch.ends), skin, t.step_seconds,
            bars.catches[world, place],
        )  # fmt: skip
        found.friction = bars.frictions[world, place]
        spread(t, bars, world, catch.ends, found, adds)
        if not adds:
            for end in range(4):
                working.edge_shares[world, catch.ends[end]] = 1  # who comes first takes the sums
        else:
            bars.catches[world, place] = EdgeCatch()
            bars.frictions[world, place] = 0.0

    return push_back, part_back, find_back


PUSHES, PARTS, FINDS = wp.constant(0), wp.constant(1), wp.constant(2)
"""Stages that run backwards"""


@cache
def stage_function(features: Features) -> Any:
    """Return the function that runs a stage backwards for all marked pairs, by all threads of a block."""
    push_back, part_back, find_back = pair_functions(features)

    @wp.func
    def stage_back(
        t: Tables, working: Working, bars: EdgeBars, world: wp.int32, thread: wp.int32, count: wp.int32,
        stage: wp.int32, sweep: wp.int32, points: wp.array[wp.vec3],
    ):  # fmt: skip
        for kind in range(thread, KINDS, wp.block_dim()):
            bars.largest[world, kind] = 0.0
        items = wp.where(stage == FINDS, count, working.list_lengths[world, MARKED])
        block_barrier()
        for turn in range(2):
            for item in range(thread, items, wp.block_dim()):
                if stage == FINDS:
                    find_back(t, working, bars, world, item, points, turn == 1)
                elif stage == PUSHES:
                    push_back(t, working, bars, world, working.edge_catches[world, item].marked, sweep, turn == 1)
                else:
                    part_back(t, working, bars, world, working.edge_catches[world, item].marked, turn == 1)
            block_barrier()
        if thread == 0:
            working.list_lengths[world, MARKED] = 0
        for place in range(thread, count, wp.block_dim()):
            ends = working.edge_catches[world, place].ends
            for end in range(4):
                if wp.atomic_exch(working.edge_shares, world, ends[end], 0) > 0:
                    take_sums(bars, world, ends[end])
        block_barrier()

    return stage_back

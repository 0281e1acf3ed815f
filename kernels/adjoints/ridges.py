"""Adjoint of faces that meet ridges of obstacles, and spheres as ridges, a block a world.

A substep's sweeps are done again, and the velocities before each are kept. Then the sweeps run backwards, as those of
edges do, see `crossings`: each adds the gains by its impulses to velocities, and derivatives by the contacts
themselves, summed over sweeps, come back to places and velocities last. All adds up exactly, see `exact_sums`.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint, NoAdjointError
from balloon_warp.kernels.adjoints.exact_sums import note_size
from balloon_warp.kernels.adjoints.one_ridge import Motion, ridge_works, sum_of_catches, work_of_catch
from balloon_warp.kernels.adjoints.particle_sums import OF_EASES, OF_PLACES, OF_VELOCITIES, add_to_sums, take_sums
from balloon_warp.kernels.adjoints.ridge_balls import KINDS_OF_BALLS, BallShare, add_ball, note_ball, take_ball
from balloon_warp.kernels.adjoints.sphere_bars import BarsOfSpheres
from balloon_warp.kernels.contact.catch import Catch
from balloon_warp.kernels.contact.ridge_pairs import bearing_function
from balloon_warp.kernels.contact.ridge_poses import placing_function, sphere_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working

KINDS = 3 + KINDS_OF_BALLS
"""Number of kinds of sums, see `particle_sums` and `ridge_balls`"""


@wp.struct
class RidgeBars:
    """Derivatives by the inputs and results of faces that meet ridges, and the records of a substep."""

    points: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    eases: wp.array2d[float]
    """Derivatives by the inverse mass of each particle"""
    gas_masses: wp.array2d[float]
    numbers: wp.array3d[float]
    catches: wp.array2d[Catch]
    """Derivatives by each contact, summed over sweeps"""
    courses: wp.array3d[wp.vec3]
    """Velocities before each sweep, shape (sweeps, W, P)"""
    sums: wp.array3d[wp.int64]
    largest: wp.array2d[float]
    spheres: BarsOfSpheres
    ball_velocities: wp.array3d[wp.vec3]
    """Velocities of spheres before each sweep, shape (sweeps, W, S)"""
    ball_spins: wp.array3d[wp.vec3]
    ball_sums: wp.array3d[wp.int64]
    """Sums of derivatives by spheres, shape (W, S, BALL_SUMS)"""


@wp.struct
class CornerBars:
    """Derivatives by a contact's inputs of its three corners, and of a sphere."""

    points: wp.mat33
    moving: wp.mat33
    eases: wp.vec3
    ball: BallShare


def ridges_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint of faces that meet ridges: a kernel of its own runs them backwards.

    Raises:
        NoAdjointError: the ridges are those of free bodies, too.
    """
    if features.bodies:
        raise NoAdjointError("free bodies")
    return ()


@wp.func
def rows_of(vectors: wp.array[wp.vec3], corners: wp.vec3i):
    """Return the vectors of three corners, row by row."""
    return wp.matrix_from_rows(vectors[corners[0]], vectors[corners[1]], vectors[corners[2]])


@cache
def spreading_function(features: Features) -> Any:
    """Return the function that adds the derivatives by a contact to the sums of its corners and its sphere."""

    @wp.func
    def spread(t: Tables, bars: RidgeBars, world: wp.int32, catch: Catch, found: CornerBars, adds: bool):
        """Add the derivatives by a contact, or note how large they are."""
        for corner in range(3):
            place = found.points[corner]
            velocity = found.moving[corner]
            if adds:
                add_to_sums(bars, world, catch.corners[corner], place, velocity, found.eases[corner])
            else:
                note_size(bars.largest, world, OF_PLACES, wp.max(wp.abs(place)))
                note_size(bars.largest, world, OF_VELOCITIES, wp.max(wp.abs(velocity)))
                note_size(bars.largest, world, OF_EASES, wp.abs(found.eases[corner]))
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, catch.solid)
            if sphere >= 0:
                if adds:
                    add_ball(bars, world, sphere, found.ball)
                else:
                    note_ball(bars, world, found.ball)

    return spread


@wp.func
def keep_course(
    working: Working, bars: RidgeBars, world: wp.int32, thread: wp.int32, count: wp.int32, sweep: wp.int32,
    velocities: wp.array[wp.vec3],
):  # fmt: skip
    """Keep the velocities of all corners before a sweep."""
    for place in range(thread, count, wp.block_dim()):
        corners = working.catches[world, place].corners
        for corner in range(3):
            bars.courses[sweep, world, corners[corner]] = velocities[corners[corner]]
    block_barrier()


@cache
def ball_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions of the motion of a contact's sphere before a sweep, and of the bars of its gains."""

    @wp.func
    def ball_of(t: Tables, bars: RidgeBars, world: wp.int32, sweep: wp.int32, catch: Catch):
        """Return how a sphere moves before a sweep."""
        ball = Motion()
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, catch.solid)
            if sphere >= 0:
                ball.velocity = bars.ball_velocities[sweep, world, sphere]
                ball.spin = bars.ball_spins[sweep, world, sphere]
        return ball

    @wp.func
    def worth_of_ball(t: Tables, bars: RidgeBars, world: wp.int32, catch: Catch, step_seconds: float, speeds: float):
        """Return the derivatives by gains of a sphere."""
        worth = Motion()
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, catch.solid)
            if sphere >= 0:
                by_velocity = speeds * bars.spheres.velocities[world, sphere]
                worth.velocity = step_seconds * bars.spheres.positions[world, sphere] + by_velocity
                worth.spin = speeds * bars.spheres.spins[world, sphere]
        return worth

    return ball_of, worth_of_ball


@cache
def pair_functions(features: Features) -> tuple[Any, Any, Any]:
    """Return the functions that run a pair's push, its parting and its finding backwards."""
    bearing_of, place_of = bearing_function(features), placing_function(features)
    work_of_push, work_of_parting = ridge_works(features)
    spread, (ball_of, worth_of_ball) = spreading_function(features), ball_functions(features)

    @wp.func
    def worth_of(bars: RidgeBars, world: wp.int32, catch: Catch, step_seconds: float, speeds: float):
        """Return the derivatives by gains of corners, row by row."""
        worth = wp.mat33()
        for corner in range(3):
            particle = catch.corners[corner]
            worth[corner] = step_seconds * bars.points[world, particle] + speeds * bars.velocities[world, particle]
        return worth

    @wp.func
    def push_back(
        t: Tables, working: Working, bars: RidgeBars, world: wp.int32, place: wp.int32, sweep: wp.int32, adds: bool
    ):
        catch = working.catches[world, place]
        worth = worth_of(bars, world, catch, t.step_seconds, 1.0)
        by_catch, by_moving, by_ball, by_bearing, _step, _worth, _ball = wp.grad(work_of_push)(
            catch, rows_of(bars.courses[sweep][world], catch.corners), ball_of(t, bars, world, sweep, catch),
            bearing_of(t, working, world, catch), t.step_seconds, worth,
            worth_of_ball(t, bars, world, catch, t.step_seconds, 1.0),
        )  # fmt: skip
        found = CornerBars()
        found.moving = by_moving
        found.eases = by_bearing.eases
        found.ball.velocity = by_ball.velocity
        found.ball.spin = by_ball.spin
        found.ball.mass = by_bearing.mass
        found.ball.radius = by_bearing.radius
        spread(t, bars, world, catch, found, adds)
        if not adds:
            bars.catches[world, place] = sum_of_catches(bars.catches[world, place], by_catch)

    @wp.func
    def part_back(t: Tables, working: Working, bars: RidgeBars, world: wp.int32, place: wp.int32, adds: bool):
        catch = working.catches[world, place]
        worth = worth_of(bars, world, catch, 1.0, 0.0)
        by_catch, by_bearing, _worth, _ball = wp.grad(work_of_parting)(
            catch, bearing_of(t, working, world, catch), worth, worth_of_ball(t, bars, world, catch, 1.0, 0.0)
        )
        found = CornerBars()
        found.eases = by_bearing.eases
        found.ball.mass = by_bearing.mass
        found.ball.radius = by_bearing.radius
        spread(t, bars, world, catch, found, adds)
        if not adds:
            bars.catches[world, place] = sum_of_catches(bars.catches[world, place], by_catch)

    @wp.func
    def find_back(
        t: Tables, state: WorldState, working: Working, bars: RidgeBars, world: wp.int32, place: wp.int32, end: float,
        points: wp.array[wp.vec3], adds: bool,
    ):  # fmt: skip
        catch = working.catches[world, place]
        pair = working.ridge_pairs[world, catch.pair]
        placed = place_of(t, state, working, world, catch.solid, end)
        by_points, by_moving, by_placed, _ridge, _feature, _step, _by = wp.grad(work_of_catch)(
            rows_of(points, catch.corners), rows_of(bars.courses[0][world], catch.corners), placed,
            t.ridges.ridges[pair[1]], t.ridges.features[pair[0]], t.step_seconds, bars.catches[world, place],
        )  # fmt: skip
        found = CornerBars()
        found.points = by_points
        found.moving = by_moving
        found.ball.start = by_placed.center
        found.ball.radius = by_placed.radius
        spread(t, bars, world, catch, found, adds)
        if not adds:  # who comes first takes the sums
            for corner in range(3):
                working.ridge_shares[world, catch.corners[corner]] = 1
            if wp.static(features.round_ridges):
                if sphere_of(t, catch.solid) >= 0:
                    working.ridge_ball_shares[world, sphere_of(t, catch.solid)] = 1
        else:
            bars.catches[world, place] = Catch()

    return push_back, part_back, find_back


PUSHES, PARTS, FINDS = wp.constant(0), wp.constant(1), wp.constant(2)
"""Stages that run backwards"""


@cache
def stage_function(features: Features) -> Any:
    """Return the function that runs a stage backwards for all contacts, by all threads of a block."""
    push_back, part_back, find_back = pair_functions(features)

    @wp.func
    def stage_back(
        t: Tables, state: WorldState, working: Working, bars: RidgeBars, world: wp.int32, thread: wp.int32,
        count: wp.int32, stage: wp.int32, sweep: wp.int32, end: float, points: wp.array[wp.vec3],
    ):  # fmt: skip
        for kind in range(thread, KINDS, wp.block_dim()):
            bars.largest[world, kind] = 0.0
        block_barrier()
        for turn in range(2):
            for place in range(thread, count, wp.block_dim()):
                if stage == FINDS:
                    find_back(t, state, working, bars, world, place, end, points, turn == 1)
                elif working.catches[world, place].push > 0.0:
                    if stage == PUSHES:
                        push_back(t, working, bars, world, place, sweep, turn == 1)
                    else:
                        part_back(t, working, bars, world, place, turn == 1)
            block_barrier()
        for place in range(thread, count, wp.block_dim()):
            catch = working.catches[world, place]
            for corner in range(3):
                if wp.atomic_exch(working.ridge_shares, world, catch.corners[corner], 0) > 0:
                    take_sums(bars, world, catch.corners[corner])
            if wp.static(features.round_ridges):
                sphere = sphere_of(t, catch.solid)
                if sphere >= 0:
                    if wp.atomic_exch(working.ridge_ball_shares, world, sphere, 0) > 0:
                        take_ball(bars, world, sphere)
        block_barrier()

    return stage_back

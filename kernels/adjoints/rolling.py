"""Adjoint of spheres that roll: what particles have found of them is added up, and turned into that of before.

Whether a sphere touches the ground is frozen, and so is its friction there. Where spheres come near each other or an
obstacle, that is noted: how they bounce has no adjoint.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint, NoAdjointError
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.fixed_point import total_newtons
from balloon_warp.kernels.frames.backwards import Bars, numbers_adder
from balloon_warp.kernels.laws.contact import move_sphere
from balloon_warp.kernels.laws.sliding import rubbed
from balloon_warp.kernels.loops.fixtures import meeting_function
from balloon_warp.kernels.loops.friction import GROUND, friction_between, number_of_sphere
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import numbers_type
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world, sphere_mass, sphere_radius
from balloon_warp.kernels.working import SphereBars, Working

NEARLY = wp.constant(1.0001)
"""Fraction of the sum of two radii within which spheres may have met"""
COLUMNS = ("sphere_mass", "sphere_radius", "sphere_penalty")
"""Parameters of spheres by which is derived, in the order of their columns"""


def roll_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint of spheres that move: a kernel of its own runs them backwards."""
    if features.impulses:
        raise NoAdjointError("spheres that exchange momentum")
    return ()


@wp.struct
class BarsOfSpheres:
    """Derivatives by the spheres of all worlds, shape (W, S)."""

    positions: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    spins: wp.array2d[wp.vec3]
    totals: wp.array2d[SphereBars]
    """Bars from all particles in a substep"""
    numbers: wp.array3d[wp.float64]
    """Bars of `COLUMNS`, added up over all frames"""
    met: wp.array[wp.int32]
    """Whether spheres of a world have met something that has no adjoint"""


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def sum_sphere_bars(working: Working, bars: BarsOfSpheres):
    """Add up what particles have found of a sphere, and clear it; a block a (world, sphere)."""
    world, sphere, thread = wp.tid()
    total = SphereBars()
    for particle in range(thread, working.sphere_bars.shape[1], wp.block_dim()):
        total += working.sphere_bars[world, particle, sphere]
        working.sphere_bars[world, particle, sphere] = SphereBars()
    found = wp.tile_sum(wp.tile(total, preserve_type=True))[0]
    if thread == 0:
        bars.totals[world, sphere] = found


@wp.struct
class Ball:
    """Sphere's parameters on which its course depends, besides its state."""

    force: wp.vec3
    mass: float
    radius: float
    gravity: float
    ground_height: float
    ground_restitution: float
    friction: float


@wp.func
def work_of_roll(
    position: wp.vec3, velocity: wp.vec3, spin: wp.vec3, ball: Ball, up: wp.vec3, step: float, position_bar: wp.vec3,
    velocity_bar: wp.vec3, spin_bar: wp.vec3,
):  # fmt: skip
    """Return a sphere's course after a step, see `loops.rolling`, times its bars."""
    moved, going, stopped = move_sphere(
        position, velocity, ball.force / ball.mass, ball.radius, ball.gravity, up, ball.ground_height,
        ball.ground_restitution, step,
    )  # fmt: skip
    gain, more = rubbed(going, spin, wp.vec3(), up, stopped, ball.radius, ball.friction)
    by_place = wp.dot(moved + step * gain, position_bar)
    return by_place + wp.dot(going + gain, velocity_bar) + wp.dot(spin + more, spin_bar)


@cache
def ball_function(features: Features) -> Any:
    """Return the function that reads what a sphere's course depends on."""
    places, split = features.columns.places, features.columns.balloon_width
    gravity, height, restitution = (places[name] - split for name in ("gravity", "ground_height", "ground_restitution"))

    @wp.func
    def ball_of(t: Tables, world: wp.int32, sphere: wp.int32, force: wp.vec3):
        numbers = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]
        ball = Ball()
        ball.force = force
        ball.mass = sphere_mass(t.spheres, world, sphere)
        ball.radius = sphere_radius(t.spheres, world, sphere)
        ball.gravity = numbers[gravity]
        ball.ground_height = numbers[height]
        ball.ground_restitution = numbers[restitution]
        if wp.static(features.spheres_rub):
            ball.friction = friction_between(t, world, number_of_sphere(t, sphere), GROUND)
        return ball

    return ball_of


@cache
def meeting_test(features: Features) -> Any:
    """Return the function that says whether a sphere has met what has no adjoint."""
    meet = meeting_function(features) if features.fixtures else None

    @wp.func
    def has_met(t: Tables, before: WorldState, after: WorldState, world: wp.int32, sphere: wp.int32, end: float):
        """Return whether a sphere may have met another, or an obstacle, in a substep."""
        radius = sphere_radius(t.spheres, world, sphere)
        position = after.sphere_positions[world, sphere]
        velocity = after.sphere_velocities[world, sphere]
        found = bool(False)
        for other in range(sphere):
            apart = wp.length(after.sphere_positions[world, other] - position)
            way = t.step_seconds * wp.length(after.sphere_velocities[world, other] - velocity)
            reach = NEARLY * (radius + sphere_radius(t.spheres, world, other)) + 2.0 * way
            found = found or apart < reach
        if wp.static(meet is not None):
            start = before.sphere_positions[world, sphere]
            for fixture in range(t.fixtures.solids.shape[0]):
                met = meet(t, world, fixture, end, start, position, NEARLY * radius)
                found = found or wp.length_sq(met.normal) > 0.0
        return found

    return has_met


@cache
def roll_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that runs spheres backwards, once all else of a substep has."""
    places, ball_of, has_met = features.columns.places, ball_function(features), meeting_test(features)
    gravity, height, restitution = (places[name] for name in ("gravity", "ground_height", "ground_restitution"))
    Numbers, add_numbers = numbers_type(features.columns.width), numbers_adder(columns)  # noqa: N806 - a type

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def roll_back(
        t: Tables,
        before: WorldState,
        after: WorldState,
        quanta: wp.array3d[wp.int64],
        working: Working,
        time_in_frame: float,
        bars: BarsOfSpheres,
        of_frame: Bars,
    ):
        """Turn the bars of where spheres are in a substep into those of before; a thread a world.

        Args:
            quanta: forces on spheres since they last moved, as the substep began.
        """
        world = wp.tid()
        end = time_in_frame + t.step_seconds
        for sphere in range(t.spheres.numbers.shape[1]):
            if has_met(t, before, after, world, sphere, end):
                bars.met[world] = 1
            totals = bars.totals[world, sphere]
            by_place, by_velocity, by_spin, by_ball, _up, _step, _place, _velocity, _spin = wp.grad(work_of_roll)(
                before.sphere_positions[world, sphere],
                before.sphere_velocities[world, sphere],
                before.sphere_spins[world, sphere],
                ball_of(t, world, sphere, total_newtons(quanta, world, sphere)),
                t.up,
                t.step_seconds,
                bars.positions[world, sphere] + wp.vec3(totals[0], totals[1], totals[2]),
                bars.velocities[world, sphere] + wp.vec3(totals[3], totals[4], totals[5]),
                bars.spins[world, sphere],
            )
            bars.positions[world, sphere] = by_place
            bars.velocities[world, sphere] = by_velocity
            bars.spins[world, sphere] = by_spin
            working.sphere_push_bars[world, sphere] = by_ball.force
            found = wp.vec3d(wp.vec3(by_ball.mass, totals[6] + by_ball.radius, totals[7]))
            for column in range(3):
                bars.numbers[world, sphere, column] = bars.numbers[world, sphere, column] + found[column]
            by_n = Numbers()
            by_n[gravity] = by_ball.gravity
            by_n[height] = by_ball.ground_height
            by_n[restitution] = by_ball.ground_restitution
            add_numbers(of_frame.numbers_of_balloons, world, 0, by_n)

    return roll_back

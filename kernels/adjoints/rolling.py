"""Adjoint of spheres that move: the bars that particles have found are added up, and turned into those of before.

The events that change the courses of spheres in a substep are found again, see `sphere_log`, and run through from the
last to the first: motion, the ground, obstacles, other spheres. Frozen are the pairs that meet, whether they rebound,
and whether friction holds.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.bounces import obstacle_adjoint, pair_adjoint
from balloon_warp.kernels.adjoints.sphere_bars import (
    BarsOfSpheres,
    add_by_friction,
    add_by_sphere,
    bar_of_course,
    put_bar_of_course,
)
from balloon_warp.kernels.adjoints.sphere_courses import Ball, work_of_roll, work_on_ground
from balloon_warp.kernels.adjoints.spheres import Event, LoggedSpheres
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.frames.backwards import Bars, numbers_adder
from balloon_warp.kernels.loops.fixtures import GROUND, friction_between, number_of_sphere
from balloon_warp.kernels.loops.spheres import BESIDE_OBSTACLE, MEETS, ROLLS, STUCK
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import numbers_type
from balloon_warp.kernels.phase import Adjoint, Look, Phase
from balloon_warp.kernels.tables import Tables, row_of_world, sphere_mass, sphere_radius
from balloon_warp.kernels.warps import total_newtons
from balloon_warp.kernels.working import Working


def roll_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint of spheres that move: a kernel of its own runs them backwards."""
    return ()


@cache
def ball_function(features: Features) -> Any:
    """Return the function that reads the numbers on which a sphere's course depends."""
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
def rolling_adjoint(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the function that runs a sphere's motion, or contact with the ground, backwards."""
    places, ball_of = features.columns.places, ball_function(features)
    gravity, height, restitution = (places[name] for name in ("gravity", "ground_height", "ground_restitution"))
    Numbers, add_numbers = numbers_type(features.columns.width), numbers_adder(columns)  # noqa: N806 - a type

    @wp.func
    def roll_event_backwards(
        t: Tables, working: Working, world: wp.int32, event: Event, quanta: wp.array3d[wp.int64], bars: BarsOfSpheres,
        of_frame: Bars,
    ):  # fmt: skip
        sphere = event.first
        bar = bar_of_course(bars, world, sphere)
        by_ball = Ball()
        if event.kind == ROLLS:
            force = wp.vec3()
            if wp.static(features.penalties):
                force = total_newtons(quanta, world, sphere)
            ball = ball_of(t, world, sphere, force)
            by_rolled, of_ball, _up, _step, _bar = wp.grad(work_of_roll)(event.mine, ball, t.up, t.step_seconds, bar)
            bar = by_rolled
            by_ball = of_ball
            working.sphere_push_bars[world, sphere] = by_ball.force
        else:
            ball = ball_of(t, world, sphere, wp.vec3())
            by_stood, of_ball, _up, _step, _bar = wp.grad(work_on_ground)(event.mine, ball, t.up, t.step_seconds, bar)
            bar = by_stood
            by_ball = of_ball
        put_bar_of_course(bars, world, sphere, bar)
        add_by_sphere(bars, world, sphere, by_ball.mass, by_ball.radius)
        if wp.static(features.spheres_rub):
            add_by_friction(bars, world, number_of_sphere(t, sphere), GROUND, by_ball.friction)
        by_n = Numbers()
        by_n[gravity] = by_ball.gravity
        by_n[height] = by_ball.ground_height
        by_n[restitution] = by_ball.ground_restitution
        add_numbers(of_frame.numbers_of_balloons, world, 0, by_n)

    return roll_event_backwards


@cache
def roll_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the kernel that runs spheres backwards, once all else of a substep has."""
    roll_event, meet_obstacle, meet_pair = (
        rolling_adjoint(features, columns), obstacle_adjoint(features, columns), pair_adjoint(features),
    )  # fmt: skip

    @wp.func
    def take_totals(bars: BarsOfSpheres, world: wp.int32, sphere: wp.int32):
        """Add the bars of a sphere that particles have found."""
        totals = bars.totals[world, sphere]
        bar = bar_of_course(bars, world, sphere)
        bar.position += wp.vec3(totals[0], totals[1], totals[2])
        bar.velocity += wp.vec3(totals[3], totals[4], totals[5])
        put_bar_of_course(bars, world, sphere, bar)
        add_by_sphere(bars, world, sphere, 0.0, totals[6])
        bars.numbers[world, sphere, 2] = bars.numbers[world, sphere, 2] + wp.float64(totals[7])

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def roll_back(
        t: Tables,
        spheres: LoggedSpheres,
        quanta: wp.array3d[wp.int64],
        working: Working,
        time_in_frame: float,
        bars: BarsOfSpheres,
        of_frame: Bars,
    ):
        """Turn the bars of where spheres are in a substep into those of before; a thread a world.

        Args:
            spheres: as the substep moves them, and the events that have changed their courses.
            quanta: forces on spheres since they last moved, as the substep began.
        """
        world = wp.tid()
        end = time_in_frame + t.step_seconds
        count = spheres.counts[world]
        if count > spheres.events.shape[1]:
            bars.crowded[world] = 1
            count = 0
        for sphere in range(t.spheres.numbers.shape[1]):
            take_totals(bars, world, sphere)
        while count > 0:
            count -= 1
            event = spheres.events[world, count]
            if event.kind == MEETS:
                meet_pair(t, spheres, world, event, bars)
            elif event.kind == BESIDE_OBSTACLE:
                meet_obstacle(t, spheres, world, event, end, bars, of_frame)
            elif event.kind == STUCK:
                bars.starts[world, event.first] = bars.starts[world, event.first] + bars.positions[world, event.first]
                bars.positions[world, event.first] = wp.vec3()
            elif sphere_radius(t.spheres, world, event.first) > 0.0:  # else it has yet to begin
                roll_event(t, working, world, event, quanta, bars, of_frame)
        for sphere in range(t.spheres.numbers.shape[1]):
            bars.positions[world, sphere] = bars.positions[world, sphere] + bars.starts[world, sphere]
            bars.starts[world, sphere] = wp.vec3()

    return roll_back

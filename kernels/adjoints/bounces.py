"""Adjoints of spheres that meet an obstacle, or each other: the pairs, and on meshes the normal, are frozen."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.solids import Entry, entry_of, into
from balloon_warp.kernels.adjoints.sphere_bars import (
    BarsOfSpheres,
    add_by_friction,
    add_by_restitution,
    add_by_sphere,
    bar_of_course,
    put_bar_of_course,
)
from balloon_warp.kernels.adjoints.sphere_courses import Pair, work_beside_convex, work_beside_mesh, work_of_pair
from balloon_warp.kernels.adjoints.spheres import Event, LoggedSpheres
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.frames.backwards import Bars, numbers_adder
from balloon_warp.kernels.laws.collision import mean_restitution
from balloon_warp.kernels.laws.contact import MESH
from balloon_warp.kernels.loops.fixtures import (
    friction_between,
    meeting_function,
    number_of_obstacle,
    number_of_sphere,
    pose_function,
)
from balloon_warp.kernels.params import numbers_type
from balloon_warp.kernels.tables import Tables, row_of_world, sphere_mass, sphere_radius, sphere_restitution


@cache
def obstacle_adjoint(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the function that runs a sphere's contact with an obstacle backwards.

    Args:
        columns: of parameters by which something is derived.
    """
    if not features.fixtures:

        @wp.func
        def meet_nothing(
            t: Tables, spheres: LoggedSpheres, world: wp.int32, event: Event, end: float, bars: BarsOfSpheres,
            of_frame: Bars,
        ):  # fmt: skip
            return

        return meet_nothing
    meet, pose_at = meeting_function(features), pose_function(features)
    place = features.columns.places["gravity"]
    gravity = place - features.columns.balloon_width
    Numbers, add_numbers = numbers_type(features.columns.width), numbers_adder(columns)  # noqa: N806 - a type

    @wp.func
    def add_of_obstacle(
        t: Tables, bars: BarsOfSpheres, of_frame: Bars, world: wp.int32, sphere: wp.int32, fixture: wp.int32,
        by_entry: Entry,
    ):  # fmt: skip
        by_n = Numbers()
        by_n[place] = by_entry.gravity
        add_numbers(of_frame.numbers_of_balloons, world, 0, by_n)
        by_restitution = wp.float64(by_entry.restitution)
        bars.fixture_restitutions[world, fixture] = bars.fixture_restitutions[world, fixture] + by_restitution
        if wp.static(features.spheres_rub):
            add_by_friction(bars, world, number_of_sphere(t, sphere), number_of_obstacle(fixture), by_entry.friction)

    @wp.func
    def meet_obstacle_backwards(
        t: Tables, spheres: LoggedSpheres, world: wp.int32, event: Event, end: float, bars: BarsOfSpheres,
        of_frame: Bars,
    ):  # fmt: skip
        sphere, fixture = event.first, event.second
        start = spheres.sphere_starts[world, sphere]
        radius = sphere_radius(t.spheres, world, sphere)
        bar = bar_of_course(bars, world, sphere)
        met = meet(t, world, fixture, end, start, event.mine.position, radius)
        solid = t.fixtures.solids[fixture]
        pose = pose_at(t, world, fixture, end)
        earlier = pose
        if wp.static(features.fixtures_move):
            earlier = pose_at(t, world, fixture, end - t.step_seconds)
        entry = entry_of(
            into(earlier, start), into(pose, event.mine.position), into(pose, met.let), met.part, solid, t.up, radius
        )
        entry.step = t.step_seconds
        entry.gravity = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity]
        entry.restitution = t.fixtures.restitutions[row_of_world(world, t.fixtures.restitutions.shape[0]), fixture]
        if wp.static(features.spheres_rub):
            entry.friction = friction_between(t, world, number_of_sphere(t, sphere), number_of_obstacle(fixture))
        if solid.kind == MESH:
            by_mine, by_radius, _l, _n, _m, _c, _u, by_meshed, _left, _b = wp.grad(work_beside_mesh)(
                event.mine, radius, met.let, met.normal, met.moving, radius, t.up, entry, met.part, bar
            )
            put_bar_of_course(bars, world, sphere, by_mine)
            add_by_sphere(bars, world, sphere, 0.0, by_radius)
            add_of_obstacle(t, bars, of_frame, world, sphere, fixture, by_meshed)
        else:
            by_start, by_course, of_radius, _s, _pose, _earlier, _up, by_entry, _bar = wp.grad(work_beside_convex)(
                start, event.mine, radius, solid, pose, earlier, t.up, entry, bar
            )
            put_bar_of_course(bars, world, sphere, by_course)
            bars.starts[world, sphere] = bars.starts[world, sphere] + by_start
            add_by_sphere(bars, world, sphere, 0.0, of_radius)
            add_of_obstacle(t, bars, of_frame, world, sphere, fixture, by_entry)

    return meet_obstacle_backwards


@cache
def pair_adjoint(features: Features) -> Any:
    """Return the function that runs the collision of two spheres backwards."""
    gravity = features.columns.places["gravity"] - features.columns.balloon_width

    @wp.func
    def meet_pair_backwards(t: Tables, spheres: LoggedSpheres, world: wp.int32, event: Event, bars: BarsOfSpheres):
        first, second = event.first, event.second
        pair = Pair()
        own, others = sphere_restitution(t.spheres, world, first), sphere_restitution(t.spheres, world, second)
        pair.restitution = mean_restitution(own, others)
        if wp.static(features.spheres_rub):
            pair.friction = friction_between(t, world, number_of_sphere(t, first), number_of_sphere(t, second))
        pair.gravity = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity]
        pair.step = t.step_seconds
        (
            by_start, by_other_start, by_mine, by_other, by_mass, by_other_mass, by_radius, by_other_radius, by_pair,
            _up, _bar, _other_bar,
        ) = wp.grad(work_of_pair)(
            spheres.sphere_starts[world, first], spheres.sphere_starts[world, second], event.mine, event.other,
            sphere_mass(t.spheres, world, first), sphere_mass(t.spheres, world, second),
            sphere_radius(t.spheres, world, first), sphere_radius(t.spheres, world, second), pair, t.up,
            bar_of_course(bars, world, first), bar_of_course(bars, world, second),
        )  # fmt: skip
        put_bar_of_course(bars, world, first, by_mine)
        put_bar_of_course(bars, world, second, by_other)
        bars.starts[world, first] = bars.starts[world, first] + by_start
        bars.starts[world, second] = bars.starts[world, second] + by_other_start
        add_by_sphere(bars, world, first, by_mass, by_radius)
        add_by_sphere(bars, world, second, by_other_mass, by_other_radius)
        if pair.restitution > 0.0:  # of the root of a product
            by_root = 0.5 * by_pair.restitution / pair.restitution
            add_by_restitution(bars, world, first, by_root * others)
            add_by_restitution(bars, world, second, by_root * own)
        if wp.static(features.spheres_rub):
            add_by_friction(bars, world, number_of_sphere(t, first), number_of_sphere(t, second), by_pair.friction)

    return meet_pair_backwards

"""Impulses by which edges that may touch in a substep push each other apart."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.catch import EdgeCatch
from balloon_warp.kernels.contact.edge_catch import four_of
from balloon_warp.kernels.contact.ridge_sums import add_impulse, take_impulse
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.edges import (
    FOUR,
    crosses,
    ease_along,
    friction_of_edges,
    push_apart,
    rub_shares,
    sliding_at,
)
from balloon_warp.kernels.laws.ridges import way_to_part
from balloon_warp.kernels.laws.touch import LEAST
from balloon_warp.kernels.loops.friction import friction_of_balloons
from balloon_warp.kernels.loops.inertia import ease_function
from balloon_warp.kernels.tables import Tables, row_of_world
from balloon_warp.kernels.working import Working


@wp.func
def rows_times(factors: wp.vec4, rows: FOUR):
    """Return rows, each times its factor."""
    return wp.matrix_from_rows(
        factors[0] * rows[0], factors[1] * rows[1], factors[2] * rows[2], factors[3] * rows[3]
    )  # fmt: skip


@wp.func
def along_normal(catch: EdgeCatch, amount: float):
    """Return vectors of four ends along the normal, by their weights."""
    weights = catch.weights
    normal = catch.crossing.normal
    return wp.matrix_from_rows(
        (weights[0] * amount) * normal, (weights[1] * amount) * normal, (weights[2] * amount) * normal,
        (weights[3] * amount) * normal,
    )  # fmt: skip


@wp.func
def impulses_of(catch: EdgeCatch, moving: FOUR, eases: wp.vec4, friction: float, step_seconds: float):
    """Return the impulses on four ends that keep two edges apart, and friction [N s]."""
    weights = catch.weights
    parting = wp.dot(weights * moving, catch.crossing.normal)
    push = push_apart(parting, catch.crossing.gap, catch.kept, ease_along(weights, eases), step_seconds)
    straight = along_normal(catch, push)
    if crosses(catch.crossing):
        slide = sliding_at(catch.crossing, weights, moving + rows_times(eases, straight))
        shares_of_rub = rub_shares(catch.crossing, weights, wp.normalize(slide))
        rub = friction_of_edges(wp.length(slide), shares_of_rub, eases, push * friction)
        return straight - rub * shares_of_rub
    return straight


@wp.func
def moves_of(catch: EdgeCatch, eases: wp.vec4):
    """Return the moves of four ends, times masses, that restore the least distance between two edges.

    Without speed [kg m].
    """
    move = way_to_part(catch.crossing.gap, catch.kept) / wp.max(ease_along(catch.weights, eases), LEAST)
    return along_normal(catch, move)


@wp.func
def excess_of(t: Tables, catch: EdgeCatch, velocities: wp.array[wp.vec3]):
    """Return the speed by which two edges come nearer than they may [m/s]."""
    moving = four_of(velocities, catch.ends)
    parting = wp.dot(catch.weights * moving, catch.crossing.normal)
    return push_apart(parting, catch.crossing.gap, catch.kept, 1.0, t.step_seconds)


@wp.func
def count_ends(working: Working, world: wp.int32, catch: EdgeCatch):
    """Count a contact of the ends that bear it."""
    for end in range(4):
        if catch.weights[end] != 0.0:
            wp.atomic_add(working.edge_shares, world, catch.ends[end], 1)


@wp.func
def friction_of_catch(t: Tables, world: wp.int32, catch: EdgeCatch):
    """Return the coefficient of friction between two edges, 0 where none acts."""
    if crosses(catch.crossing):
        return friction_of_balloons(t, world, t.particles.balloon[catch.ends[0]], t.particles.balloon[catch.ends[2]])
    return 0.0


@wp.func
def add_impulses(working: Working, world: wp.int32, catch: EdgeCatch, impulses: FOUR):
    """Add impulses to those of the ends that bear the contact."""
    for end in range(4):
        if catch.weights[end] != 0.0:  # no friction acts where one bears nothing
            add_impulse(working.edge_quanta, world, catch.ends[end], impulses[end])


@wp.func
def stop_by_ground(rise: float, fall: float, step_seconds: float):
    """Return the upward speed that a particle gains which is put on the ground: no more than it fell at [m/s].

    Args:
        rise: How far it is raised [m].
        fall: Its upward speed, or 0 if it rises [m/s].
    """
    return wp.min(rise / step_seconds, -fall)


@wp.func
def forget_stop(working: Working, world: wp.int32, particle: wp.int32, rise: float, fall: float):
    """Note nothing of a particle that the ground stops."""
    return


@cache
def ground_function(features: Features, note: Any = forget_stop) -> Any:
    """Return the function that keeps a particle that others push above the ground.

    Args:
        note: function that keeps how far and how fast it would have gone on.
    """
    height = features.columns.places["ground_height"] - features.columns.balloon_width

    @wp.func
    def keep_above(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, point: wp.vec3, velocity: wp.vec3,
        speeds: float,
    ):  # fmt: skip
        """Return where a particle is that does not go through the ground, and its velocity.

        It goes as far as it can, and no faster: who pushes it then finds it no farther away. Were it taken out of the
        ground only in the next substep, it would go through a layer that lies on it.

        Args:
            speeds: 0 if it is moved without speed.
        """
        if wp.static(features.ground):
            rise = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), height] - wp.dot(point, t.up)
            if rise > 0.0:
                fall = wp.min(wp.dot(velocity, t.up), 0.0)
                note(working, world, particle, rise, fall)
                point += rise * t.up
                velocity += (speeds * stop_by_ground(rise, fall, t.step_seconds)) * t.up
        return point, velocity

    return keep_above


@cache
def pushing_functions(features: Features, note: Any = forget_stop) -> tuple[Any, Any, Any]:
    """Return the functions that push two edges apart, that part those that overlap, and that move their ends by all.

    Args:
        note: as in `ground_function`.
    """
    ease_of_moving, keep_above = ease_function(features), ground_function(features, note)

    @wp.func
    def shared_eases(t: Tables, working: Working, world: wp.int32, catch: EdgeCatch):
        """Return the inverse masses of the four ends, of which this contact has a share [1/kg]."""
        eases = wp.vec4()
        for end in range(4):
            shares = float(working.edge_shares[world, catch.ends[end]])
            eases[end] = shares * ease_of_moving(t, working, world, catch.ends[end])
        return eases

    @wp.func
    def part_pair(t: Tables, working: Working, world: wp.int32, catch: EdgeCatch):
        """Add the moves, times masses, that restore the least distance between two edges."""
        add_impulses(working, world, catch, moves_of(catch, shared_eases(t, working, world, catch)))

    @wp.func
    def push_pair(t: Tables, working: Working, world: wp.int32, catch: EdgeCatch, velocities: wp.array[wp.vec3]):
        """Add the impulse between two edges, and friction; each has its share of the mass of their ends."""
        eases = shared_eases(t, working, world, catch)
        friction = friction_of_catch(t, world, catch)
        impulses = impulses_of(catch, four_of(velocities, catch.ends), eases, friction, t.step_seconds)
        add_impulses(working, world, catch, impulses)

    @wp.func
    def move_end(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3], speeds: float,
    ):  # fmt: skip
        """Move an end of edges by its whole sum of impulses; the first thread that comes does it.

        Args:
            speeds: 1, or 0 where impulses are moves without speed.
        """
        if wp.atomic_exch(working.edge_shares, world, particle, 0) > 0:
            gain = ease_of_moving(t, working, world, particle) * take_impulse(working.edge_quanta, world, particle)
            point = points[particle] + wp.where(speeds > 0.0, t.step_seconds, 1.0) * gain
            velocity = velocities[particle] + speeds * gain
            point, velocity = keep_above(t, working, world, particle, point, velocity, speeds)
            velocities[particle] = velocity
            points[particle] = point

    return push_pair, part_pair, move_end

"""Adjoint of one contact of two edges, or of a particle and a triangle, which Warp derives of the law's own functions.

Frozen is which they are, and whether they come too near.
"""

import warp as wp

from balloon_warp.kernels.contact.catch import EdgeCatch
from balloon_warp.kernels.contact.edge_catch import edges_there, particle_there
from balloon_warp.kernels.contact.edge_push import impulses_of, moves_of
from balloon_warp.kernels.laws.edges import FOUR, Crossing


@wp.struct
class CrossingBars:
    """Derivatives by the states of a contact's four ends, and by numbers of the pair of balloons."""

    points: FOUR
    moving: FOUR
    movers: wp.vec4  # by the inverse masses of the ends
    friction: float
    thickness: float


@wp.func
def is_of_edges(catch: EdgeCatch):
    """Return whether a contact is that of two edges."""
    return wp.length_sq(catch.crossing.first) > 0.0


@wp.func
def work_of_push(
    catch: EdgeCatch, moving: FOUR, movers: wp.vec4, shares: wp.vec4, friction: float, step_seconds: float, worth: FOUR
):
    """Return the gains of four ends by the impulses of a sweep, times their bars.

    Args:
        movers: Inverse masses of the ends [1/kg].
        shares: Numbers of contacts among which these are divided.
    """
    impulses = impulses_of(catch, moving, wp.cw_mul(shares, movers), friction, step_seconds)
    by_impulses = wp.vec4(
        wp.dot(impulses[0], worth[0]), wp.dot(impulses[1], worth[1]), wp.dot(impulses[2], worth[2]),
        wp.dot(impulses[3], worth[3]),
    )  # fmt: skip
    return wp.dot(movers, by_impulses)


@wp.func
def work_of_parting(catch: EdgeCatch, movers: wp.vec4, shares: wp.vec4, worth: FOUR):
    """Return the moves that part four ends, times their bars."""
    moves = moves_of(catch, wp.cw_mul(shares, movers))
    by_moves = wp.vec4(
        wp.dot(moves[0], worth[0]), wp.dot(moves[1], worth[1]), wp.dot(moves[2], worth[2]), wp.dot(moves[3], worth[3])
    )
    return wp.dot(movers, by_moves)


@wp.func
def worth_of_catch(catch: EdgeCatch, by: EdgeCatch):
    """Return the numbers of a contact, times the derivatives by them."""
    found = wp.dot(catch.weights, by.weights) + catch.kept * by.kept + catch.crossing.gap * by.crossing.gap
    found += wp.dot(catch.crossing.normal, by.crossing.normal)
    return found + wp.dot(catch.crossing.first, by.crossing.first) + wp.dot(catch.crossing.second, by.crossing.second)


@wp.func
def work_of_edges(points: FOUR, moving: FOUR, thickness: float, step_seconds: float, by: EdgeCatch):
    """Return a contact of two edges as a substep begins, times the derivatives by it."""
    return worth_of_catch(edges_there(points - step_seconds * moving, thickness), by)


@wp.func
def work_of_particle(points: FOUR, moving: FOUR, thickness: float, step_seconds: float, by: EdgeCatch):
    """Return a contact of a triangle and a particle as a substep begins, times the derivatives by it."""
    return worth_of_catch(particle_there(points - step_seconds * moving, thickness), by)


@wp.func
def crossing_back(catch: EdgeCatch, points: FOUR, moving: FOUR, thickness: float, step_seconds: float, by: EdgeCatch):
    """Return the derivatives by all from which a contact was found."""
    bars = CrossingBars()
    if is_of_edges(catch):
        by_points, by_moving, by_thickness, _step, _by = wp.grad(work_of_edges)(
            points, moving, thickness, step_seconds, by
        )
        bars.points = by_points
        bars.moving = by_moving
        bars.thickness = by_thickness
    else:
        of_points, of_moving, of_thickness, _seconds, _worth = wp.grad(work_of_particle)(
            points, moving, thickness, step_seconds, by
        )
        bars.points = of_points
        bars.moving = of_moving
        bars.thickness = of_thickness
    return bars


@wp.func
def sum_of_catches(one: EdgeCatch, other: EdgeCatch):
    """Return the sum of derivatives by a contact."""
    total = EdgeCatch()
    total.weights = one.weights + other.weights
    total.kept = one.kept + other.kept
    crossing = Crossing()
    crossing.gap = one.crossing.gap + other.crossing.gap
    crossing.normal = one.crossing.normal + other.crossing.normal
    crossing.first = one.crossing.first + other.crossing.first
    crossing.second = one.crossing.second + other.crossing.second
    total.crossing = crossing
    return total

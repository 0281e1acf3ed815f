"""Adjoint of the forces of membrane quads on their corners, eight quads side by side, see `loops.eight_quads`.

The forces on the corners combine the quad's edges by tensions, which depend on the edges' products alone. With an
energy, derivatives of forces are symmetric: the bars of the corners' places are how their forces change as the corners
move by their bars. So they combine, in the same way, edges between the bars by the tensions, and the quad's edges by
how the tensions change.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint, NoAdjointError
from balloon_warp.kernels.adjoints.tensions import few_lanes, few_places, tension_changes
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Lanes, Lanes3, Lanes4, entry_at
from balloon_warp.kernels.loops.eight_quads import products_of, rates_of
from balloon_warp.kernels.loops.membranes import pulls_on_corners
from balloon_warp.kernels.phase import Look, Phase


@wp.struct
class QuadTensions:
    """Tensions of eight quads and how they change, as `pulls_on_corners` takes both."""

    along: Lanes4
    mixed: Lanes4
    back: Lanes4
    along_change: Lanes4
    mixed_change: Lanes4
    back_change: Lanes4


@wp.func
def in_lanes(rest: wp.vec4):
    """Return the rest metric of a triangle that is the same in all lanes."""
    rests = Lanes4()
    for row in range(4):
        rests[row] = Lanes(rest[row])
    return rests


@wp.func
def in_lanes(rests: Lanes4):  # noqa: F811 - an overload
    """Return the rest metrics of the triangle in each lane."""
    return rests


@cache
def changes_function(features: Features) -> Any:
    """Return the function for the tensions of eight quads and their changes."""
    changes_of_triangles, FewLanes = tension_changes(features), few_lanes(len(few_places(features)))  # noqa: N806

    @wp.func
    def changes_of_quads(t: Any, params: Any, d11: Lanes4, d12: Lanes4, r11: Lanes4, r12: Lanes4):
        """Return both, and the changes of energies by the numbers.

        Args:
            r11: changes of the products d11.
            r12: changes of the products d12.
        """
        material = t.all.membranes.materials[params.balloon]
        found = QuadTensions()
        by_numbers = FewLanes()
        for corner in range(t.quad_triangles[params.number]):
            before = (corner + 3) % 4
            metric = Lanes3()
            metric[0] = d11[corner]
            metric[1] = d12[corner]
            metric[2] = d11[before]
            change = Lanes3()
            change[0] = r11[corner]
            change[1] = r12[corner]
            change[2] = r11[before]
            rests = in_lanes(t.quad_rests[4 * params.number + corner])
            tensions, by_few = changes_of_triangles(metric, change, rests, material, params.n)
            by_numbers += by_few
            found.along[corner] = tensions[0]
            found.mixed[corner] = tensions[1]
            found.back[before] = tensions[2]
            found.along_change[corner] = tensions[3]
            found.mixed_change[corner] = tensions[4]
            found.back_change[before] = tensions[5]
        return found, by_numbers

    return changes_of_quads


@cache
def quad_adjoint(features: Features, at: Any, add_to_corners: Any) -> Adjoint:
    """Return the adjoint, which adds to the bars of the corners' places, and returns the numbers'.

    Args:
        at: the function that reads eight vectors.
        add_to_corners: the one that adds to the corners of eight quads.
    """
    changes = changes_function(features)

    @wp.func
    def turn_quads(t: Any, points: Any, params: Any, force_bars: Any, point_bars: Any):
        corners = 4 * params.number
        first = entry_at(t.quads, corners)
        second = entry_at(t.quads, corners + 1)
        third = entry_at(t.quads, corners + 2)
        fourth = entry_at(t.quads, corners + 3)
        a = at(points, first)
        b = at(points, second)
        c = at(points, third)
        d = at(points, fourth)
        ab = b - a
        bc = c - b
        cd = d - c
        da = a - d
        of_a = at(force_bars, first)
        of_b = at(force_bars, second)
        of_c = at(force_bars, third)
        of_d = at(force_bars, fourth)
        d11, d12 = products_of(ab, bc, cd, da)
        r11, r12 = rates_of(ab, bc, cd, da, of_a, of_b, of_c, of_d)
        found, by_numbers = changes(t, params, d11, d12, r11, r12)
        on_a, on_b, on_c, on_d = pulls_on_corners(
            of_b - of_a, of_c - of_b, of_d - of_c, of_a - of_d, found.along, found.mixed, found.back
        )
        by_a, by_b, by_c, by_d = pulls_on_corners(
            ab, bc, cd, da, found.along_change, found.mixed_change, found.back_change
        )
        add_to_corners(point_bars, first, second, third, fourth, on_a + by_a, on_b + by_b, on_c + by_c, on_d + by_d)
        return -by_numbers

    return Adjoint(turn_quads, ("numbers",), columns=few_places(features))


def quads_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of the forces of quads.

    Raises:
        NoAdjointError: the membrane is viscous, or wears.
    """
    if features.viscous or features.wears:
        raise NoAdjointError("a membrane that is viscous, softens or bursts, where eight go side by side")
    return [quad_adjoint(features, look.at, look.add_to_corners)]

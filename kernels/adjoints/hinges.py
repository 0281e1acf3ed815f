"""Adjoint of the loop over a particle's hinges: torsion.

A hinge's part in the sum over all particles of force . bar is that of its four places, where the bar of a wing is the
mean of its corners'. Warp derives it by the places; each particle takes its own bar, and the first end of an edge the
numbers'.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.torsion import FIRST_END, FIRST_WING, SECOND_WING, angle_beyond
from balloon_warp.kernels.loops.hinges import place_function, wing_size
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.tables import Tables

SECOND_END = wp.constant(1)


@cache
def hinge_adjoint(features: Features, at: Any) -> Adjoint:
    """Return the adjoint that gathers bars of a particle's place, and of its balloon's numbers."""
    laws, places_of_hinge = features.laws_on("hinge"), place_function(at)
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def work_of_hinge(
        a: wp.vec3, b: wp.vec3, first: wp.vec3, second: wp.vec3, rest_angle: float, n: Any, a_bar: wp.vec3,
        b_bar: wp.vec3, first_bar: wp.vec3, second_bar: wp.vec3,
    ):  # fmt: skip
        bend = angle_beyond(a, b, first, second, rest_angle)
        return (
            wp.dot(laws(FIRST_END, a, b, first, second, bend, n), a_bar)
            + wp.dot(laws(SECOND_END, a, b, first, second, bend, n), b_bar)
            + wp.dot(laws(FIRST_WING, a, b, first, second, bend, n), first_bar)
            + wp.dot(laws(SECOND_WING, a, b, first, second, bend, n), second_bar)
        )

    @wp.func
    def hinges_adjoint(t: Tables, points: Any, params: Any, force_bars: Any):
        point_bar = wp.vec3()
        params_bar = Params()
        for entry in range(t.hinges.particle_offsets[params.number], t.hinges.particle_offsets[params.number + 1]):
            packed = t.hinges.particle_roles[entry]
            hinge = packed >> 2
            role = packed & 3
            a, b, first, second = places_of_hinge(t.hinges, points, hinge)
            a_bar, b_bar, first_bar, second_bar = places_of_hinge(t.hinges, force_bars, hinge)
            by_a, by_b, by_first, by_second, _rest, by_n, _a, _b, _first, _second = wp.grad(work_of_hinge)(
                a, b, first, second, t.hinges.rest_angles[hinge], params.n, a_bar, b_bar, first_bar, second_bar
            )
            if role == FIRST_END:
                point_bar += by_a
                params_bar.n += by_n
            elif role == SECOND_END:
                point_bar += by_b
            elif role == FIRST_WING:
                point_bar += by_first / float(wing_size(t.hinges, hinge, 0))
            else:
                point_bar += by_second / float(wing_size(t.hinges, hinge, 1))
        return point_bar, params_bar

    return Adjoint(hinges_adjoint, ("point", "params"))

"""Adjoint of area vectors: the second derivative of a closed balloon's volume, times a bar.

An area vector a is the gradient of the volume V, whose second derivative is symmetric. So the sum over all particles of
a' . bar, derived by a place x, is the derivative of x's own area vector along the bars: it is gathered around x, in
the loop that finds a. Bars count relative to that of x, as places do, since a common shift leaves a as it is.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.adjoints.eights import areas_of_eight
from balloon_warp.kernels.loops.areas import CROSSES, plus_cross
from balloon_warp.kernels.memory import triple_at
from balloon_warp.kernels.tables import SLICE, FanTable, Tables, first_entry


@cache
def area_adjoint(quads: bool, at: Any) -> Adjoint:
    """Return the adjoint that gathers the bar of a particle's place from bars of area vectors."""

    @wp.func
    def back_in_quads(fans: FanTable, points: Any, bars: Any, particle: wp.int32, point: wp.vec3, bar: wp.vec3):
        """Return the bar of the place of a particle whose faces are all quads."""
        total = wp.vec3()
        begin = first_entry(fans.slice_offsets, particle)
        for entry in range(begin, begin + SLICE * fans.counts[particle], SLICE):
            others = triple_at(fans.quads, entry)
            before = at(points, others[0]) - point
            before_bar = at(bars, others[0]) - bar
            across = before + (at(points, others[1]) - point)
            across_bar = before_bar + (at(bars, others[1]) - bar)
            chord = at(points, others[2]) - point - before
            chord_bar = at(bars, others[2]) - bar - before_bar
            total = plus_cross(plus_cross(total, chord_bar, across), chord, across_bar)
        return CROSSES * total

    @wp.func
    def back_in_faces(fans: FanTable, points: Any, bars: Any, particle: wp.int32, point: wp.vec3, bar: wp.vec3):
        """Return the bar of the place of a particle with faces of any number of corners."""
        total = wp.vec3()
        for corner in range(fans.offsets[particle], fans.offsets[particle + 1]):
            begin = fans.begins[corner]
            end = fans.begins[corner + 1]
            first = at(points, fans.particles[begin]) - point
            first_bar = at(bars, fans.particles[begin]) - bar
            arm = first
            arm_bar = first_bar
            arms = first
            arms_bar = first_bar
            double_area = wp.vec3()
            for other in range(begin + 1, end):
                next_arm = at(points, fans.particles[other]) - point
                next_bar = at(bars, fans.particles[other]) - bar
                double_area += wp.cross(arm_bar, next_arm) + wp.cross(arm, next_bar)
                arms += next_arm
                arms_bar += next_bar
                arm = next_arm
                arm_bar = next_bar
            turned = wp.cross(first_bar - arm_bar, arms) + wp.cross(first - arm, arms_bar)
            total += (double_area + turned) * (0.5 / (3.0 * float(end - begin + 1)))
        return total

    back = back_in_quads if quads else back_in_faces

    @wp.func
    def areas_adjoint(
        t: Tables, points: Any, params: Any, point: wp.vec3, area_vector_bar: wp.vec3, area_vector_bars: Any
    ):
        return back(t.fans, points, area_vector_bars, params.number, point, area_vector_bar)

    return Adjoint(areas_adjoint, ("point",), of_eight=areas_of_eight() if quads else None)


@cache
def ring_area_adjoint(shear_begin: int, least_valence: int, at: Any) -> Adjoint:
    """Return the adjoint that gathers it around a particle whose springs are in slots, see `loops.slots.ring_area`.

    Args:
        shear_begin: slots of structural springs.
        least_valence: quads around each particle that there are at least.
    """

    @wp.func
    def areas_adjoint(points: Any, springs: Any, point: wp.vec3, area_vector_bar: wp.vec3, area_vector_bars: Any):
        total = wp.vec3()
        first = at(points, springs.neighbors[0]) - point
        first_bar = at(area_vector_bars, springs.neighbors[0]) - area_vector_bar
        before = first
        before_bar = first_bar
        for slot in range(1, shear_begin + 1):
            across = before + (at(points, springs.neighbors[shear_begin + slot - 1]) - point)
            across_bar = before_bar + (
                at(area_vector_bars, springs.neighbors[shear_begin + slot - 1]) - area_vector_bar
            )
            after = first
            after_bar = first_bar
            if slot < shear_begin:
                after = at(points, springs.neighbors[slot]) - point
                after_bar = at(area_vector_bars, springs.neighbors[slot]) - area_vector_bar
            end = after
            end_bar = after_bar
            if slot >= least_valence and slot < shear_begin:
                end = wp.where(slot == springs.valence, first, after)
                end_bar = wp.where(slot == springs.valence, first_bar, after_bar)
            total = plus_cross(plus_cross(total, end_bar - before_bar, across), end - before, across_bar)
            before = after
            before_bar = after_bar
        return CROSSES * total

    return Adjoint(areas_adjoint, ("point",))

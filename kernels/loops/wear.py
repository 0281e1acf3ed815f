"""Membranes that soften or tear: the remaining tension of a triangle, and its stress."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import choice_of_energies, choice_of_laws
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import number_in
from balloon_warp.kernels.laws.softening import softened
from balloon_warp.kernels.laws.tearing import true_stress
from balloon_warp.kernels.laws.tension_field import LEAST_DET, invariants_of, is_taut, mixed_stretch, relaxed
from balloon_warp.kernels.tables import Tables, row_of_world


@cache
def wear_of_triangle(features: Features) -> Any:
    """Return the function for the wear of a triangle, from the dot products of its edges as in `loops.membranes`.

    It returns the factor on the tension, the greatest energy density so far, and the larger principal true stress.
    """
    energy_of_law = choice_of_energies(features.membranes, features.columns)
    slopes_of_law = choice_of_laws(features.membranes, features.columns)
    wrinkling = features.columns.places["wrinkling"]

    @wp.func
    def wear(
        t: Tables, world: wp.int32, balloon: wp.int32, material: wp.int32, metric: wp.vec3, rest: wp.vec4, peak: float,
        n: Any, lane: wp.int32,
    ):  # fmt: skip
        """Return the factor on the tension [1], the greatest energy density and the larger stress [Pa]."""
        trace, area_squared, spread = invariants_of(mixed_stretch(metric, rest))
        det = wp.max(area_squared, LEAST_DET)
        major = 0.5 * (trace + spread)
        stretched = wp.max(major, 1.0)
        stretch = wp.sqrt(stretched)
        across = 1.0 / stretch
        wrinkles = number_in(n, wrinkling, lane)
        taut = is_taut(det, stretch, wrinkles)
        law_trace = wp.where(taut, trace, stretched + across)
        law_det = wp.where(taut, det, stretch)
        law_spread = wp.where(taut, spread, stretched - across)
        left = float(1.0)
        greatest = float(0.0)
        stress = float(0.0)
        if wp.static(features.softens):
            energy = wp.max(energy_of_law(law_trace, law_det, law_spread, material, n, lane), 0.0)
            greatest = wp.max(peak, energy)
            table = t.membranes.wear
            left = softened(
                energy, greatest,
                of_balloon(table.softening, world, balloon),
                of_balloon(table.softening_energy, world, balloon),
                of_balloon(table.softening_share, world, balloon),
            )  # fmt: skip
        if wp.static(features.bursts):
            by_trace, by_det = slopes_of_law(law_trace, law_det, law_spread, material, n, lane)
            by_trace, by_det = relaxed(by_trace, by_det, major, spread, across, taut, wrinkles)
            stress = left * true_stress(by_trace, by_det, major, major - spread)
        return left, greatest, stress

    return wear


@wp.func
def of_balloon(values: wp.array2d[float], world: wp.int32, balloon: wp.int32):
    """Return a balloon's parameter in a world."""
    return values[row_of_world(world, values.shape[0]), balloon]

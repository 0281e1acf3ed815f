"""Membranes: triangle by triangle, and those of a particle.

The energy of a triangle is a function of its edges' products alone, so that its forces are a combination of its edges:
on the corner that edges d1 and d2 begin at, (T11 + T12) d1 + (T12 + T22) d2, with the tensions T along them.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import scaled
from balloon_warp.kernels.compose import choice_of_laws
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import number_in
from balloon_warp.kernels.laws.tension_field import (
    LEAST_DET,
    compliance_of,
    elastic_tension,
    invariants_of,
    is_taut,
    mixed_stretch,
    relaxed,
    viscous_tension,
)
from balloon_warp.kernels.memory import four_floats_at, int_pair_at
from balloon_warp.kernels.tables import SLICE, MembraneTable, first_entry


@wp.func
def pulls_on_corners(ab: Any, bc: Any, cd: Any, da: Any, along: Any, mixed: Any, back: Any):
    """Return the forces on the corners of a quad [N], or of eight quads: those on the ends of each edge are opposite.

    Args:
        along: T11 of the triangle at each corner [N/m].
        mixed: its T12.
        back: T22 of the triangle at the next corner.
    """
    by_ab = scaled(ab, along[0] + back[0]) - scaled(da, mixed[0]) - scaled(bc, mixed[1])
    by_bc = scaled(bc, along[1] + back[1]) - scaled(ab, mixed[1]) - scaled(cd, mixed[2])
    by_cd = scaled(cd, along[2] + back[2]) - scaled(bc, mixed[2]) - scaled(da, mixed[3])
    by_da = scaled(da, along[3] + back[3]) - scaled(cd, mixed[3]) - scaled(ab, mixed[0])
    return by_ab - by_da, by_bc - by_ab, by_cd - by_bc, by_da - by_cd


@wp.func
def pulls_between_corners(
    ab: wp.vec3, bc: wp.vec3, cd: wp.vec3, da: wp.vec3, ac: wp.vec3, bd: wp.vec3, along: wp.vec4, across: wp.vec2
):
    """Return the forces on the corners of a quad [N], whose sum is zero.

    Args:
        along: pulls of edges over their vectors [N/m].
        across: those of both diagonals.
    """
    on_a = along[0] * ab - along[3] * da + across[0] * ac
    on_b = along[1] * bc - along[0] * ab + across[1] * bd
    on_c = along[2] * cd - along[1] * bc - across[0] * ac
    return on_a, on_b, on_c, -1.0 * (on_a + on_b) - on_c


@cache
def tension_function(features: Features) -> Any:
    """Return the function for the tensions along a triangle's edges."""
    slopes_of_law = choice_of_laws(features.membranes, features.columns)
    columns = features.columns.places
    thickness, wrinkling, damping = (columns[name] for name in ("thickness", "wrinkling", "film_viscosity"))

    @wp.func
    def tension(metric: wp.vec3, rate: wp.vec3, rest: wp.vec4, material: wp.int32, n: Any, lane: wp.int32):
        """Return T11, T12 and T22 [N/m].

        Args:
            metric: d1 . d1, d1 . d2 and d2 . d2 [m^2].
            rate: of their change [m^2/s].
            rest: see `MembraneTable`.
            lane: of the numbers, where they are of eight lanes.
        """
        wrinkles = number_in(n, wrinkling, lane)
        mixed = mixed_stretch(metric, rest)
        trace, area_squared, spread = invariants_of(mixed)
        det = wp.max(area_squared, LEAST_DET)
        major = 0.5 * (trace + spread)
        stretched = wp.max(major, 1.0)
        stretch = wp.sqrt(stretched)
        across = 1.0 / stretch
        taut = is_taut(det, stretch, wrinkles)
        by_trace, by_det = slopes_of_law(
            wp.where(taut, trace, stretched + across),
            wp.where(taut, det, stretch),
            wp.where(taut, spread, stretched - across),
            material, n, lane,
        )  # fmt: skip
        by_trace, by_det = relaxed(by_trace, by_det, major, spread, across, taut, wrinkles)
        double_volume = rest[3] * (2.0 * number_in(n, thickness, lane))
        tensions = elastic_tension(metric, rest, by_trace, by_det, double_volume)
        if wp.static(features.viscous):
            inverse = compliance_of(rest, metric) / det
            tensions += (0.5 * double_volume) * viscous_tension(
                mixed, rate, rest, inverse, major, spread, taut, wrinkles, number_in(n, damping, lane)
            )
        return tensions

    return tension


@cache
def taut_tension_function(features: Features) -> Any:
    """Return a faster function for the tensions of a triangle that is surely taut, without damping.

    It gives the same bits, so that a triangle's do not depend on its neighbors. See `how_surely_taut`.
    """
    slopes_of_law = choice_of_laws(features.membranes, features.columns)
    thickness = features.columns.places["thickness"]

    @wp.func
    def taut_tension(metric: wp.vec3, rest: wp.vec4, material: wp.int32, n: Any, lane: wp.int32):
        """Return T11, T12 and T22 [N/m]."""
        trace, det, spread = invariants_of(mixed_stretch(metric, rest))  # the last is left out where no law asks for it
        by_trace, by_det = slopes_of_law(trace, det, spread, material, n, lane)
        double_volume = rest[3] * (2.0 * number_in(n, thickness, lane))
        return elastic_tension(metric, rest, by_trace, by_det, double_volume)

    return taut_tension


@cache
def triangle_pull(features: Features) -> Any:
    """Return the function for a triangle's force on the corner that its two edges begin at."""
    tension = tension_function(features)

    @wp.func
    def pull_of_triangle(d1: wp.vec3, d2: wp.vec3, v1: wp.vec3, v2: wp.vec3, rest: wp.vec4, material: wp.int32, n: Any):
        """Return the force on a particle, and those on the ends of both edges [N].

        Args:
            d1: the first edge [m].
            v1: how fast it changes [m/s].
        """
        metric = wp.vec3(wp.dot(d1, d1), wp.dot(d1, d2), wp.dot(d2, d2))
        rate = wp.vec3()
        if wp.static(features.viscous):
            rate = wp.vec3(2.0 * wp.dot(d1, v1), wp.dot(d1, v2) + wp.dot(v1, d2), 2.0 * wp.dot(d2, v2))
        t = tension(metric, rate, rest, material, n, 0)
        first = -(t[0] * d1 + t[1] * d2)
        second = -(t[1] * d1 + t[2] * d2)
        return -(first + second), first, second

    return pull_of_triangle


@cache
def membrane_loop(features: Features, at: Any, velocity_at: Any) -> Any:
    """Return the function that sums the triangles of a particle."""
    pull_of_triangle = triangle_pull(features)

    @wp.func
    def pull_of_membrane(
        membranes: MembraneTable,
        points: Any,
        velocities: Any,
        world: wp.int32,
        particle: wp.int32,
        balloon: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
        n: Any,
    ):
        """Return the net force of the membrane on a particle [N]."""
        force = wp.vec3()
        material = membranes.materials[balloon]
        begin = first_entry(membranes.slice_offsets, particle)
        for entry in range(begin, begin + SLICE * membranes.counts[particle], SLICE):
            others = int_pair_at(membranes.others, entry)
            v1 = wp.vec3()
            v2 = wp.vec3()
            if wp.static(features.viscous):
                v1 = velocity_at(velocities, others[0]) - velocity
                v2 = velocity_at(velocities, others[1]) - velocity
            pull, _first, _second = pull_of_triangle(
                at(points, others[0]) - point, at(points, others[1]) - point, v1, v2,
                four_floats_at(membranes.rests, entry), material, n,
            )  # fmt: skip
            if wp.static(features.wears):
                pull *= membranes.wear.left[world, membranes.wear.numbers[entry]]
            force += pull
        return force

    return pull_of_membrane

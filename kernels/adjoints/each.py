"""Derivatives by the numbers of each spring, and of each triangle of a membrane: a thread has one, once a substep.

They follow from how much the forces on particles are worth, which are known once all particles have run backwards.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.membranes import triangle_work
from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.springs import constant_of_kind
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import numbers_reader, time_of
from balloon_warp.kernels.tables import Tables


@cache
def springs_back_kernel(features: Features) -> Any:
    """Return the kernel that adds to the bars of each spring's rest length and constant."""
    coefficient = features.laws_on("spring")
    read_numbers = numbers_reader(features.columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def springs_back(
        t: Tables,
        frame: wp.array[wp.int32],
        time_in_frame: float,
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        force_bars: wp.array2d[wp.vec3],
        bars: wp.array2d[wp.vec2d],
    ):
        """Add the bars of a substep; a thread a (world, spring)."""
        world, spring = wp.tid()
        p = t.pairs.particles[spring][0]
        q = t.pairs.particles[spring][1]
        n = read_numbers(t, world, t.particles.balloon[p])
        stiffness = constant_of_kind(n, t.pairs.kinds[spring]) * t.pairs.scales[spring]
        length = t.pairs.rest_lengths[spring]
        d = points[world, q] - points[world, p]
        opening = wp.dot(velocities[world, q] - velocities[world, p], d)
        time = time_of(t, frame, time_in_frame)
        _squared, _opening, by_length, by_k, by_product, _step, _time, _n = wp.grad(coefficient)(
            squared_length(d), opening, length, stiffness, stiffness * length, t.step_seconds, time, n
        )
        along = wp.dot(d, force_bars[world, p] - force_bars[world, q])
        by_length = along * (by_length + stiffness * by_product)
        bars[world, spring] += wp.vec2d(wp.float64(by_length), wp.float64(along * (by_k + length * by_product)))

    return springs_back


@cache
def triangles_back_kernel(features: Features) -> Any:
    """Return the kernel that adds to the bars of each triangle's rest metric and area."""
    work_of_triangle = triangle_work(features)
    read_numbers = numbers_reader(features.columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def triangles_back(
        t: Tables,
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        force_bars: wp.array2d[wp.vec3],
        bars: wp.array2d[wp.vec4d],
    ):
        """Add the bars of a substep; a thread a (world, triangle)."""
        world, triangle = wp.tid()
        corners = t.membranes.corners[triangle]
        rest = t.membranes.corner_rests[triangle]
        balloon = t.particles.balloon[corners[0]]
        d1 = points[world, corners[1]] - points[world, corners[0]]
        d2 = points[world, corners[2]] - points[world, corners[0]]
        v1 = velocities[world, corners[1]] - velocities[world, corners[0]]
        v2 = velocities[world, corners[2]] - velocities[world, corners[0]]
        bar = force_bars[world, corners[0]]
        _d1, _d2, _v1, _v2, _n, by_rest, _material, _b1, _b2 = wp.grad(work_of_triangle)(
            d1, d2, v1, v2, read_numbers(t, world, balloon), rest, t.membranes.materials[balloon],
            force_bars[world, corners[1]] - bar, force_bars[world, corners[2]] - bar,
        )  # fmt: skip
        if wp.isfinite(by_rest):  # exactly at rest, the root of how far stretches differ has no slope
            bars[world, triangle] += wp.vec4d(by_rest)

    return triangles_back

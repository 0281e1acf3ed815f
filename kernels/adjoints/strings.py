"""Adjoint of the strings that hold a particle: Warp derives each. Their anchors, lengths and stiffness are constant."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.clock import time_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.strings import anchor_function, string_pull
from balloon_warp.kernels.memory import int_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.outer_tables import StringTable
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.tables import Tables, row_of_world

StringBars = wp.types.vector(length=5, dtype=wp.float64)
"""Derivatives by a string's anchor, length and stiffness"""


@cache
def string_adjoint(features: Features) -> Adjoint:
    """Return the adjoint of a particle's strings, for its place and its velocity."""
    pull_of_string = string_pull(features)

    @wp.func
    def work_of_string(
        point: wp.vec3, velocity: wp.vec3, bar: wp.vec3, strings: StringTable, world: wp.int32, string: wp.int32,
        n: Any, step_seconds: float, time: float,
    ):  # fmt: skip
        return wp.dot(pull_of_string(strings, world, string, point, velocity, n, step_seconds, time), bar)

    @wp.func
    def strings_adjoint(t: Tables, params: Any, point: wp.vec3, velocity: wp.vec3, time: float, force_bar: wp.vec3):
        point_bar = wp.vec3()
        velocity_bar = wp.vec3()
        for held in range(int_at(t.strings.offsets, params.number), int_at(t.strings.offsets, params.number + 1)):
            by_point, by_velocity, _bar, _strings, _world, _string, _n, _step, _time = wp.grad(work_of_string)(
                point,
                velocity,
                force_bar,
                t.strings,
                params.world,
                t.strings.order[held][0],
                params.n,
                t.step_seconds,
                time,
            )
            point_bar += by_point
            velocity_bar += by_velocity
        return point_bar, velocity_bar

    return Adjoint(strings_adjoint, ("point", "velocity"))


@cache
def strings_back_kernel(features: Features) -> Any:
    """Return the kernel that adds to the bars of each string's anchor, length and stiffness."""
    coefficient, read_numbers = features.laws_on("string"), numbers_reader(features.columns)
    anchor_at = anchor_function(features)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def strings_back(
        t: Tables, frame: wp.array[wp.int32], time_in_frame: float, points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3], force_bars: wp.array2d[wp.vec3], bars: wp.array2d[StringBars],
    ):  # fmt: skip
        """Add the bars of a substep; a thread a (world, string)."""
        world, held = wp.tid()
        particle = t.strings.particles[held]
        string = t.strings.order[held][0]
        n = read_numbers(t, world, t.particles.balloon[particle])
        time = time_of(t, frame, time_in_frame)
        d = anchor_at(t.strings, world, string, time) - points[world, particle]
        length = t.strings.lengths[row_of_world(world, t.strings.lengths.shape[0]), string]
        stiffness = t.strings.stiffness[row_of_world(world, t.strings.stiffness.shape[0]), string]
        velocity = velocities[world, particle]
        squared = squared_length(d)
        opening = -wp.dot(velocity, d)
        product = stiffness * length
        pull = coefficient(squared, opening, length, stiffness, product, t.step_seconds, time, n)
        by_squared, by_opening, by_length, by_k, by_product, _step, _time, _n = wp.grad(coefficient)(
            squared, opening, length, stiffness, product, t.step_seconds, time, n
        )
        bar = force_bars[world, particle]
        along = wp.dot(d, bar)
        by_anchor = pull * bar + along * (2.0 * by_squared * d - by_opening * velocity)
        bars[world, string] += StringBars(
            wp.float64(by_anchor[0]), wp.float64(by_anchor[1]), wp.float64(by_anchor[2]),
            wp.float64(along * (by_length + stiffness * by_product)), wp.float64(along * (by_k + length * by_product)),
        )  # fmt: skip

    return strings_back

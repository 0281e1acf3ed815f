"""Adjoint of the strings that hold a particle: Warp derives each. Their anchors, lengths and stiffness are constant."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.strings import string_pull
from balloon_warp.kernels.memory import int_at
from balloon_warp.kernels.outer_tables import StringTable
from balloon_warp.kernels.tables import Tables


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
                t.strings.order[held],
                params.n,
                t.step_seconds,
                time,
            )
            point_bar += by_point
            velocity_bar += by_velocity
        return point_bar, velocity_bar

    return Adjoint(strings_adjoint, ("point", "velocity"))

"""Adjoint of `pull`: first of the laws on a particle, then, once all particles have their bars, of what is around."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint, NoAdjointError
from balloon_warp.kernels.adjoints.areas import area_adjoint
from balloon_warp.kernels.adjoints.membranes import membrane_adjoint
from balloon_warp.kernels.adjoints.springs import spring_adjoint
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits

UNKNOWN = ("string", "hinge", "face")


def pull_backwards(phase: Phase, traits: Traits, look: Look) -> Sequence[Adjoint]:
    """Return the adjoints of the forces on a particle."""
    for kind in UNKNOWN:
        if laws := traits.of_kind(kind):
            raise NoAdjointError(f"the law `{laws[0].name}`")
    if traits.in_water:
        raise NoAdjointError("the law `water`")
    if traits.air_varies and traits.needs("particle", "air"):
        raise NoAdjointError("air that differs from place to place")
    found = [_laws(traits)] if traits.of_kind("particle") else []
    found.append(spring_adjoint(traits, vector_at))
    if traits.membranes:
        found.append(membrane_adjoint(traits, vector_at))
    if traits.measures_areas:
        found.append(area_adjoint(traits.quads, vector_at))
    return found


def _laws(traits: Traits) -> Adjoint:
    """Return the adjoint of the laws on a particle, which Warp derives."""
    laws = traits.laws_added("particle")
    Own, _ = own_functions(traits.columns, traits.balloons)  # noqa: N806 - a type

    @wp.func
    def work_of_laws(
        point: wp.vec3, velocity: wp.vec3, mass: float, share: float, area_vector: wp.vec3, up: wp.vec3,
        step_seconds: float, time: float, n: Any, bar: wp.vec3,
    ):  # fmt: skip
        force = laws(wp.vec3(), point, velocity, mass, share, area_vector, wp.vec4(), up, step_seconds, time, n)
        return wp.dot(force, bar)

    @wp.func
    def laws_adjoint(
        t: Tables, own: Any, point: wp.vec3, velocity: wp.vec3, area_vector: wp.vec3, time: float, force_bar: wp.vec3
    ):
        by_point, by_velocity, by_mass, _share, by_area, _up, _step, _time, by_n, _bar = wp.grad(work_of_laws)(
            point, velocity, own.mass, own.share, area_vector, t.up, t.step_seconds, time, own.n, force_bar
        )
        own_bar = Own()
        own_bar.mass = by_mass
        own_bar.n = by_n
        return by_point, by_velocity, by_area, own_bar

    return Adjoint(laws_adjoint, ("point", "velocity", "area_vector", "own"))

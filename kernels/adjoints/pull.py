"""Adjoint of `pull`: first of the laws on a particle, then, once all particles have bars, of the loops around it."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.adjoints.areas import area_adjoint, ring_area_adjoint
from balloon_warp.kernels.adjoints.hinges import hinge_adjoint
from balloon_warp.kernels.adjoints.lanes import pull_of_eight
from balloon_warp.kernels.adjoints.membrane_faces import membrane_faces_adjoint
from balloon_warp.kernels.adjoints.membranes import membrane_adjoint
from balloon_warp.kernels.adjoints.springs import spring_adjoint
from balloon_warp.kernels.adjoints.strings import string_adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables


def pull_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoints of the forces on a particle."""
    if look.world:
        return pull_of_eight(features, look.at)
    found = [_laws(features)] if features.of_kind("particle") else []
    if features.has("string"):
        found.append(string_adjoint(features))
    found.append(spring_adjoint(features, look.at, look.slots))
    if features.membranes:
        faces = None if features.viscous else look.membrane_faces(features)
        found.append(
            membrane_faces_adjoint(features, faces.layout, faces.keeps_places)
            if faces
            else membrane_adjoint(features, look.at)
        )
    if features.has("hinge"):
        found.append(hinge_adjoint(features, look.at))
    if features.measures_areas:
        ring = ring_area_adjoint(look.slots[0], look.ring, look.at) if look.slots and look.ring else None
        found.append(ring or area_adjoint(features.quads, look.at))
    return found


def _laws(features: Features) -> Adjoint:
    """Return the adjoint of the laws on a particle, which Warp derives."""
    laws = features.laws_added("particle")
    Params, _ = params_functions(features.columns, features.balloons)  # noqa: N806 - a type

    @wp.func
    def work_of_laws(
        point: wp.vec3, velocity: wp.vec3, mass: float, share: float, area_vector: wp.vec3, up: wp.vec3,
        step_seconds: float, time: float, n: Any, bar: wp.vec3, water_load: wp.vec4,
    ):  # fmt: skip
        force = laws(wp.vec3(), point, velocity, mass, share, area_vector, water_load, up, step_seconds, time, n)
        return wp.dot(force, bar)

    @wp.func
    def laws_adjoint(
        t: Tables, params: Any, point: wp.vec3, velocity: wp.vec3, area_vector: wp.vec3, time: float, force_bar: wp.vec3
    ):
        by_point, by_velocity, by_mass, _share, by_area, _up, _step, _time, by_n, _bar, _load = wp.grad(work_of_laws)(
            point, velocity, params.mass, params.share, area_vector, t.up, t.step_seconds, time, params.n, force_bar,
            wp.vec4(),
        )  # fmt: skip
        params_bar = Params()
        params_bar.mass = by_mass
        params_bar.n = by_n
        return by_point, by_velocity, by_area, params_bar

    @wp.func
    def laws_adjoint_in_water(
        t: Tables, params: Any, point: wp.vec3, velocity: wp.vec3, area_vector: wp.vec3, water_load: wp.vec4,
        time: float, force_bar: wp.vec3,
    ):  # fmt: skip
        by_point, by_velocity, by_mass, _share, by_area, _up, _step, _time, by_n, _bar, by_load = wp.grad(
            work_of_laws
        )(
            point, velocity, params.mass, params.share, area_vector, t.up, t.step_seconds, time, params.n, force_bar,
            water_load,
        )  # fmt: skip
        params_bar = Params()
        params_bar.mass = by_mass
        params_bar.n = by_n
        return by_point, by_velocity, by_area, by_load, params_bar

    if features.in_water:
        return Adjoint(laws_adjoint_in_water, ("point", "velocity", "area_vector", "water_load", "params"))
    return Adjoint(laws_adjoint, ("point", "velocity", "area_vector", "params"))

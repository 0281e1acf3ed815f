"""Phases from outside the package, and the step with them."""
# pyright: reportGeneralTypeIssues=false

from typing import Any

import pytest
import warp as wp

from balloon_warp.kernels import substep
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws import Parameter
from balloon_warp.kernels.phase import Look, Phase, phase
from balloon_warp.kernels.tables import Tables, sphere_number

START = 300.0
"""of temperatures [K]"""


@phase(
    "particle",
    {"velocity": wp.vec3},
    rows=(
        Parameter("slow_radius", "m", least=0.0, of="sphere"),
        Parameter("slowing", "1/s", least=0.0, of="sphere", meaning="how fast what is within loses its speed"),
    ),
    neutral={"slowing": 0.0},
)
def slow(features: Features, look: Look) -> Any:
    """Slow a particle that is near a sphere."""
    sphere_at, places = look.sphere_at, features.columns.places_of_spheres
    radius, slowing = places["slow_radius"], places["slowing"]

    @wp.func
    def slow(t: Tables, spheres: Any, params: Any, point: wp.vec3, velocity: wp.vec3):
        slowed = velocity
        for sphere in range(t.spheres.numbers.shape[1]):
            center, _motion, _radius = sphere_at(t, spheres, params.world, sphere)
            if wp.length(point - center) < sphere_number(t.spheres, params.world, sphere, radius):
                slowed = slowed / (1.0 + t.step_seconds * sphere_number(t.spheres, params.world, sphere, slowing))
        return slowed

    return slow


@phase(
    "particle",
    {"temperature": float},
    rows=(
        Parameter("warming_seconds", "s", 1.0, least=1.0e-6),
        Parameter("weakening", "1/K", meaning="part of a particle's forces that a kelvin takes"),
    ),
    neutral={"weakening": 0.0},
    keeps={"temperature": START},
)
def warm(features: Features, look: Look) -> Any:
    """Let a particle's temperature follow the air's [K]."""

    @wp.func
    def warm(t: Tables, temperature: float, air_temperature: float, warming_seconds: float):
        part = t.step_seconds / (warming_seconds + t.step_seconds)
        return temperature + part * (air_temperature - temperature)

    return warm


@phase("particle", {"force": wp.vec3}, neutral={"weakening": 0.0})
def weaken(features: Features, look: Look) -> Any:
    """Weaken the pull on a particle that is warm."""

    @wp.func
    def weaken(force: wp.vec3, temperature: float, weakening: float):
        return (1.0 - weakening * (temperature - START)) * force

    return weaken


def list_after(patch: pytest.MonkeyPatch, line: str, *more: Phase) -> None:
    """Insert phases into the list of the step, after the one of a name."""
    names = [each.name for each in substep.STEP]
    place = names.index(line) + 1
    patch.setattr(substep, "STEP", (*substep.STEP[:place], *more, *substep.STEP[place:]))

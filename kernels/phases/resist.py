"""Answer of a particle to forces in a medium that resists it.

Under the drag at the speed before a step, a light particle in a dense medium would turn back; under the drag averaged
over a step in which nothing else acts, it would become too fast. So forces and drag act together. Where both stay along
a line, m dv/dt = F - k |v| v has the solution

    v' = (v + g F) / (1 + g k |v|),  g = (h / m) tanh(t) / t,  t = (h / m) sqrt(k |F|):

it goes to the terminal speed sqrt(F / k), and never beyond, however long the step. F has the inflation, too: that of a
gas by its pressure of the substep before, which only g is told. The pressure of this one follows from what velocity a
force gives, g / (1 + g k |v|).
"""

from dataclasses import replace
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import by_grad
from balloon_warp.kernels.adjoints.directions import expect_backwards
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.phases.inflate import inflate
from balloon_warp.kernels.phases.move import damped_response

expect = replace(
    inflate, name="expect", writes={"expected": wp.vec3}, when=lambda features: features.resists,
    adjoint=expect_backwards,
)  # fmt: skip
"""The force of the inflation on a particle by the pressure that is known so far [N]"""


SERIES = 1.0e-3
"""Square below which the hyperbolic tangent is taken by its series"""


@wp.func
def tangent_ratio(squared: float):
    """Return tanh(t) / t by the square of t."""
    ratio = 1.0 - squared / 3.0
    if squared > SERIES:
        root = wp.sqrt(squared)
        ratio = wp.tanh(root) / root
    return ratio


@phase(
    "particle", {"gain": float, "free_velocity": wp.vec3}, when=lambda features: features.resists, adjoint=by_grad
)  # fmt: skip
def resist(features: Features, look: Look) -> Any:
    """Find the velocity that a force gives a particle in a medium, and accelerate it by all but the inflation."""
    resistance = features.resistance
    place = features.columns.places["damping"] if features.damped else -1

    @wp.func
    def resist(
        t: Any, params: Any, inertia: float, point: wp.vec3, velocity: wp.vec3, force: wp.vec3, expected: wp.vec3,
        area_vector: wp.vec3, water_load: wp.vec4, time: float,
    ):  # fmt: skip
        k = resistance(
            point, velocity, params.mass, params.share, area_vector, water_load, t.up, t.step_seconds, time, params.n
        )
        damping = float(0.0)
        if wp.static(place >= 0):
            damping = params.n[place]
        gain = damped_response(inertia, params.share, damping, t.step_seconds)
        resisted = k * wp.length(velocity)
        others = force + resisted * velocity
        gain *= tangent_ratio(gain * gain * k * wp.length(others + expected))
        slower = 1.0 / (1.0 + gain * resisted)
        return slower * gain, slower * (velocity + gain * others)

    return resist

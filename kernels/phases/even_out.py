"""A liquid's pressure on a skin that is too soft to bear how much harder it presses below than above.

In a liquid at rest no such skin has a shape: it would dent until it meets itself, and the liquid with it would turn
inside out what crosses. So what the skin does not bear lifts the balloon as a whole.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import by_grad
from balloon_warp.kernels.adjoints.water import lift_backwards
from balloon_warp.kernels.codegen import function_from
from balloon_warp.kernels.compose import call_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Five
from balloon_warp.kernels.laws.water import EVENED, evened
from balloon_warp.kernels.phase import Look, phase

RESTS = {EVENED.name: 0.0}
"""Values at which skins bear all"""


def _evens(features: Features) -> bool:
    return features.in_water and features.gas


@phase("particle", {"afloat": Five}, when=_evens, sums=True, neutral=RESTS, adjoint=by_grad)
def find_lift(features: Features, look: Look) -> Any:
    """Sum a balloon's displaced volume [m^3], the height of its center of mass [m], and its volume [m^3]."""

    @wp.func
    def find_lift(t: Any, params: Any, point: wp.vec3, area_vector: wp.vec3, water_load: wp.vec4):
        height = wp.dot(point, t.up)
        lift = -(water_load[0] * t.up[0] + water_load[1] * t.up[1] + water_load[2] * t.up[2])
        return Five(lift, params.share * height, height * wp.dot(area_vector, t.up), 0.0, 0.0)

    return find_lift


@phase("particle", {"upheld": Five}, when=_evens, neutral=RESTS, adjoint=lift_backwards)
def read_lift(features: Features, look: Look) -> Any:
    """Read the sums of a balloon, each particle by itself: so bars add up."""

    @wp.func
    def read_lift(afloat: Any):
        return afloat

    return read_lift


@phase("particle", {"force": wp.vec3}, when=_evens, neutral=RESTS, adjoint=by_grad)
def even_out(features: Features, look: Look) -> Any:
    """Let the part of a liquid's pressure that a skin does not bear act evenly."""

    given = ["water_load", "area_vector", "share", "lift", "height", "volume", "up"]
    source = (
        f"def evened_here({', '.join(f'{name}: Any' for name in (*given, 'n'))}):\n"
        f"    return {call_of(evened, 'evened', given, features.columns)}\n"
    )
    evened_here = function_from("evened_here", source, {"evened": evened})

    @wp.func
    def even_out(
        t: Any, params: Any, force: wp.vec3, area_vector: wp.vec3, water_load: wp.vec4, upheld: Five
    ):  # fmt: skip
        more = evened_here(water_load, area_vector, params.share, upheld[0], upheld[1], upheld[2], t.up, params.n)
        return force + more

    return even_out

"""Pressure of a balloon's gas, or the given one, for a scene's features."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.codegen import function_from
from balloon_warp.kernels.compose import call_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.crushed import given_load
from balloon_warp.kernels.laws.gas import Swelling, borne_load, gas_load
from balloon_warp.kernels.laws.inflation import GAS


@cache
def load_function(features: Features) -> Any:
    """Make the function that finds a balloon's pressure above the air's from its swelling, its gas and the step.

    It gives the pressure at the center of mass [Pa], at height 0, its rise with height [Pa/m], and how more gas would
    raise both.
    """
    fixed = {} if features.breathes_on else {"breathing_damping": "1.0"}
    if not features.air_varies:
        fixed["air_lapse"] = "-1.0"

    def here(law: Any, **given: str) -> Any:
        """Return a law as a function of its given arguments and the row of numbers."""
        told = fixed | {name: name for name in given}
        call = call_of(law, "law", list(told), features.columns, lambda name: told[name])
        arguments = ", ".join(f"{name}: {kind}" for name, kind in given.items())
        source = f"def {law.key}_here({arguments}, n: Any):\n    return {call}\n"
        return function_from(f"{law.key}_here", source, {"law": law})

    load_of_gas = here(gas_load, swelling="Any", gas="wp.vec2", step_seconds="float")
    borne = here(borne_load, load="wp.vec4", bound="float", step_seconds="float")
    load_of_given = here(given_load, swelling="Any", given="float", mesh_volume="float", step_seconds="float")

    @wp.func
    def load_of_balloon(
        kind: wp.int32,
        given: float,
        swelling: Swelling,
        gas: wp.vec2,
        step_seconds: float,
        enclosed: wp.vec2,
        n: Any,
    ):
        """Return the load of a balloon; `given` is the gauge pressure of a balloon without gas [Pa].

        Args:
            enclosed: see `kernels.tables.FaceTable`.
        """
        if kind == GAS:
            return borne(load_of_gas(swelling, gas, step_seconds, n), enclosed[1], step_seconds, n)
        if wp.static(features.crushes):
            return load_of_given(swelling, given, enclosed[0], step_seconds, n)
        else:
            return wp.vec4(given, given, 0.0, 0.0)

    return load_of_balloon

"""Pressure of a balloon's gas, or the given one, for a scene's features."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.codegen import function_from
from balloon_warp.kernels.compose import call_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.gas import Swelling, borne_load, gas_load
from balloon_warp.kernels.laws.inflation import GAS


@cache
def load_function(features: Features) -> Any:
    """Make the function that finds a balloon's pressure above the air's from its swelling, its gas and the step.

    It gives the pressure at the center of mass [Pa], at height 0, its rise with height [Pa/m], and how more gas would
    raise both.
    """
    given = ["swelling", "gas", "step_seconds"]
    fixed = {} if features.breathes_on else {"breathing_damping": "1.0"}
    if not features.air_varies:
        fixed["air_lapse"] = "-1.0"
    call = call_of(gas_load, "gas_load", [*given, *fixed], features.columns, lambda name: fixed.get(name, name))
    borne = call_of(borne_load, "borne_load", ["load", "bound", "step_seconds"], features.columns)
    arguments = "swelling: Any, gas: wp.vec2, step_seconds: float, bound: float, n: Any"
    source = f"def load_of_gas({arguments}):\n    load = {call}\n    return {borne}\n"
    load_of_gas = function_from("load_of_gas", source, {"gas_load": gas_load, "borne_load": borne_load})

    @wp.func
    def load_of_balloon(
        kind: wp.int32,
        given: float,
        swelling: Swelling,
        gas: wp.vec2,
        step_seconds: float,
        bound: float,
        n: Any,
    ):
        """Return the load of a balloon; `given` is the gauge pressure of a balloon without gas [Pa].

        Args:
            bound: of the balloon's pressure, see `kernels.tables.FaceTable`.
        """
        if kind == GAS:
            return load_of_gas(swelling, gas, step_seconds, bound, n)
        return wp.vec4(given, given, 0.0, 0.0)

    return load_of_balloon

"""Adjoints of a gas's pressure, and of the gas that a balloon moves along."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint, NoAdjointError
from balloon_warp.kernels.adjoints.gas_changes import flow_adjoint
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.laws.inflation import GAS, NORMAL_FORCE
from balloon_warp.kernels.loops.gas_load import load_function
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables


def load_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of a balloon's pressure."""
    load_of_balloon = load_function(features)

    @wp.func
    def work_of_load(
        kind: wp.int32, given: float, swelling: Swelling, gas: wp.vec2, step_seconds: float, enclosed: wp.vec2,
        n: Any, bar: wp.vec4,
    ):  # fmt: skip
        return wp.dot(load_of_balloon(kind, given, swelling, gas, step_seconds, enclosed, n), bar)

    @wp.func
    def load_adjoint(
        t: Tables,
        balloon: wp.int32,
        keyed: float,
        swelling: Swelling,
        gas: wp.vec2,
        numbers: Any,
        gas_load_bar: wp.vec4,
    ):
        _kind, by_given, by_swelling, by_gas, _step, _enclosed, by_n, _bar = wp.grad(work_of_load)(
            t.inflation_kind[balloon], keyed, swelling, gas, t.step_seconds, t.faces.enclosed[balloon], numbers,
            gas_load_bar,
        )  # fmt: skip
        return by_given, by_swelling, by_gas, by_n

    return (Adjoint(load_adjoint, ("keyed", "swelling", "gas", "numbers")),)


def note_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of the recorded pressure, once gas has flowed: particles and readers use it."""

    @wp.func
    def bar_of_noted(t: Tables, balloon: wp.int32, load_bar: wp.vec2, pressure_bar: float):
        bar = wp.vec4(pressure_bar, load_bar[0], load_bar[1], 0.0)
        if t.inflation_kind[balloon] == NORMAL_FORCE:
            bar = wp.vec4()
        return bar

    @wp.func
    def bar_of_flowing(t: Tables, balloon: wp.int32, load_bar: wp.vec2, pressure_bar: float, slope_bar: float):
        return bar_of_noted(t, balloon, load_bar, pressure_bar) + wp.vec4(0.0, 0.0, 0.0, slope_bar)

    if features.tubes:
        return (Adjoint(bar_of_flowing, ("gas_load",)),)
    if not features.vents:
        return (Adjoint(bar_of_noted, ("gas_load",)),)
    flow_backwards = flow_adjoint(features)

    @wp.func
    def note_adjoint(
        t: Tables, balloon: wp.int32, time: float, gas_load: wp.vec4, gas: wp.vec2, numbers: Any, load_bar: wp.vec2,
        pressure_bar: float, gas_after_bar: wp.vec2,
    ):  # fmt: skip
        bar = bar_of_noted(t, balloon, load_bar, pressure_bar)
        gas_bar = wp.vec2()
        by_n = 0.0 * numbers
        if t.inflation_kind[balloon] == GAS:
            by_load, by_gas, by_numbers = flow_backwards(t, balloon, time, gas_load, gas, numbers, bar, gas_after_bar)
            bar = by_load
            gas_bar = by_gas - gas_after_bar  # to which it is added
            by_n = by_numbers
        return bar, gas_bar, by_n

    return (Adjoint(note_adjoint, ("gas_load", "gas", "numbers")),)


def pump_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint of pumps and flows: a kernel of its own runs them backwards, see `adjoints.gas_changes`."""
    if features.gas_meets_air:
        raise NoAdjointError("gas that comes and goes in air that varies")
    return ()

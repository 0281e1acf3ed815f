"""Adjoints of a gas's pressure, and of the gas that a balloon moves along."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoint import Adjoint, NoAdjointError
from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.laws.inflation import NORMAL_FORCE
from balloon_warp.kernels.loops.gas_load import load_function
from balloon_warp.kernels.phase import Look, Phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


def load_backwards(phase: Phase, traits: Traits, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of a balloon's pressure."""
    load_of_balloon = load_function(traits)

    @wp.func
    def work_of_load(
        kind: wp.int32, given: float, swelling: Swelling, gas: wp.vec2, step_seconds: float, n: Any, bar: wp.vec4
    ):
        return wp.dot(load_of_balloon(kind, given, swelling, gas[0], gas[1], step_seconds, n), bar)

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
        _kind, by_given, by_swelling, by_gas, _step, by_n, _bar = wp.grad(work_of_load)(
            t.inflation_kind[balloon], keyed, swelling, gas, t.step_seconds, numbers, gas_load_bar
        )
        return by_given, by_swelling, by_gas, by_n

    return (Adjoint(load_adjoint, ("keyed", "swelling", "gas", "numbers")),)


def note_backwards(phase: Phase, traits: Traits, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint of what is noted of a pressure: particles read it, and whoever looks at a frame."""

    @wp.func
    def note_adjoint(t: Tables, balloon: wp.int32, load_bar: wp.vec2, pressure_bar: float):
        bar = wp.vec4(pressure_bar, load_bar[0], load_bar[1], 0.0)
        if t.inflation_kind[balloon] == NORMAL_FORCE:
            bar = wp.vec4()
        return bar

    return (Adjoint(note_adjoint, ("gas_load",)),)


def needs_same_gas(phase: Phase, traits: Traits, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint of what comes and goes, where nothing does."""
    if traits.gas_changes:
        raise NoAdjointError("gas that is pumped in or flows")
    return ()

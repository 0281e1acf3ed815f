"""Gas that is pumped in or let out, and that flows through tubes, necks and leaks.

The former as a substep begins, the latter once its pressure is known; and how much a particle has to move of it.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import by_grad
from balloon_warp.kernels.adjoints.gas import pump_backwards
from balloon_warp.kernels.algebra import times
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.gas import gas_mass_function, pump_function
from balloon_warp.kernels.loops.tubes import flows_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working


def _stays(features: Features) -> bool:
    """Return whether the amount of gas is constant over a frame."""
    return not features.gas_changes


@phase("world", when=lambda features: features.gas, once=_stays, adjoint=pump_backwards)
def pump(features: Features, look: Look) -> Any:
    """Pump gas in, or let it out."""
    return pump_function(features)


@phase("balloon", when=lambda features: features.gas, once=_stays, adjoint=pump_backwards)
def weigh(features: Features, look: Look) -> Any:
    """Weigh the gas in a balloon, and the air that moves along."""
    gas_mass = gas_mass_function(features)

    @wp.func
    def weigh(t: Tables, state: WorldState, working: Working, world: wp.int32, balloon: wp.int32):
        working.gas_masses[world, balloon] = gas_mass(t, state, world, balloon)

    return weigh


@phase("particle", {"inertia": float}, light=True, once=lambda features: not features.gas_changes, adjoint=by_grad)
def burden(features: Features, look: Look) -> Any:
    """Find the effective mass of a particle, with its share of the gas, which moves along [kg]."""

    @wp.func
    def burden(params: Any):
        return params.mass

    @wp.func
    def burden_with_gas(params: Any, gas_mass: Any):
        return params.mass + times(params.share, gas_mass)

    return burden_with_gas if features.gas else burden


@phase("world", when=lambda features: features.gas_flows, adjoint=pump_backwards)
def flow(features: Features, look: Look) -> Any:
    """Exchange gas through tubes, necks and leaks, driven by the current pressures."""
    return flows_function(features)

"""Gas that is pumped in or let out, and that flows through tubes, necks and leaks.

The former as a substep begins, the latter once its pressure is known; and how much a particle has to move of it.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import by_grad
from balloon_warp.kernels.adjoints.gas import needs_same_gas
from balloon_warp.kernels.algebra import times
from balloon_warp.kernels.loops.gas import flows_function, gas_mass_function, pump_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working


def _stays(traits: Traits) -> bool:
    """Return whether the amount of gas is constant over a frame."""
    return not traits.gas_changes


@phase("world", when=lambda traits: traits.gas, once=_stays, adjoint=needs_same_gas)
def pump(traits: Traits, look: Look) -> Any:
    """Pump gas in, or let it out."""
    return pump_function(traits)


@phase("balloon", when=lambda traits: traits.gas, once=_stays, adjoint=needs_same_gas)
def weigh(traits: Traits, look: Look) -> Any:
    """Weigh the gas in a balloon, and the air that moves along."""
    gas_mass = gas_mass_function(traits)

    @wp.func
    def weigh(t: Tables, state: WorldState, working: Working, world: wp.int32, balloon: wp.int32):
        working.gas_masses[world, balloon] = gas_mass(t, state, world, balloon)

    return weigh


@phase("particle", {"inertia": float}, light=True, once=lambda traits: not traits.gas_changes, adjoint=by_grad)
def burden(traits: Traits, look: Look) -> Any:
    """Find the effective mass of a particle, with its share of the gas, which moves along [kg]."""

    @wp.func
    def burden(own: Any):
        return own.mass

    @wp.func
    def burden_with_gas(own: Any, gas_mass: Any):
        return own.mass + times(own.share, gas_mass)

    return burden_with_gas if traits.gas else burden


@phase("world", when=lambda traits: traits.gas_flows)
def flow(traits: Traits, look: Look) -> Any:
    """Exchange gas through tubes, necks and leaks, driven by the current pressures."""
    return flows_function(traits)

"""Gas of balloons: which have their own, and how much of it may leave."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.empty import amount_when_flat
from balloon_warp.kernels.laws.inflation import GAS
from balloon_warp.kernels.tables import Tables, WorldState


@wp.func
def most_that_leaves(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, air: wp.vec3):
    """Return the largest flow of gas out of a balloon in a substep, up to which it is not flat [mol/s]."""
    spare = float(state.gas_amounts[world, balloon]) - amount_when_flat(t.faces.enclosed[balloon][0], air)
    return wp.max(spare, 0.0) / t.step_seconds


@cache
def holding_function(features: Features) -> Any:
    """Return the test whether a balloon has gas of its own: one that has burst does, until it is open."""

    @wp.func
    def holds_gas(t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32):
        holds = t.inflation_kind[balloon] == GAS
        if wp.static(features.bursts):
            burst = state.bursts[world, balloon]
            holds = burst[1] >= 0.0 and (holds or burst[0] >= 0.0)
        return holds

    return holds_gas

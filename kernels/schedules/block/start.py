"""What threads of a block begin a frame with."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.tables import WorldState
from balloon_warp.kernels.traits import Traits


@wp.func
def load_in(state: WorldState, world: wp.int32, balloon: wp.int32):
    """Return what a balloon's gas presses with, as the state has it: see `laws.gas.gas_load`."""
    load = state.inflation_loads[world, balloon]
    return wp.vec4(state.pressures[world, balloon], load[0], load[1], 0.0)


@cache
def place_function(traits: Traits) -> Any:
    """Return the function that makes a particle what a thread has: where there is none, one that does not move."""
    Own, _ = own_functions(traits.columns, traits.balloons)  # noqa: N806 - a type

    @wp.func
    def take_place(own: Own, there: bool):
        if not there:
            own.share = 0.0
            own.mass = 0.0
        return own

    return take_place

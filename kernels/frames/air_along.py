"""Air at balloons, and the added mass of it, updated as a frame begins.

Neither a balloon's height nor its volume changes much in a frame.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import function_here
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.added_mass import air_along
from balloon_warp.kernels.laws.air import air_of_height
from balloon_warp.kernels.laws.body import GAS
from balloon_warp.kernels.loops.areas import volume_origin
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.tables import Tables, WorldState


@cache
def air_kernel(features: Features) -> Any:
    """Return the kernel that updates added mass and air at balloons."""
    read_numbers = numbers_reader(features.columns)
    air_of = function_here(air_along, ["height", "pressure", "free_volume"], features.columns)
    air_at_height = function_here(air_of_height, ["height"], features.columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def weigh_air(
        # model
        t: Tables,
        of_places: wp.array[wp.int32],
        # state in and out
        state: WorldState,
    ):
        """Compute the added mass and the air at each balloon; a thread a (world, balloon).

        Args:
            of_places: numbers of particles in the state, if tables have them in another order; empty otherwise.
        """
        world, balloon = wp.tid()
        if t.inflation_kind[balloon] == GAS:
            free_volume = float(state.free_volumes[world, balloon])
            numbers = read_numbers(t, world, balloon)
            origin = volume_origin(t, balloon)
            if of_places.shape[0] > 0:
                origin = of_places[origin]
            height = wp.dot(state.points[world, origin], t.up)
            if wp.static(features.takes_air_along):
                along = air_of(height, state.pressures[world, balloon], free_volume, numbers)
                state.air_along[world, balloon] = along
            if wp.static(features.gas_meets_air):
                state.airs[world, balloon] = air_at_height(height, numbers)

    return weigh_air

"""The air that moves along with balloons: weighed as a frame begins, since a balloon's volume hardly changes in one."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import call_of, function_from
from balloon_warp.kernels.laws.added_mass import air_along
from balloon_warp.kernels.laws.columns import Columns
from balloon_warp.kernels.laws.inflation import GAS
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.substep import volume_origin
from balloon_warp.kernels.tables import Tables, WorldState


@cache
def air_kernel(columns: Columns) -> Any:
    """The kernel that weighs it."""
    read_numbers = numbers_reader(columns)
    call = call_of(air_along, "air_along", ["height", "pressure", "free_volume"], columns)
    source = f"def air_of(height: float, pressure: float, free_volume: float, n: Any):\n    return {call}\n"
    air_of = function_from("air_of", source, {"air_along": air_along})

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def weigh_air(
        # model
        t: Tables,
        # state in and out
        state: WorldState,
    ):
        """A thread a (world, balloon)."""
        world, balloon = wp.tid()
        if t.inflation_kind[balloon] == GAS:
            free_volume = float(state.free_volumes[world, balloon])
            numbers = read_numbers(t, world, balloon)
            height = wp.dot(state.points[world, volume_origin(t, balloon)], t.up)
            air = air_of(height, state.pressures[world, balloon], free_volume, numbers)
            state.air_along[world, balloon] = air

    return weigh_air

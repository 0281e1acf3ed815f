"""What happens once a frame when a scene runs backwards: bars are added up by balloon, in the same order every time."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.codegen import function_from
from balloon_warp.kernels.compose import call_of
from balloon_warp.kernels.laws.added_mass import air_along
from balloon_warp.kernels.laws.inflation import GAS
from balloon_warp.kernels.loops.areas import volume_origin
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@wp.struct
class Bars:
    """Derivatives of what is to be found, by the state of particles and balloons."""

    points: wp.array2d[wp.vec3]
    pressures: wp.array2d[float]
    """By the pressures that a frame ends with"""
    gas_masses: wp.array2d[float]
    """By the gas mass that each particle reads, shape (W, P)"""
    keyed: wp.array2d[wp.vec2]
    """By the keyframed value that each particle reads, and that times the time in the frame [s], shape (W, P)"""
    keyed_of_balloons: wp.array2d[wp.vec2]
    gas: wp.array2d[wp.vec2]
    """By amount and free volume of the gas, shape (W, B)"""
    numbers: wp.array3d[float]
    """By the numbers that are asked for, of each particle, shape (W, P, count)"""
    numbers_of_balloons: wp.array3d[float]
    number_totals: wp.array3d[wp.float64]
    """Sums over all frames so far, shape (W, B, count)"""
    gas_totals: wp.array2d[wp.vec2d]
    keyed_totals: wp.array2d[wp.vec2d]
    """Sums of the frame, shape (W, B)"""


@cache
def sum_kernel(traits: Traits, columns: tuple[int, ...]) -> Any:
    """Return the kernel that adds up a frame's bars by balloon.

    Args:
        columns: of the numbers that are asked for.
    """
    weigh_back = _weigh_back(traits, columns) if traits.gas else None
    count = len(columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def sum_bars(t: Tables, state: WorldState, first_pressures: wp.array2d[float], bars: Bars):
        """Add up bars, and clear them for the next frame; a thread a (world, balloon)."""
        world, balloon = wp.tid()
        keyed = wp.vec2d(bars.keyed_of_balloons[world, balloon])
        gas_mass_bar = float(0.0)
        bars.keyed_of_balloons[world, balloon] = wp.vec2()
        for particle in range(t.particles.offsets[balloon], t.particles.offsets[balloon + 1]):
            keyed += wp.vec2d(bars.keyed[world, particle])
            bars.keyed[world, particle] = wp.vec2()
            gas_mass_bar += bars.gas_masses[world, particle]
            bars.gas_masses[world, particle] = 0.0
            for number in range(count):
                bars.number_totals[world, balloon, number] += wp.float64(bars.numbers[world, particle, number])
                bars.numbers[world, particle, number] = 0.0
        bars.keyed_totals[world, balloon] = keyed
        if wp.static(weigh_back is not None):
            weigh_back(t, state, first_pressures, bars, world, balloon, gas_mass_bar)
        bars.gas_totals[world, balloon] += wp.vec2d(bars.gas[world, balloon])
        bars.gas[world, balloon] = wp.vec2()
        for number in range(count):
            bars.number_totals[world, balloon, number] += wp.float64(bars.numbers_of_balloons[world, balloon, number])
            bars.numbers_of_balloons[world, balloon, number] = 0.0

    return sum_bars


def _weigh_back(traits: Traits, columns: tuple[int, ...]) -> Any:
    """Return the adjoint of what moves along with a balloon: its gas, and the air of its added mass."""
    read_numbers, along = numbers_reader(traits.columns), traits.takes_air_along
    molar_mass = traits.columns.places["molar_mass"]
    call = call_of(air_along, "air_along", ["height", "pressure", "free_volume"], traits.columns)
    work = (
        f"def work(height: float, pressure: float, free_volume: float, n: Any, bar: float):\n    return bar * {call}\n"
    )
    work_of_air = function_from("work", work, {"air_along": air_along})
    array = "numbers_of_balloons[world, balloon"
    lines = [f"    {array}, {place}] += by_n[{column}]" for place, column in enumerate(columns)] or ["    return"]
    arguments = "numbers_of_balloons: wp.array3d[float], world: wp.int32, balloon: wp.int32, by_n: Any"
    add_numbers = function_from("add_numbers", "\n".join([f"def add_numbers({arguments}):", *lines, ""]), {})

    @wp.func
    def weigh_back(
        t: Tables,
        state: WorldState,
        first_pressures: wp.array2d[float],
        bars: Bars,
        world: wp.int32,
        balloon: wp.int32,
        gas_mass_bar: float,
    ):
        n = read_numbers(t, world, balloon)
        by_n = 0.0 * n
        gas_bar = wp.vec2(gas_mass_bar * n[molar_mass], 0.0)
        pressure_bar = float(0.0)
        if wp.static(along):
            if t.inflation_kind[balloon] == GAS:
                origin = volume_origin(t, balloon)
                height = wp.dot(state.points[world, origin], t.up)
                by_height, by_pressure, by_free, by_numbers, _bar = wp.grad(work_of_air)(
                    height, first_pressures[world, balloon], float(state.free_volumes[world, balloon]), n, gas_mass_bar
                )
                by_n = by_numbers
                pressure_bar = by_pressure
                gas_bar[1] = by_free
                bars.points[world, origin] = bars.points[world, origin] + by_height * t.up
        by_n[molar_mass] += gas_mass_bar * float(state.gas_amounts[world, balloon])
        bars.pressures[world, balloon] = pressure_bar
        bars.gas[world, balloon] = bars.gas[world, balloon] + gas_bar
        add_numbers(bars.numbers_of_balloons, world, balloon, by_n)

    return weigh_back

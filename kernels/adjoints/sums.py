"""Sums of derivatives: as whole numbers, by particles, and by balloons.

Order-independent sums of derivatives in fixed point: the same to the bit in any order. Derivatives
have no unit that would say how large they are. So all is gone through twice: the largest of a kind in a world is found
first, and then each is added as a whole number of its 2^44th part. A sum has room for half a million as large as that.

Order-independent sums of the bars of particles' places, velocities and inverse masses, by contacts. Bars of contacts
have `points`, `velocities` and `inverse_masses`, shape (W, P), and `sums`, shape (W, P, SUMS), and `largest`; for
masses, `gas_masses` and `numbers`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.compose import call_of, function_from, numbers_reader
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.gas import air_along
from balloon_warp.kernels.laws.outer import GAS
from balloon_warp.kernels.loops.areas import volume_origin
from balloon_warp.kernels.loops.net_force import inverse_mass_function
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working

PARTS = wp.constant(wp.float64(2.0**44))
"""Parts into which the largest is divided"""
NOTHING = wp.constant(wp.float64(0.0))


@wp.func
def note_size(largest: wp.array2d[float], world: wp.int32, kind: wp.int32, size: float):
    """Record the magnitude of a term of a kind of sums, by any thread in any order."""
    if not wp.isfinite(size):
        wp.atomic_max(largest, world, kind, wp.inf)
    elif size > 0.0:
        wp.atomic_max(largest, world, kind, size)


@wp.func
def parts_per_unit(largest: wp.array2d[float], world: wp.int32, kind: wp.int32):
    """Fixed-point quanta in a unit of a kind of sums; 0 if all terms are 0, or one is not finite."""
    most = wp.float64(largest[world, kind])
    return wp.where(most > NOTHING, PARTS / wp.max(most, wp.float64(1.0e-300)), NOTHING)


@wp.func
def add_exactly(
    sums: wp.array3d[wp.int64], world: wp.int32, item: wp.int32, entry: wp.int32, per_unit: wp.float64, value: float
):
    """Add to a sum of an item, by any thread in any order."""
    if value != 0.0 and per_unit > NOTHING:
        wp.atomic_add(sums, world, item, entry, wp.int64(wp.float64(value) * per_unit))


@wp.func
def sum_at(
    sums: wp.array3d[wp.int64], largest: wp.array2d[float], world: wp.int32, item: wp.int32, entry: wp.int32,
    kind: wp.int32,
):  # fmt: skip
    """Return a sum of an item; infinity if a part of any was not finite."""
    most = largest[world, kind]
    if not wp.isfinite(most):
        return most
    return float(wp.float64(sums[world, item, entry]) * (wp.float64(most) / PARTS))


@wp.struct
class Bars:
    """Derivatives of the loss by the state of particles and balloons."""

    points: wp.array2d[wp.vec3]
    pressures: wp.array2d[float]
    """Bars of the pressures that a frame ends with"""
    gas_masses: wp.array2d[float]
    """Bars of the gas mass that each particle reads, shape (W, P)"""
    gas_masses_of_balloons: wp.array2d[float]
    """Bars of each balloon's gas mass, where gas comes and goes, added up over the frame so far"""
    keyed: wp.array2d[wp.vec2]
    """Bars of the keyframed value that each particle reads, and of it times the time in the frame [s], shape (W, P)"""
    keyed_of_balloons: wp.array2d[wp.vec2]
    gas: wp.array2d[wp.vec2]
    """Bars of amount and free volume of the gas, shape (W, B)"""
    numbers: wp.array3d[float]
    """Bars of the numbers that are asked for, of each particle, shape (W, P, count)"""
    numbers_of_balloons: wp.array3d[float]
    number_totals: wp.array3d[wp.float64]
    """Sums over all frames so far, shape (W, B, count)"""
    gas_totals: wp.array2d[wp.vec2d]
    keyed_totals: wp.array2d[wp.vec2d]
    """Sums of the frame, shape (W, B)"""


@cache
def sum_kernel(features: Features, columns: tuple[int, ...], one_by_one: bool = True) -> Any:
    """Return the kernel that adds up a frame's bars by balloon.

    Args:
        columns: of the numbers that are asked for.
        one_by_one: whether each particle has bars of its own; otherwise the only balloon has one of each.
    """
    mass_adjoint = _mass_adjoint(features, columns) if features.gas else None
    count, changes = len(columns), features.gas_changes

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def sum_bars(t: Tables, state: WorldState, first_pressures: wp.array2d[float], bars: Bars):
        """Add up bars, and clear them for the next frame; a block a (world, balloon)."""
        world, balloon, thread = wp.tid()
        begin = t.particles.offsets[balloon] + thread
        end = t.particles.offsets[balloon + 1]
        if wp.static(not one_by_one):
            end = 1
        keyed = wp.vec2d()
        gas_mass_bar = float(0.0)
        for particle in range(begin, end, wp.block_dim()):
            keyed += wp.vec2d(bars.keyed[world, particle])
            bars.keyed[world, particle] = wp.vec2()
            gas_mass_bar += bars.gas_masses[world, particle]
            bars.gas_masses[world, particle] = 0.0
        all_keyed = wp.tile_sum(wp.tile(keyed, preserve_type=True))[0]
        all_gas_mass_bar = wp.tile_sum(wp.tile(gas_mass_bar))[0]
        for number in range(count):
            of_number = wp.float64(0.0)
            for particle in range(begin, end, wp.block_dim()):
                of_number += wp.float64(bars.numbers[world, particle, number])
                bars.numbers[world, particle, number] = 0.0
            all_of_number = wp.tile_sum(wp.tile(of_number))[0]
            if thread == 0:
                bars.number_totals[world, balloon, number] += all_of_number
        if thread == 0:
            bars.keyed_totals[world, balloon] = all_keyed + wp.vec2d(bars.keyed_of_balloons[world, balloon])
            bars.keyed_of_balloons[world, balloon] = wp.vec2()
            all_gas_mass_bar += bars.gas_masses_of_balloons[world, balloon]
            bars.gas_masses_of_balloons[world, balloon] = 0.0
            if wp.static(mass_adjoint is not None):
                mass_adjoint(t, state, first_pressures, bars, world, balloon, all_gas_mass_bar)
            if wp.static(changes):
                bars.gas_totals[world, balloon] = wp.vec2d(bars.gas[world, balloon])
            else:
                bars.gas_totals[world, balloon] += wp.vec2d(bars.gas[world, balloon])
                bars.gas[world, balloon] = wp.vec2()
            for number in range(count):
                bars.number_totals[world, balloon, number] += wp.float64(
                    bars.numbers_of_balloons[world, balloon, number]
                )
                bars.numbers_of_balloons[world, balloon, number] = 0.0

    return sum_bars


@cache
def numbers_adder(columns: tuple[int, ...]) -> Any:
    """Return the function that adds bars of numbers of a balloon to those that are asked for."""
    array = "numbers_of_balloons[world, balloon"
    lines = [f"    {array}, {place}] += by_n[{column}]" for place, column in enumerate(columns)] or ["    return"]
    arguments = "numbers_of_balloons: wp.array3d[float], world: wp.int32, balloon: wp.int32, by_n: Any"
    return function_from("add_numbers", "\n".join([f"def add_numbers({arguments}):", *lines, ""]), {})


def _mass_adjoint(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the adjoint of the mass that moves along with a balloon: its gas, and the air of its added mass."""
    read_numbers, along = numbers_reader(features.columns), features.takes_air_along
    molar_mass = features.columns.places["molar_mass"]
    changes, add_numbers = features.gas_changes, numbers_adder(columns)
    call = call_of(air_along, "air_along", ["height", "pressure", "free_volume"], features.columns)
    work = (
        f"def work(height: float, pressure: float, free_volume: float, n: Any, bar: float):\n    return bar * {call}\n"
    )
    work_of_air = function_from("work", work, {"air_along": air_along})

    @wp.func
    def mass_adjoint(
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
        if wp.static(changes):  # the gas's weight is known for each substep
            gas_bar = wp.vec2()
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
        if wp.static(not changes):
            by_n[molar_mass] += gas_mass_bar * float(state.gas_amounts[world, balloon])
        bars.pressures[world, balloon] = bars.pressures[world, balloon] + pressure_bar
        bars.gas[world, balloon] = bars.gas[world, balloon] + gas_bar
        add_numbers(bars.numbers_of_balloons, world, balloon, by_n)

    return mass_adjoint


OF_PLACES, OF_VELOCITIES, OF_INVERSE_MASSES = (wp.constant(kind) for kind in range(3))
"""Kinds of sums"""
INVERSE_MASS, SUMS = wp.constant(6), 7
"""Entries of a particle's sums: after place and velocity its inverse mass"""


@wp.func
def add_to_sums(bars: Any, world: wp.int32, particle: wp.int32, place: wp.vec3, velocity: wp.vec3, inverse_mass: float):
    """Add derivatives to the sums of a particle, by any thread in any order."""
    of_places = parts_per_unit(bars.largest, world, OF_PLACES)
    of_velocities = parts_per_unit(bars.largest, world, OF_VELOCITIES)
    for axis in range(3):
        add_exactly(bars.sums, world, particle, axis, of_places, place[axis])
        add_exactly(bars.sums, world, particle, axis + 3, of_velocities, velocity[axis])
    add_exactly(
        bars.sums, world, particle, INVERSE_MASS, parts_per_unit(bars.largest, world, OF_INVERSE_MASSES), inverse_mass
    )


@wp.func
def take_sums(bars: Any, world: wp.int32, particle: wp.int32):
    """Add a particle's sums to its derivatives, and clear them."""
    place = wp.vec3()
    velocity = wp.vec3()
    for axis in range(3):
        place[axis] = sum_at(bars.sums, bars.largest, world, particle, axis, OF_PLACES)
        velocity[axis] = sum_at(bars.sums, bars.largest, world, particle, axis + 3, OF_VELOCITIES)
    inverse_mass = sum_at(bars.sums, bars.largest, world, particle, INVERSE_MASS, OF_INVERSE_MASSES)
    bars.points[world, particle] = bars.points[world, particle] + place
    bars.velocities[world, particle] = bars.velocities[world, particle] + velocity
    bars.inverse_masses[world, particle] = bars.inverse_masses[world, particle] + inverse_mass
    for entry in range(SUMS):
        bars.sums[world, particle, entry] = wp.int64(0)


@cache
def mass_adjoint_function(features: Features, columns: tuple[int, ...]) -> Any:
    """Adjoint of a particle's inverse mass.

    Args:
        columns: of the numbers that are derived by.
    """
    inverse_mass_of = inverse_mass_function(features)
    column = features.columns.places["mass"]
    place_of_mass = columns.index(column) if column in columns else -1

    @wp.func
    def mass_adjoint(t: Tables, working: Working, bars: Any, world: wp.int32, particle: wp.int32):
        if bars.inverse_masses[world, particle] != 0.0:
            inverse_mass = inverse_mass_of(t, working, world, particle)
            by_mass = (
                -bars.inverse_masses[world, particle] * inverse_mass * inverse_mass * t.particles.mass_share[particle]
            )
            bars.inverse_masses[world, particle] = 0.0
            bars.gas_masses[world, particle] = bars.gas_masses[world, particle] + by_mass
            if wp.static(place_of_mass >= 0):
                before = bars.numbers[world, particle, wp.static(place_of_mass)]
                bars.numbers[world, particle, wp.static(place_of_mass)] = before + by_mass

    return mass_adjoint

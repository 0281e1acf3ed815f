"""Gas in a thread block: how balloons swell, added up in the same order every time, and the pressures that follow.

Each warp adds up what its particles give to a balloon in a row of its own; then a warp for each balloon adds up the
rows, and its first thread finds the pressure. What all need to know of a balloon stands in shared memory.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.clock import ramp_at
from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.laws.inflation import GAS, NORMAL_FORCE
from balloon_warp.kernels.loops.gas import flows_function, pump_function
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.phases.load import load_function, note_function
from balloon_warp.kernels.schedules.block.memory import Layout, Seat
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warp_sums import put_warp_sums, sum_of_warp_sums
from balloon_warp.kernels.warps import WARP_THREADS, block_barrier, of_thread, put_word, shared_words, word_at

NUMBERS_OF_WARP = 8
"""words that a warp has for a balloon, see `put_warp_sums`"""
WORDS_OF_BALLOON = 7
"""its load, how that rises, of its gas in even and in odd substeps amount and free volume, and air that moves along.
Gas changes while threads still read it, so that a substep reads one row, and a thread fills the other for the next."""
LOAD, RISE, AMOUNT, FREE_VOLUME, AIR = (wp.constant(place) for place in (0, 1, 2, 4, 6))


class GasSums(NamedTuple):
    """What a block does with its gas."""

    shared: bool
    """loads stand in shared memory; otherwise each warp finds that of the one balloon for itself"""
    begin: Any
    """(t, state, seat, frame_begin): what a frame begins with; a barrier must follow"""
    clear: Any
    """(seat): before a substep adds up"""
    add: Any
    """(seat, balloon, part, added): by all threads of a warp, what its particles give to their balloons"""
    find_loads: Any
    """(t, state, seat): the pressures, and what flows by them, after a barrier; where they are shared, with
    another"""
    own_load: Any
    """(t, state, seat, member): a particle's load then"""
    pump: Any
    """(t, state, seat): by one thread, the gas of the next substep"""
    load_at: Any
    """(balloon): pressure at height 0, and its rise"""
    amount_at: Any
    """(substep, balloon): of gas [mol]"""
    air_at: Any
    """(balloon): that moves along [kg]"""


@cache
def gas_sums(traits: Traits, layout: Layout) -> GasSums:
    """For the warps of a block."""
    balloons, warps = traits.balloons, layout.warps
    shared = balloons > 1 or not layout.resident
    gas_changes = traits.gas_changes
    sums = shared_words("swellings", balloons * warps * NUMBERS_OF_WARP)
    known = shared_words("balloons", balloons * WORDS_OF_BALLOON)
    load_of_balloon, note_load = load_function(traits), note_function(traits)
    pump_gas, let_gases_flow = pump_function(traits), flows_function(traits)
    read_numbers = numbers_reader(traits.columns)

    @wp.func
    def load_at(balloon: wp.int32):
        first = balloon * WORDS_OF_BALLOON
        return wp.vec2(word_at(known(), first + LOAD), word_at(known(), first + RISE))

    @wp.func
    def put_loads(state: WorldState, world: wp.int32):
        """By one thread, as the state has them."""
        for balloon in range(balloons):
            load = state.inflation_loads[world, balloon]
            put_word(known(), balloon * WORDS_OF_BALLOON + LOAD, load[0])
            put_word(known(), balloon * WORDS_OF_BALLOON + RISE, load[1])

    @wp.func
    def amount_at(substep: wp.int32, balloon: wp.int32):
        return word_at(known(), balloon * WORDS_OF_BALLOON + AMOUNT + (substep & 1))

    @wp.func
    def air_at(balloon: wp.int32):
        return word_at(known(), balloon * WORDS_OF_BALLOON + AIR)

    @wp.func
    def put_air(state: WorldState, world: wp.int32):
        """By one thread, for a frame."""
        for balloon in range(balloons):
            put_word(known(), balloon * WORDS_OF_BALLOON + AIR, state.air_along[world, balloon])

    @wp.func
    def free_volume_at(substep: wp.int32, balloon: wp.int32):
        return word_at(known(), balloon * WORDS_OF_BALLOON + FREE_VOLUME + (substep & 1))

    @wp.func
    def put_gases(state: WorldState, world: wp.int32, substep: wp.int32):
        """By one thread, as the state has them, for a substep."""
        for balloon in range(balloons):
            word = balloon * WORDS_OF_BALLOON + (substep & 1)
            put_word(known(), word + AMOUNT, float(state.gas_amounts[world, balloon]))
            put_word(known(), word + FREE_VOLUME, float(state.free_volumes[world, balloon]))

    @wp.func
    def begin(t: Tables, state: WorldState, seat: Seat, frame_begin: float):
        if seat.thread == 0:
            put_loads(state, seat.world)
            if wp.static(traits.pumps):
                pump_gas(t, state, seat.world, 0.0, frame_begin)
            put_gases(state, seat.world, 0)
            put_gases(state, seat.world, 1)
            if wp.static(traits.takes_air_along):
                put_air(state, seat.world)

    @wp.func
    def pump(t: Tables, state: WorldState, seat: Seat):
        if wp.static(traits.gas_changes):  # or else what stands there stays, and nobody waits for the state
            if seat.thread == 0 and seat.substep + 1 < t.substeps:
                if wp.static(traits.pumps):
                    pump_gas(t, state, seat.world, seat.time_in_frame + t.step_seconds, seat.time + t.step_seconds)
                put_gases(state, seat.world, seat.substep + 1)

    @wp.func
    def row_of(balloon: wp.int32, warp: wp.int32):
        return (balloon * warps + warp) * NUMBERS_OF_WARP

    @wp.func
    def clear(seat: Seat):
        """By each warp, its own rows."""
        if wp.static(balloons > 1):
            for word in range(
                seat.thread % WARP_THREADS, balloons * NUMBERS_OF_WARP, wp.min(WARP_THREADS, wp.block_dim())
            ):
                balloon = word // NUMBERS_OF_WARP
                put_word(sums(), row_of(balloon, seat.thread // WARP_THREADS) + word % NUMBERS_OF_WARP, 0.0)

    @wp.func
    def add(seat: Seat, balloon: wp.int32, part: Swelling, added: bool):
        """Particles stand in the order of their balloons, so that a warp has few."""
        warp = seat.thread // WARP_THREADS
        if wp.static(balloons == 1):
            put_warp_sums(sums(), row_of(0, warp), part, added)
        else:
            for each in range(of_thread(balloon, 0), of_thread(balloon, WARP_THREADS - 1) + 1):
                put_warp_sums(sums(), row_of(each, warp), wp.where(each == balloon, part, Swelling()), True)

    @wp.func
    def find_load(t: Tables, state: WorldState, seat: Seat, balloon: wp.int32):
        """By all threads of a warp."""
        swelling = sum_of_warp_sums(sums(), row_of(balloon, 0), warps)
        kind = t.inflation_kind[balloon]
        if seat.thread % WARP_THREADS == 0 and kind != NORMAL_FORCE:
            given = ramp_at(state, seat.world, balloon, seat.time_in_frame)
            load = load_of_balloon(
                kind, given, swelling, amount_at(seat.substep, balloon), free_volume_at(seat.substep, balloon),
                t.step_seconds, read_numbers(t, seat.world, balloon),
            )  # fmt: skip
            note_load(state, seat.world, balloon, load)
            put_word(known(), balloon * WORDS_OF_BALLOON + LOAD, load[1])
            put_word(known(), balloon * WORDS_OF_BALLOON + RISE, load[2])

    @wp.func
    def find_loads(t: Tables, state: WorldState, seat: Seat):
        if wp.static(shared):
            for balloon in range(seat.thread // WARP_THREADS, balloons, warps):
                find_load(t, state, seat, balloon)
            block_barrier()
            if wp.static(traits.gas_flows):
                if seat.thread == 0:
                    let_gases_flow(t, state, seat.world, seat.time)
                    put_loads(state, seat.world)
                block_barrier()

    @wp.func
    def own_load(t: Tables, state: WorldState, seat: Seat, member: Any):
        if wp.static(shared):
            return load_at(member.own.balloon)
        else:
            swelling = sum_of_warp_sums(sums(), row_of(0, 0), warps)
            load = load_of_balloon(  # the one balloon has gas, or else there were none
                GAS, 0.0, swelling, amount_at(seat.substep, 0), free_volume_at(seat.substep, 0),
                t.step_seconds, member.own.n,
            )  # fmt: skip
            if seat.thread == 0 and (gas_changes or seat.substep + 1 == t.substeps):  # nobody asks for it sooner
                note_load(state, seat.world, 0, load)
            return wp.vec2(load[1], load[2])

    return GasSums(shared, begin, clear, add, find_loads, own_load, pump, load_at, amount_at, air_at)

"""Gas in a thread block: how balloons swell, added up in the same order every time, and the pressures that follow.

Each warp adds up what its particles give to a balloon in a row of its own; then a warp for each balloon adds up the
rows, and its first thread finds the pressure. What all need to know of a balloon stands in shared memory.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.laws.inflation import NORMAL_FORCE
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.schedules.block_memory import BlockMemory, Layout, Seat, gas_row
from balloon_warp.kernels.schedules.warps import (
    WARP_THREADS,
    block_barrier,
    of_thread,
    put_warp_sums,
    put_word,
    shared_words,
    sum_of_warp_sums,
    word_at,
)
from balloon_warp.kernels.substep import flow_function, load_function, ramp_at
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits

NUMBERS_OF_WARP = 8
"""words that a warp has for a balloon: five sums, and three that are 0"""
WORDS_OF_BALLOON = 4
"""its load, how that rises, and the amount of its gas in even and in odd substeps"""
LOAD, RISE, AMOUNT = wp.constant(0), wp.constant(1), wp.constant(2)


class GasSums(NamedTuple):
    """What a block does with its gas."""

    shared: bool
    """what is known of balloons stands in shared memory; otherwise each thread knows all of the one balloon"""
    begin: Any
    """(t, state, memory, seat): what a frame begins with; a barrier must follow"""
    clear: Any
    """(seat): before a substep adds up"""
    add: Any
    """(seat, balloon, part, added): by all threads of a warp, what its particles give to their balloons"""
    find_loads: Any
    """(t, state, memory, seat): the pressures, after a barrier; where they are shared, with another"""
    own_load: Any
    """(t, state, seat, member): a particle's load then; of the one balloon, each warp finds it for itself"""
    flow: Any
    """(t, state, memory, seat): by one thread, the amounts of the next substep"""
    load_at: Any
    """(balloon): pressure at height 0, and its rise"""
    amount_at: Any
    """(substep, balloon): of gas [mol]"""
    end: Any
    """(state, seat, member): what a frame ends with"""


@cache
def gas_sums(traits: Traits, layout: Layout) -> GasSums:
    """For the warps of a block."""
    balloons, warps = traits.balloons, layout.warps
    shared = balloons > 1 or not layout.resident
    sums = shared_words("swellings", balloons * warps * NUMBERS_OF_WARP)
    known = shared_words("balloons", balloons * WORDS_OF_BALLOON)
    load_of_balloon = load_function(traits.columns)
    flow_of_gas = flow_function(traits.columns)
    read_numbers = numbers_reader(traits.columns)

    @wp.func
    def load_at(balloon: wp.int32):
        first = balloon * WORDS_OF_BALLOON
        return wp.vec2(word_at(known(), first + LOAD), word_at(known(), first + RISE))

    @wp.func
    def amount_at(substep: wp.int32, balloon: wp.int32):
        return word_at(known(), balloon * WORDS_OF_BALLOON + AMOUNT + (substep & 1))

    @wp.func
    def move_gas(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat, substep: wp.int32):
        """The amounts of a substep, which stand as they were."""
        amounts = memory.amounts[gas_row(seat, substep)]
        time_in_frame = float(substep) * t.step_seconds
        flow_of_gas(
            t, state.inflation_ramp[seat.world], state.pressures[seat.world], amounts, seat.world, time_in_frame
        )
        for balloon in range(balloons):
            put_word(known(), balloon * WORDS_OF_BALLOON + AMOUNT + (substep & 1), float(amounts[balloon]))

    @wp.func
    def begin(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat):
        if wp.static(shared) and seat.thread == 0:
            for balloon in range(balloons):
                memory.amounts[gas_row(seat, 0), balloon] = state.gas_amounts[seat.world, balloon]
                load = state.inflation_loads[seat.world, balloon]
                put_word(known(), balloon * WORDS_OF_BALLOON + LOAD, load[0])
                put_word(known(), balloon * WORDS_OF_BALLOON + RISE, load[1])
            move_gas(t, state, memory, seat, 0)

    @wp.func
    def flow(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat):
        if wp.static(shared) and seat.thread == 0:
            for balloon in range(balloons):
                amount = memory.amounts[gas_row(seat, seat.substep), balloon]
                state.gas_amounts[seat.world, balloon] = amount
                memory.amounts[gas_row(seat, seat.substep + 1), balloon] = amount
            move_gas(t, state, memory, seat, seat.substep + 1)

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
    def note(state: WorldState, world: wp.int32, balloon: wp.int32, load: wp.vec3):
        """By one thread."""
        state.pressures[world, balloon] = load[0]
        state.inflation_loads[world, balloon] = wp.vec2(load[1], load[2])

    @wp.func
    def find_load(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat, balloon: wp.int32):
        """By all threads of a warp."""
        swelling = sum_of_warp_sums(sums(), row_of(balloon, 0), warps)
        kind = t.inflation_kind[balloon]
        if seat.thread % WARP_THREADS == 0 and kind != NORMAL_FORCE:
            given = ramp_at(state, seat.world, balloon, seat.time_in_frame)
            load = load_of_balloon(
                kind, given, swelling, amount_at(seat.substep, balloon), t.step_seconds,
                read_numbers(t, seat.world, balloon),
            )  # fmt: skip
            note(state, seat.world, balloon, load)
            put_word(known(), balloon * WORDS_OF_BALLOON + LOAD, load[1])
            put_word(known(), balloon * WORDS_OF_BALLOON + RISE, load[2])

    @wp.func
    def find_loads(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat):
        if wp.static(shared):
            for balloon in range(seat.thread // WARP_THREADS, balloons, warps):
                find_load(t, state, memory, seat, balloon)
            block_barrier()

    @wp.func
    def own_load(t: Tables, state: WorldState, seat: Seat, member: Any):
        if wp.static(shared):
            return load_at(member.own.balloon)
        else:
            given = member.ramp[0] + member.ramp[1] * seat.time_in_frame
            swelling = sum_of_warp_sums(sums(), row_of(0, 0), warps)
            load = load_of_balloon(member.own.kind, given, swelling, float(member.amount), t.step_seconds, member.own.n)
            if seat.thread == 0:
                note(state, seat.world, 0, load)
            return wp.vec2(load[1], load[2])

    @wp.func
    def end(state: WorldState, seat: Seat, member: Any):
        if wp.static(not shared):
            if seat.thread == 0:
                state.gas_amounts[seat.world, 0] = member.amount

    return GasSums(shared, begin, clear, add, find_loads, own_load, flow, load_at, amount_at, end)

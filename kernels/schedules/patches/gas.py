"""Gas in balloons that many blocks have a part of: each finds the pressure, of how all parts would swell."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.laws.inflation import NORMAL_FORCE
from balloon_warp.kernels.phases.load import load_function, note_function
from balloon_warp.kernels.schedules.block.memory import Seat
from balloon_warp.kernels.schedules.patches.memory import PatchMemory, PatchSeat
from balloon_warp.kernels.schedules.patches.sums import sums_of
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import put_word, shared_words, word_at

AMOUNT, FREE_VOLUME, AIR = (wp.constant(place) for place in range(3))


class PatchGas(NamedTuple):
    """What a block does with the gas of its patch's balloon."""

    begin: Any
    """(state, seat, balloon): what a frame begins with; a barrier must follow"""
    amount_at: Any
    """(substep, balloon): of gas [mol]"""
    air_at: Any
    """(balloon): that moves along [kg]"""
    find_load: Any
    """(t, state, memory, seat, now, member, part): the pressure at height 0, and its rise, by all threads of all blocks
    of the balloon, each with its particle's part in the swelling"""


@cache
def patch_gas(traits: Traits, warps: int) -> PatchGas:
    """For the warps of a block; the gas neither comes nor goes in a frame."""
    known, sum_in_balloon = shared_words("gas of a patch", 4), sums_of(warps)
    load_of_balloon, note_load = load_function(traits), note_function(traits)

    @wp.func
    def begin(state: WorldState, seat: PatchSeat, balloon: wp.int32):
        if seat.thread == 0:
            put_word(known(), AMOUNT, float(state.gas_amounts[seat.world, balloon]))
            put_word(known(), FREE_VOLUME, float(state.free_volumes[seat.world, balloon]))
            if wp.static(traits.takes_air_along):
                put_word(known(), AIR, state.air_along[seat.world, balloon])

    @wp.func
    def amount_at(substep: wp.int32, balloon: wp.int32):
        return word_at(known(), AMOUNT)

    @wp.func
    def air_at(balloon: wp.int32):
        return word_at(known(), AIR)

    @wp.func
    def find_load(
        t: Tables, state: WorldState, memory: PatchMemory, seat: PatchSeat, now: Seat, member: Any, part: Swelling
    ):
        swelling = sum_in_balloon(memory, seat, now.substep, part)
        given = member.ramp[0] + member.ramp[1] * now.time_in_frame
        load = load_of_balloon(
            member.own.kind, given, swelling, word_at(known(), AMOUNT), word_at(known(), FREE_VOLUME),
            t.step_seconds, member.own.n,
        )  # fmt: skip
        if seat.thread == 0 and seat.patch == seat.begin and member.own.kind != NORMAL_FORCE:
            note_load(state, seat.world, member.own.balloon, load)
        return wp.vec2(load[1], load[2])

    return PatchGas(begin, amount_at, air_at, find_load)

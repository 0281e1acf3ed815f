"""Sums over the items of a world, balloon by balloon, by all threads of a block: the same to the bit every time.

Each warp adds up its threads' parts, in rows of shared memory; whoever wants the sum adds up the rows.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.warp_sums import Five, put_warp_sums, sum_of_warp_sums
from balloon_warp.kernels.warps import WARP_THREADS, of_thread, put_word, shared_words, warp_sum, word_at

WORDS = 8
"""Number of words that a warp has for a sum"""


class BlockSum(NamedTuple):
    """Hold the functions of a sum; all threads of a warp call each."""

    clear: Any
    """(thread): nothing in the rows of the warp yet"""
    put: Any
    """(thread, part): a thread's part of the one balloon"""
    add: Any
    """(thread, balloon, part): more of a balloon; items stand in the order of their balloons, so that a warp has few"""
    total: Any
    """(balloon): the sum, once a barrier has come"""


@cache
def block_sum(name: str, dtype: Any, balloons: int, warps: int) -> BlockSum:
    """Return the functions of a sum of numbers, or of vectors of five."""
    rows = shared_words(f"sum of {name}", balloons * warps * WORDS)
    is_number = dtype is float

    @wp.func
    def row_of(balloon: wp.int32, warp: wp.int32):
        return (balloon * warps + warp) * WORDS

    @wp.func
    def put_number(first: wp.int32, thread: wp.int32, part: float, added: bool):
        total = warp_sum(part)
        if thread % WARP_THREADS == 0:
            if added:
                total += word_at(rows(), first)
            put_word(rows(), first, total)

    @wp.func
    def put_five(first: wp.int32, thread: wp.int32, part: Five, added: bool):
        put_warp_sums(rows(), first, part, added)

    @wp.func
    def no_number():
        return float(0.0)

    @wp.func
    def no_five():
        return Five()

    put_part, nothing = (put_number, no_number) if is_number else (put_five, no_five)

    @wp.func
    def clear(thread: wp.int32):
        for word in range(thread % WARP_THREADS, balloons * WORDS, wp.min(WARP_THREADS, wp.block_dim())):
            put_word(rows(), row_of(word // WORDS, thread // WARP_THREADS) + word % WORDS, 0.0)

    @wp.func
    def put(thread: wp.int32, part: dtype):
        put_part(row_of(0, thread // WARP_THREADS), thread, part, False)

    @wp.func
    def add(thread: wp.int32, balloon: wp.int32, part: dtype):
        for each in range(of_thread(balloon, 0), of_thread(balloon, WARP_THREADS - 1) + 1):
            put_part(row_of(each, thread // WARP_THREADS), thread, wp.where(each == balloon, part, nothing()), True)

    @wp.func
    def total_of_numbers(balloon: wp.int32):
        total = float(0.0)
        for warp in range(warps):
            total += word_at(rows(), row_of(balloon, warp))
        return total

    @wp.func
    def total_of_fives(balloon: wp.int32):
        return sum_of_warp_sums(rows(), row_of(balloon, 0), warps)

    return BlockSum(clear, put, add, total_of_numbers if is_number else total_of_fives)

"""Compaction: the few items of a block that a rare phase acts on, as a list that all threads share.

Otherwise a warp in which one particle touches an obstacle takes as long as if all did. Two lengths take turns, so that
one can be cleared while the other is read.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.warps import count_at, next_in_block, put_count, shared_words

LENGTHS = wp.constant(2)


class Compaction(NamedTuple):
    """Hold the functions of a list; `turn` says which length counts, 0 or 1."""

    clear: Any
    """(turn)"""
    note: Any
    """(turn, item): in any order"""
    count: Any
    """(turn): how many are noted, once a barrier has come"""
    at: Any
    """(place): the item there"""


@cache
def compaction(name: str, capacity: int) -> Compaction:
    """Return the functions of a list of up to so many items."""
    words = shared_words(f"items of {name}", capacity + int(LENGTHS))

    @wp.func
    def clear(turn: wp.int32):
        put_count(words(), turn, 0)

    @wp.func
    def note(turn: wp.int32, item: wp.int32):
        put_count(words(), LENGTHS + next_in_block(words(), turn), item)

    @wp.func
    def count(turn: wp.int32):
        return count_at(words(), turn)

    @wp.func
    def at(place: wp.int32):
        return count_at(words(), LENGTHS + place)

    return Compaction(clear, note, count, at)

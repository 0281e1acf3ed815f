"""Kind of contacts: how a file says what touches, and how it puts that on the list of a sweep."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.compose import function_from
from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.contact.room import OF_CATCHES, ask_for_room
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_block, block_barrier
from balloon_warp.kernels.working import Working

CAUGHT, MARKED = wp.constant(0), wp.constant(1)
"""Indices of the number of contacts that may act in this substep, and of those that come too near in a sweep"""
GIVEN = "t, state, working, world, thread, end, points, velocities"
"""Arguments of the functions that list contacts"""


class Kind(NamedTuple):
    """A kind of contacts."""

    acts: Callable[[Features], bool]
    """Whether a scene has any"""
    list_all: Callable[[Features, bool], Any]
    """Function of `GIVEN` that lists the contacts of a substep by all threads of a block, and returns whether any of a
    thread overlaps; the second argument says whether substeps run backwards, so that none follows another"""
    most_sweeps: int
    """Largest number of sweeps in a substep; it ends sooner where nothing comes too near"""


class Sweep(NamedTuple):
    """Kinds of contacts that act at once, in the same sweeps."""

    kinds: tuple[Kind, ...]
    seen: Callable[[Features], Features]
    """Features that contacts see: those of other kinds cost nothing"""

    def of(self, features: Features) -> tuple[Kind, ...]:
        """Return the kinds that a scene has."""
        return tuple(kind for kind in self.kinds if kind.acts(features))

    def most(self, features: Features) -> int:
        """Return the largest number of sweeps in a substep."""
        return max(kind.most_sweeps for kind in self.of(features))


@wp.func
def list_contact(working: Working, world: wp.int32, contact: Contact):
    """List a contact, in any order, and return whether its features overlap."""
    place = wp.atomic_add(working.catch_counts, world, CAUGHT, 1)
    if place < working.catches.shape[1]:
        working.catches[world, place] = contact
    else:
        ask_for_room(working, world, OF_CATCHES, place + 1, 1)
    return contact.overlap > 0.0


@cache
def sweep_listing(sweep: Sweep, features: Features, backwards: bool) -> Any:
    """Return the function that lists the contacts of all kinds in a substep.

    Args:
        backwards: as in `Kind.list_all`.
    """
    parts = {f"list_{number}": kind.list_all(features, backwards) for number, kind in enumerate(sweep.of(features))}
    arguments = ", ".join(f"{name}: Any" for name in GIVEN.split(", "))
    lines = (f"    overlaps = {name}({GIVEN}) or overlaps" for name in parts)
    source = "\n".join(
        [f"def list_kinds({arguments}):", "    overlaps = bool(False)", *lines, "    return overlaps", ""]
    )
    list_kinds = function_from("list_kinds", source, parts)

    @wp.func
    def list_all(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Return the number of contacts in a substep, and whether any overlaps, by all threads of a block."""
        if thread == 0:
            working.catch_counts[world, CAUGHT] = 0
            working.catch_counts[world, MARKED] = 0
        block_barrier()
        overlaps = any_in_block(list_kinds(t, state, working, world, thread, end, points, velocities))
        return wp.min(working.catch_counts[world, CAUGHT], working.catches.shape[1]), overlaps

    return list_all

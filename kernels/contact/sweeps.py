"""Sweeps over a list of contacts, a block a world: the same for every kind.

Each piece of a substep is a launch. Contacts that may act in the substep are listed once. In each sweep those that come
too near are marked, a thread a contact; all marked ones push at once, and then a thread moves each end. Last, features
that have come too near are moved apart, without speed.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.contact import excess_of, resolving_functions
from balloon_warp.kernels.contact.edges import EDGES
from balloon_warp.kernels.contact.ends import (
    adding_functions,
    bearing_function,
    forget_stop,
    four_of,
    motion_functions,
    moving_functions,
)
from balloon_warp.kernels.contact.kind import BODIES, MARKED, Sweep, sweep_listing
from balloon_warp.kernels.contact.ridges import RIDGES
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import any_in_block, block_barrier, next_place
from balloon_warp.kernels.working import Working

BESIDE_RIDGES = Sweep((RIDGES,), lambda features: features._replace(ground=False))
"""Sweeps before particles leave the ground and obstacles, see docs/design/one_contact.md"""
AT_LAST = Sweep(
    (BODIES, RIDGES._replace(is_active=lambda features: features.ridges and not features.ridges_first), EDGES),
    lambda features: features.without_ridges if features.ridges_first else features,
)
"""Sweeps once all have moved, in which bodies, layers, and the ground below them take part"""


@cache
def marking_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions that mark the contacts of a thread that come too near, and those that overlap."""
    kind_of, motion_of = motion_functions(features)
    relative_of, _, _ = resolving_functions(features)
    count_in, _ = adding_functions(features)

    @wp.func
    def mark(t: Tables, working: Working, world: wp.int32, place: wp.int32):
        """List a contact that comes too near, and count it at its ends."""
        working.listed_contacts[world, next_place(working.listed_contact_counts, world, MARKED)].marked = place
        count_in(t, working, world, working.listed_contacts[world, place])

    @wp.func
    def mark_pushed(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32,
        velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Mark contacts, and return whether any comes so near that one more sweep follows."""
        goes_on = bool(False)
        for place in range(thread, count, wp.block_dim()):
            contact = working.listed_contacts[world, place]
            solid = motion_of(t, state, working, world, contact)
            relative = relative_of(contact, four_of(velocities, contact.ends), kind_of(t, contact), solid)
            excess = excess_of(contact, relative, t.step_seconds)
            if excess > 0.0:
                mark(t, working, world, place)
                goes_on = goes_on or t.step_seconds * excess > contact.left
        return goes_on

    @wp.func
    def mark_overlaps(t: Tables, working: Working, world: wp.int32, thread: wp.int32, count: wp.int32):
        for place in range(thread, count, wp.block_dim()):
            if working.listed_contacts[world, place].overlap > 0.0:
                mark(t, working, world, place)

    return mark_pushed, mark_overlaps


@cache
def pushing_function(features: Features, note: Any = forget_stop) -> Any:
    """Return the function that lets all marked contacts push.

    Args:
        note: function that keeps how the ground stops a particle.
    """
    _, motion_of = motion_functions(features)
    relative_of, impulses_of, parting_of = resolving_functions(features)
    bearing_of, (_, add_impulses) = bearing_function(features), adding_functions(features)
    move_end, move_solid = moving_functions(features, note)

    @wp.func
    def push_all(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3], speeds: float,
    ):  # fmt: skip
        """Push all marked contacts apart, by all threads of a block, a thread a contact and then a thread an end.

        Args:
            speeds: 1, or 0 where they are moved without speed.
        """
        count = working.listed_contact_counts[world, MARKED]
        for item in range(thread, count, wp.block_dim()):
            contact = working.listed_contacts[world, working.listed_contacts[world, item].marked]
            bearing = bearing_of(t, working, world, contact)
            if speeds > 0.0:
                moving = four_of(velocities, contact.ends)
                solid = motion_of(t, state, working, world, contact)
                relative = relative_of(contact, moving, bearing.kind, solid)
                impulses = impulses_of(contact, bearing, moving, relative, t.step_seconds)
                add_impulses(t, working, world, contact, impulses, speeds)
            else:
                add_impulses(t, working, world, contact, parting_of(contact, bearing), speeds)
        block_barrier()
        if thread == 0:
            working.listed_contact_counts[world, MARKED] = 0
        for item in range(thread, 4 * count, wp.block_dim()):
            place = working.listed_contacts[world, item // 4].marked
            particle = working.listed_contacts[world, place].ends[item % 4]
            move_end(t, working, world, particle, points, velocities, speeds)
        if wp.static(features.bodies > 0 or features.round_ridges):
            for item in range(thread, count, wp.block_dim()):
                place = working.listed_contacts[world, item].marked
                move_solid(t, state, working, world, working.listed_contacts[world, place], speeds)
        block_barrier()

    return push_all


@cache
def obstacle_contact_function(of: Sweep, every: Features) -> Any:
    """Return the function that resolves all contacts of a sweep's kinds, by all threads of a block."""
    features, max_sweeps = of.seen(every), of.most(every)
    list_all = sweep_listing(of, every, False)
    mark_pushed, mark_overlaps = marking_functions(features)
    push_all = pushing_function(features)

    @wp.func
    def meet(
        t: Tables, state: WorldState, working: Working, world: wp.int32, thread: wp.int32, end: float,
        points: wp.array[wp.vec3], velocities: wp.array[wp.vec3],
    ):  # fmt: skip
        """Resolve contacts in a world; soon done where nothing is near."""
        count, overlaps = list_all(t, state, working, world, thread, end, points, velocities)
        sweep = wp.int32(0)
        while count > 0 and sweep < max_sweeps:
            sweep += 1
            again = any_in_block(mark_pushed(t, state, working, world, thread, count, velocities))
            push_all(t, state, working, world, thread, points, velocities, 1.0)
            if not again:
                sweep = max_sweeps
        if overlaps:
            mark_overlaps(t, working, world, thread, count)
            block_barrier()
            push_all(t, state, working, world, thread, points, velocities, 0.0)

    return meet

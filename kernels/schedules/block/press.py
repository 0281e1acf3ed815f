"""Balloons that touch push each other off, by the threads of a block: each has its own particles."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.contact.boxes import (
    APART,
    Sweep,
    is_searched,
    meeting_function,
    put_sweep,
    sweep_of,
)
from balloon_warp.kernels.contact.edges import finding_edges_function
from balloon_warp.kernels.contact.forces import forget_pushes, pushed, take_pushes
from balloon_warp.kernels.contact.parts import box_parts
from balloon_warp.kernels.contact.press import pressing_function
from balloon_warp.kernels.contact.search import LOOKING, TOUCHING, listing_function, looking_function
from balloon_warp.kernels.memory import address_at, put_address, vector_at_address
from balloon_warp.kernels.schedules.block.memory import BlockMemory, Layout, Seat
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import WARP_THREADS, block_barrier, shared_words, warp_max


class Presses(NamedTuple):
    """What a block does where balloons touch."""

    press: Any
    """(t, state, memory, seat, even, odd, velocities): as a substep begins, with the tiles in which those of even and
    of odd numbers find points; now and then it is found who may touch whom. A barrier follows"""
    take: Any
    """(memory, seat, member): what contacts do to a particle then [N]"""
    push: Any
    """(t, memory, seat, member, velocity): the velocity that they give it"""


@wp.func
def warp_max_of_vectors(v: wp.vec3):
    """Component by component, over the threads of the warp; called by all of them."""
    return wp.vec3(warp_max(v[0]), warp_max(v[1]), warp_max(v[2]))


@cache
def presses_of(traits: Traits, layout: Layout) -> Presses:
    """For the warps of a block."""
    note_looking, list_triangles = looking_function(traits), listing_function(traits)
    press_particle = pressing_function(traits, vector_at_address)
    meet_all = meeting_function(traits)
    find_edges = finding_edges_function(traits) if traits.edges_meet else None
    warps = layout.warps
    tiles = shared_words("tiles", 4)

    @wp.func
    def box_balloons(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat, velocities: wp.array[wp.vec3]):
        """A warp a balloon: see the kernel of that name."""
        for balloon in range(seat.thread // WARP_THREADS, memory.contacts.balloon_boxes.shape[1], warps):
            own = sweep_of(
                t, balloon, seat.thread % WARP_THREADS, wp.min(WARP_THREADS, wp.block_dim()),
                state.points[seat.world], velocities, memory.contacts.sought[seat.world],
            )  # fmt: skip
            sweep = Sweep()
            sweep.lower = -warp_max_of_vectors(-own.lower)
            sweep.upper = warp_max_of_vectors(own.upper)
            sweep.fastest = warp_max(own.fastest)
            sweep.strayed = warp_max(own.strayed)
            if seat.thread % WARP_THREADS == 0:
                put_sweep(t, memory.contacts, seat.world, balloon, sweep, seat.substep == 0)

    @wp.func
    def search(
        t: Tables, state: WorldState, memory: BlockMemory, seat: Seat, points: wp.uint64, velocities: wp.array[wp.vec3]
    ):
        """Who may touch whom until the next search, if what the last one found does not do. Threads find each other's
        points in the state."""
        for particle in range(seat.thread, seat.count, wp.block_dim()):
            state.points[seat.world, particle] = vector_at_address(points, particle)
        block_barrier()
        box_balloons(t, state, memory, seat, velocities)
        block_barrier()
        any_near = meet_all(t, memory.contacts, seat.world, seat.thread)
        block_barrier()
        if is_searched(memory.contacts, seat.world):
            if any_near:
                box_parts(
                    t, memory.contacts, seat.world, seat.thread, wp.block_dim(), state.points[seat.world], velocities
                )
            for particle in range(seat.thread, seat.count, wp.block_dim()):
                note_looking(t, state, memory.contacts, seat.world, particle, state.points[seat.world], velocities)
            block_barrier()
            for place in range(seat.thread, memory.contacts.list_lengths[seat.world, LOOKING], wp.block_dim()):
                list_triangles(
                    t, state, memory.contacts, seat.world, memory.contacts.particle_lists[seat.world, LOOKING, place],
                    state.points[seat.world], velocities,
                )  # fmt: skip
            if wp.static(traits.edges_meet):
                for edge in range(seat.thread, t.touch.edges.shape[0], wp.block_dim()):
                    find_edges(t, memory.contacts, seat.world, edge, state.points[seat.world], velocities)
            block_barrier()

    @wp.func
    def is_near(memory: BlockMemory, seat: Seat):
        """Whether any balloons may touch, or did until the last search."""
        near_balloons = memory.contacts.near_balloons[seat.world]
        return near_balloons[near_balloons.shape[0] - 1] != APART

    @wp.func
    def press_all(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        points: wp.uint64,
        velocities: wp.array[wp.vec3],
        only_counts: bool,
    ):
        """Every particle touches what was found near it, or it is only counted what does."""
        for place in range(seat.thread, memory.contacts.list_lengths[seat.world, TOUCHING], wp.block_dim()):
            press_particle(
                t, state, memory.contacts, seat.world, memory.contacts.particle_lists[seat.world, TOUCHING, place],
                points, velocities, only_counts,
            )  # fmt: skip
        block_barrier()

    @wp.func
    def press(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        even: Any,
        odd: Any,
        velocities: wp.array[wp.vec3],
    ):
        put_address(tiles(), 0, even)  # each thread for itself, and all the same
        put_address(tiles(), 1, odd)
        points = address_at(tiles(), seat.substep % 2)
        between = wp.int32(t.touch.seconds / t.step_seconds + 0.5)
        if seat.substep % between == 0:
            search(t, state, memory, seat, points, velocities)
        if is_near(memory, seat):
            first = wp.where(seat.substep == 0, 0, 1)
            if first == 0:  # as in `TouchPieces.search`
                for particle in range(seat.thread, seat.count, wp.block_dim()):
                    forget_pushes(memory.contacts, seat.world, particle)
                block_barrier()
            for turn in range(first, 2):  # the first only counts; one loop, so that the code for it is there once
                press_all(t, state, memory, seat, points, velocities, turn == 0)
                if turn == 0:
                    for particle in range(seat.thread, seat.count, wp.block_dim()):
                        take_pushes(memory.contacts, seat.world, particle)
                    block_barrier()

    @wp.func
    def take(memory: BlockMemory, seat: Seat, member: Any):
        force = wp.vec3()
        if member.active:
            force = take_pushes(memory.contacts, seat.world, member.own.number)
        return force

    @wp.func
    def push(t: Tables, memory: BlockMemory, seat: Seat, member: Any, velocity: wp.vec3):
        if member.active:
            velocity = pushed(memory.contacts, member.own, member.gain, velocity)
        return velocity

    return Presses(press, take, push)

"""Free bodies, small spheres that meet faces, and edges that meet, by the threads of a block.

What they do with particles is what launches do, with the same functions: once all particles have moved, they and the
spheres are put into the state, and taken from there when all have met."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.contact.bodies import bodies_function
from balloon_warp.kernels.contact.edges import edges_function
from balloon_warp.kernels.contact.faces import faces_function
from balloon_warp.kernels.loops.tumbling import tumbling_function
from balloon_warp.kernels.memory import put_in_tile
from balloon_warp.kernels.schedules.block.board import Board
from balloon_warp.kernels.schedules.block.gas import GasSums
from balloon_warp.kernels.schedules.block.memory import BlockMemory, Seat
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warps import block_barrier


class Solids(NamedTuple):
    """What a block does with them."""

    tumble: Any
    """(t, state, memory, seat): bodies by a substep, once spheres have moved; a barrier follows"""
    meet: Any
    """(t, state, memory, seat, source, target, velocities): bodies and particles, spheres and faces, then
    edges, once particles have moved and left all else; a barrier follows"""


@cache
def solids_of(traits: Traits, board: Board, gas: GasSums) -> Solids:
    """For what a scene has."""
    tumble_bodies = tumbling_function(traits) if traits.bodies else None
    touch_bodies = bodies_function(traits) if traits.bodies else None
    meet_faces = faces_function(traits) if traits.small_spheres else None
    meet_edges = edges_function(traits) if traits.edges_meet else None
    molar_mass = traits.columns.places["molar_mass"]

    @wp.func
    def show_spheres(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat):
        """By the first thread, from the board into the state."""
        if wp.static(traits.spheres > 0):
            if seat.thread == 0:
                board.show(t, state, memory.contacts.sphere_starts, seat.world, seat.substep)

    @wp.func
    def take_spheres(t: Tables, state: WorldState, seat: Seat):
        """By the first thread, back to the board."""
        if wp.static(traits.spheres > 0):
            if seat.thread == 0:
                board.take(t, state, seat.world, seat.substep)

    @wp.func
    def tumble(t: Tables, state: WorldState, memory: BlockMemory, seat: Seat):
        if wp.static(traits.bodies > 0):
            show_spheres(t, state, memory, seat)
            if seat.thread == 0:
                tumble_bodies(t, state, memory.contacts, seat.world, seat.time)
            take_spheres(t, state, seat)
            block_barrier()

    @wp.func
    def show_particles(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        source: Any,
        target: Any,
    ):
        """Where they were and are, into arrays, and what moves with them."""
        for particle in range(seat.thread, seat.count, wp.block_dim()):
            state.points[seat.world, particle] = target[particle]
            if wp.static(traits.small_spheres):
                memory.contacts.point_starts[seat.world, particle] = source[particle]
        if wp.static(traits.gas):
            for balloon in range(seat.thread, memory.contacts.gas_masses.shape[1], wp.block_dim()):
                row = row_of_world(seat.world, t.balloon_numbers.shape[0])
                along = gas.amount_at(seat.substep, balloon) * t.balloon_numbers[row, balloon, molar_mass]
                if wp.static(traits.takes_air_along):
                    along += gas.air_at(balloon)
                memory.contacts.gas_masses[seat.world, balloon] = along

    @wp.func
    def meet(
        t: Tables,
        state: WorldState,
        memory: BlockMemory,
        seat: Seat,
        source: Any,
        target: Any,
        velocities: wp.array[wp.vec3],
    ):
        block_barrier()
        show_particles(t, state, memory, seat, source, target)
        show_spheres(t, state, memory, seat)
        block_barrier()
        points = state.points[seat.world]
        if wp.static(traits.bodies > 0):
            touch_bodies(t, state, memory.contacts, seat.world, seat.thread, points, velocities)
            block_barrier()
        if wp.static(traits.small_spheres):
            meet_faces(t, state, memory.contacts, seat.world, seat.thread, points, velocities)
            block_barrier()
        if wp.static(traits.edges_meet):
            meet_edges(t, state, memory.contacts, seat.world, seat.thread, points, velocities)
            block_barrier()
        take_spheres(t, state, seat)
        for particle in range(seat.thread, seat.count, wp.block_dim()):
            put_in_tile(target, particle, points[particle])
        block_barrier()

    return Solids(tumble, meet)

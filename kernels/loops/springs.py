"""Springs: one by one, those of a particle, and those in the registers of its thread.

Where quads go all around a particle, its structural and shear springs go around it in a ring, e0 s0 e1 s1 ... e0, so
that the points at their other ends, once loaded, give the area vectors of the quads between them, too.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.compose import numbers_reader
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.outer import FAR
from balloon_warp.kernels.loops.areas import CROSSES, add_quad_normal, normal_of_quads, plus_cross_at_quad_corner
from balloon_warp.kernels.memory import (
    float_at,
    four_ints_at,
    in_tile,
    int_at,
    int_pair_at,
    packed_pair_at,
    pair_at,
    two_in,
    vector_at,
)
from balloon_warp.kernels.tables import CHUNK, SLICE, RingTable, Tables, first_entry


@wp.func
def constant_of_kind(n: Any, kind: wp.int32):
    """Return a spring constant, which stand first among a balloon's numbers; without the memory that an index needs."""
    return wp.where(kind == 0, n[0], wp.where(kind == 1, n[1], n[2]))


@cache
def pair_pull(features: Features) -> Any:
    """Return the function that evaluates one spring of the table of pairs."""
    coefficient = features.laws_on("spring")
    read_numbers = numbers_reader(features.columns)

    @wp.func
    def pull_of_pair(t: Tables, world: wp.int32, spring: wp.int32, points: Any, velocities: Any, time: float):
        """Return the vector from a spring's first end to its second [m], and its tension over length [N/m].

        Their product is the force on the first end.
        """
        p = t.pairs.particles[spring][0]
        q = t.pairs.particles[spring][1]
        n = read_numbers(t, world, t.particles.balloon[p])
        stiffness = constant_of_kind(n, t.pairs.kinds[spring]) * t.pairs.scales[spring]
        length = t.pairs.rest_lengths[spring]
        d = points[q] - points[p]
        opening = wp.dot(velocities[q] - velocities[p], d)
        return d, coefficient(
            squared_length(d), opening, length, stiffness, stiffness * length, t.step_seconds, time, n
        )

    return pull_of_pair


@cache
def spring_pull(features: Features) -> Any:
    """Return the function for the force of a spring on the particle at one of its ends."""
    coefficient = features.laws_on("spring")
    moving = features.needs("spring", "opening")

    @wp.func
    def pull_of_spring(
        t: Tables,
        velocities: Any,
        params: Any,
        end: wp.int32,
        d: wp.vec3,
        stiffness: float,
        length: float,
        velocity: wp.vec3,
        time: float,
    ):
        """Return the force of a spring [N]; `d` leads to the other end [m].

        Padding leads to the particle itself, and has no force.
        """
        opening = float(0.0)
        if wp.static(moving):
            opening = wp.dot(vector_at(velocities, end) - velocity, d)
        pull = d * coefficient(
            squared_length(d), opening, length, stiffness, stiffness * length, t.step_seconds, time, params.n
        )
        if wp.static(features.guarded):
            pull = wp.where(end == params.number, wp.vec3(), pull)
        return pull

    return pull_of_spring


@cache
def spring_loop(features: Features, at: Any) -> Any:
    """Return the function that sums a particle's springs, read from the table."""
    pull_of_spring = spring_pull(features)

    @wp.func
    def pull_of_springs(
        t: Tables,
        points: Any,
        velocities: Any,
        params: Any,
        springs: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        """Return the net force of a particle's springs [N]."""
        force = wp.vec3()
        begin = first_entry(t.springs.slice_offsets, params.number)
        for chunk in range(begin, begin + SLICE * int_at(t.springs.valences, params.number), SLICE * CHUNK):
            for slot in range(CHUNK):
                entry = chunk + SLICE * slot
                spring = pair_at(t.springs.entries, entry)
                end = wp.cast(spring[0], wp.int32)
                stiffness = constant_of_kind(params.n, end & 3)
                if wp.static(features.springs_vary):
                    stiffness *= float_at(t.springs.scales, entry)
                force += pull_of_spring(
                    t, velocities, params, end >> 2, at(points, end >> 2) - point, stiffness,
                    spring[1], velocity, time,
                )  # fmt: skip
        return force

    return pull_of_springs


@cache
def ring_ends(at: Any) -> Any:
    """Return the function that reads the ends of two springs in the schedule's layout."""
    packed = at is in_tile

    @wp.func
    def ends_at(rings: RingTable, entry: wp.int32):
        if wp.static(packed):
            return packed_pair_at(rings.packed_ends, entry)
        else:
            return int_pair_at(rings.ends, entry)

    return ends_at


@cache
def ring_loop(features: Features, at: Any, inflation_directions: bool = False) -> Any:
    """Return the function that loops over the quads around a particle, and then over its flexion springs.

    Args:
        inflation_directions: whether it finds A_p n, too.
    """
    pull_of_spring = spring_pull(features)
    ends_at = ring_ends(at)

    @wp.func
    def scales_of(t: Tables, entry: wp.int32):
        """Return the factors on the constants of two springs."""
        if wp.static(features.springs_vary):
            return pair_at(t.rings.scales, entry)
        else:
            return wp.vec2(1.0, 1.0)

    @wp.func
    def around(
        t: Tables,
        points: Any,
        velocities: Any,
        params: Any,
        springs: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        """Return the net force of the springs [N], and where they are needed the area vector and A_p n [m^2]."""
        force = wp.vec3()
        crosses = wp.vec3()
        normal = wp.vec3()
        nearest = wp.vec2(FAR, 0.0)
        place = four_ints_at(t.rings.places, params.number)
        before = at(points, place[3]) - point
        middle = place[0] + SLICE * place[1]
        next_ends = ends_at(t.rings, place[0])
        next_lengths = pair_at(t.rings.lengths, place[0])
        for entry in range(place[0], middle, SLICE):
            ends = next_ends
            lengths = next_lengths
            next_ends = ends_at(t.rings, entry + SLICE)  # so that they are there in the next turn
            next_lengths = pair_at(t.rings.lengths, entry + SLICE)
            scales = scales_of(t, entry)
            across = at(points, ends[0]) - point
            along = at(points, ends[1]) - point
            force += pull_of_spring(
                t, velocities, params, ends[0], across, params.n[1] * scales[0], lengths[0], velocity, time
            )
            force += pull_of_spring(
                t, velocities, params, ends[1], along, params.n[0] * scales[1], lengths[1], velocity, time
            )
            if wp.static(features.measures_areas):
                crosses = plus_cross_at_quad_corner(crosses, before, across, along)
            if wp.static(inflation_directions):
                turned, nearer = add_quad_normal(normal, nearest, before, across, along)
                normal = turned
                nearest = nearer
            before = along
        for entry in range(middle, middle + SLICE * place[2], SLICE):
            ends = next_ends
            lengths = next_lengths
            next_ends = ends_at(t.rings, entry + SLICE)
            next_lengths = pair_at(t.rings.lengths, entry + SLICE)
            scales = scales_of(t, entry)
            for number in range(2):
                force += pull_of_spring(
                    t, velocities, params, ends[number], at(points, ends[number]) - point, params.n[2] * scales[number],
                    lengths[number], velocity, time,
                )  # fmt: skip
        return force, CROSSES * crosses, normal_of_quads(normal, nearest)

    return around


@wp.struct
class SlotTable:
    """The springs of each particle in a fixed number of slots for each kind, filled up with springs that do nothing."""

    neighbors: wp.array2d[wp.int32]
    """Particle at the other end, shape (slot_count, particle_count)"""
    scales: wp.array2d[float]
    """Spring constants over those of their kinds, 0 where there is no spring, shape (slot_count, particle_count)"""
    rest_lengths: wp.array2d[float]
    """Rest lengths [m], shape (slot_count, particle_count)"""
    valences: wp.array[wp.int32]
    """Number of structural springs of each particle, shape (particle_count,)"""


Slots = tuple[int, int, int]
"""Largest number of springs of each kind at a particle"""


@cache
def springs_reader(features: Features, kind_slots: Slots, derived: bool = False) -> tuple[Any, Any]:
    """Return the type that holds a particle's springs, and the function that reads it.

    Where a thread has no particle, all springs lead to its place.

    Args:
        derived: whether the springs' laws are derived, which takes all of their numbers.
    """
    shear_begin, flexion_begin = kind_slots[0], kind_slots[0] + kind_slots[1]
    slots, lengths_matter = sum(kind_slots), features.needs("spring", "rest_length") or derived
    Indices = wp.types.vector(length=max(slots, 1), dtype=wp.int32)  # noqa: N806 - a type
    Numbers = wp.types.vector(length=max(slots, 1), dtype=wp.float32)  # noqa: N806

    @wp.struct
    class Springs:
        """The springs of a particle."""

        valence: wp.int32
        neighbors: Indices
        stiffness: Numbers  # where springs of a kind differ [N/m]
        scales: Numbers  # where they differ and are derived
        tensions: Numbers  # rest length times spring constant [N]
        lengths: Numbers  # where a law names them [m]

    @wp.func
    def read_springs(t: Tables, slot_table: SlotTable, params: Any, place: wp.int32, active: bool):
        """Read a particle's springs into registers."""
        mine = Springs()
        mine.valence = slot_table.valences[params.number]
        for slot in range(slots):
            neighbor = slot_table.neighbors[slot, params.number]
            neighbor = wp.where(active, neighbor, place)
            mine.neighbors[slot] = neighbor & 0xFFFF  # tells the compiler: not negative
            constant = wp.where(
                slot < shear_begin, params.n[0], wp.where(slot < flexion_begin, params.n[1], params.n[2])
            )
            stiffness = constant * slot_table.scales[slot, params.number]
            length = slot_table.rest_lengths[slot, params.number]
            mine.tensions[slot] = stiffness * length
            if wp.static(features.springs_vary):
                mine.stiffness[slot] = stiffness
                mine.scales[slot] = slot_table.scales[slot, params.number]
            if wp.static(lengths_matter):
                mine.lengths[slot] = length
        return mine

    return Springs, read_springs


@cache
def paired_reader(features: Features, kind_slots: Slots) -> Any:
    """Return the function that reads a particle's springs from pairs, where all springs of a kind are alike."""
    shear_begin, flexion_begin = kind_slots[0], kind_slots[0] + kind_slots[1]
    slots = sum(kind_slots)
    Springs, _ = springs_reader(features, kind_slots, True)  # noqa: N806 - a type

    @wp.func
    def read_pairs(slot_pairs: wp.array2d[wp.vec2], slot_table: SlotTable, params: Any):
        """Read a particle's springs; a pair is the neighbor, by the bits, and the rest length [m]."""
        mine = Springs()
        mine.valence = slot_table.valences[params.number]
        for slot in range(slots):
            pair = two_in(slot_pairs, slot, params.number)
            constant = wp.where(
                slot < shear_begin, params.n[0], wp.where(slot < flexion_begin, params.n[1], params.n[2])
            )
            mine.neighbors[slot] = wp.cast(pair[0], wp.int32) & 0xFFFF
            mine.tensions[slot] = constant * pair[1]
            mine.lengths[slot] = pair[1]
        return mine

    return read_pairs


@cache
def slot_loop(features: Features, kind_slots: Slots) -> Any:
    """Return the function that sums the springs of a particle."""
    shear_begin, flexion_begin = kind_slots[0], kind_slots[0] + kind_slots[1]
    slots = sum(kind_slots)
    coefficient = features.laws_on("spring")
    moving = features.needs("spring", "opening")
    lengths_matter = features.needs("spring", "rest_length")

    @wp.func
    def pull_of_slot(
        t: Tables,
        points: Any,
        velocities: Any,
        params: Any,
        springs: Any,
        slot: wp.int32,
        constant: float,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        """Force of one spring [N]; padding leads to the particle itself."""
        neighbor = springs.neighbors[slot]
        d = points[neighbor] - point
        stiffness = constant
        if wp.static(features.springs_vary):
            stiffness = springs.stiffness[slot]
        length = float(0.0)
        if wp.static(lengths_matter):
            length = springs.lengths[slot]
        opening = float(0.0)
        if wp.static(moving):
            opening = wp.dot(vector_at(velocities, neighbor) - velocity, d)
        pull = d * coefficient(
            squared_length(d), opening, length, stiffness, springs.tensions[slot],
            t.step_seconds, time, params.n,
        )  # fmt: skip
        if wp.static(features.guarded):
            pull = wp.where(neighbor == params.number, wp.vec3(), pull)
        return pull

    @wp.func
    def pull_of_springs(
        t: Tables,
        points: Any,
        velocities: Any,
        params: Any,
        springs: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        """Return the net force of the springs [N]."""
        force = wp.vec3()
        for slot in range(shear_begin):
            force += pull_of_slot(t, points, velocities, params, springs, slot, params.n[0], point, velocity, time)
        for slot in range(shear_begin, flexion_begin):
            force += pull_of_slot(t, points, velocities, params, springs, slot, params.n[1], point, velocity, time)
        for slot in range(flexion_begin, slots):
            force += pull_of_slot(t, points, velocities, params, springs, slot, params.n[2], point, velocity, time)
        return force

    return pull_of_springs


@cache
def ring_area(shear_begin: int, min_valence: int) -> Any:
    """Return the function for a particle's area vector by the quads between its springs.

    Args:
        shear_begin: slots of structural springs.
        min_valence: quads around each particle that there are at least.
    """

    @wp.func
    def area_vector_in_ring(t: Tables, points: Any, params: Any, springs: Any, point: wp.vec3):
        """Return the area vector of a particle from the quads around it [m^2].

        Slots past its valence hold the particle itself.
        """
        crosses = wp.vec3()
        first = in_tile(points, springs.neighbors[0]) - point
        before = first
        for slot in range(1, shear_begin):
            opposite = in_tile(points, springs.neighbors[shear_begin + slot - 1]) - point
            after = in_tile(points, springs.neighbors[slot]) - point
            end = after
            if slot >= min_valence:
                end = wp.where(slot == springs.valence, first, after)
            crosses = plus_cross_at_quad_corner(crosses, before, opposite, end)
            before = after
        opposite = in_tile(points, springs.neighbors[2 * shear_begin - 1]) - point
        return CROSSES * plus_cross_at_quad_corner(crosses, before, opposite, first)

    return area_vector_in_ring


@cache
def ring_normal(shear_begin: int) -> Any:
    """Return the function for A_p n of a particle by the same quads."""

    @wp.func
    def normal_in_ring(t: Tables, points: Any, params: Any, springs: Any, point: wp.vec3):
        """Return A_p n of a particle, by the quads around it [m^2]."""
        normal = wp.vec3()
        nearest = wp.vec2(FAR, 0.0)
        first = in_tile(points, springs.neighbors[0]) - point
        before = first
        for slot in range(1, shear_begin):
            opposite = in_tile(points, springs.neighbors[shear_begin + slot - 1]) - point
            after = in_tile(points, springs.neighbors[slot]) - point
            end = wp.where(slot == springs.valence, first, after)
            turned, nearer = add_quad_normal(normal, nearest, before, opposite, end)
            normal = wp.where(slot <= springs.valence, turned, normal)
            nearest = wp.where(slot <= springs.valence, nearer, nearest)
            before = after
        opposite = in_tile(points, springs.neighbors[2 * shear_begin - 1]) - point
        turned, nearer = add_quad_normal(normal, nearest, before, opposite, first)
        normal = wp.where(springs.valence == shear_begin, turned, normal)
        nearest = wp.where(springs.valence == shear_begin, nearer, nearest)
        return normal_of_quads(normal, nearest)

    return normal_in_ring

"""A particle's springs in the registers of its thread."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.springs import spring_coefficient, squared_length
from balloon_warp.kernels.tables import row_of_world


@wp.struct
class SlotTable:
    """The springs of each particle in a fixed number of slots for each kind, filled up with springs that do nothing."""

    neighbors: wp.array2d[wp.int32]
    """the particle at the other end, shape (slot_count, particle_count)"""
    scales: wp.array2d[float]
    """a spring's constant over that of its kind, shape (slot_count, particle_count)"""
    rest_lengths: wp.array2d[float]
    """times the scale [m], shape (slot_count, particle_count)"""
    stiffness: wp.array3d[float]
    valences: wp.array[wp.int32]
    """structural springs of each particle, shape (particle_count,)"""
    faces: wp.array2d[wp.int32]
    """the faces around each particle, -1 where there are no more, shape (face_slot_count, particle_count)"""


@cache
def slot_functions(kind_slots: tuple[int, int, int], springs_vary: bool) -> tuple[Any, ...]:
    """For so many slots of each kind: the type of what is kept in registers, and the functions that read it, sum the
    forces of all springs, and find that of one."""
    structural_slots = kind_slots[0]
    shear_end = structural_slots + kind_slots[1]
    slots = shear_end + kind_slots[2]
    Indices = wp.types.vector(length=slots, dtype=wp.int32)  # noqa: N806 - a type
    Numbers = wp.types.vector(length=slots, dtype=wp.float32)  # noqa: N806

    @wp.struct
    class Springs:
        """The springs of a particle."""

        structural: float
        shear: float
        flexion: float
        neighbors: Indices
        scales: Numbers
        rests: Numbers  # rest length times spring constant [N]

    @wp.func
    def read_springs(springs: SlotTable, world: wp.int32, balloon: wp.int32, particle: wp.int32):
        """Into registers; constants[kind] * scale is a spring's own."""
        mine = Springs()
        row = row_of_world(world, springs.stiffness.shape[0])
        mine.structural = springs.stiffness[row, balloon, 0]
        mine.shear = springs.stiffness[row, balloon, 1]
        mine.flexion = springs.stiffness[row, balloon, 2]
        for slot in range(slots):
            mine.neighbors[slot] = springs.neighbors[slot, particle] & 0xFFFF  # tells the compiler: not negative
            mine.rests[slot] = springs.rest_lengths[slot, particle]
            if wp.static(springs_vary):
                mine.scales[slot] = springs.scales[slot, particle]
        for slot in range(structural_slots):
            mine.rests[slot] *= mine.structural
        for slot in range(structural_slots, shear_end):
            mine.rests[slot] *= mine.shear
        for slot in range(shear_end, slots):
            mine.rests[slot] *= mine.flexion
        return mine

    @wp.func
    def pull_of_slot(points: Any, point: wp.vec3, springs: Springs, slot: wp.int32, stiffness: float):
        """Force of one spring [N]."""
        d = points[springs.neighbors[slot]] - point
        constant = stiffness
        if wp.static(springs_vary):
            constant *= springs.scales[slot]
        return spring_coefficient(squared_length(d), constant, springs.rests[slot]) * d

    @wp.func
    def pull_of_slots(points: Any, point: wp.vec3, springs: Springs):
        """Net force of the springs [N]."""
        force = wp.vec3()
        for slot in range(structural_slots):
            force += pull_of_slot(points, point, springs, slot, springs.structural)
        for slot in range(structural_slots, shear_end):
            force += pull_of_slot(points, point, springs, slot, springs.shear)
        for slot in range(shear_end, slots):
            force += pull_of_slot(points, point, springs, slot, springs.flexion)
        return force

    return Springs, read_springs, pull_of_slots, pull_of_slot

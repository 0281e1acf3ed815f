"""Symmetric linear systems that were factorized or inverted beforehand, for eight worlds at a time.

What is solved for is a vec3 of each particle: one matrix serves x, y and z.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3, column, lanes_scaled


@wp.struct
class FactorTable:
    """L without its diagonal of ones, column by column, of P A P^T = L D L^T."""

    place: wp.array[wp.int32]
    """the row of each particle, shape (particle_count,)"""
    offsets: wp.array[wp.int32]
    """where each column begins in `rows`, shape (particle_count + 1,)"""
    rows: wp.array[wp.int32]
    """ascending within a column, shape (entry_count,)"""


@wp.func
def times(factor: float, lanes: Lanes3):
    """The factor that all worlds share times each world's vector."""
    return factor * lanes


@wp.func
def times(factor: Lanes, lanes: Lanes3):  # noqa: F811 - an overload
    """Each world's factor times its vector."""
    return lanes_scaled(lanes, factor)


@cache
def factored_solver(factor_type: Any) -> Any:
    """The kernel that solves by L D L^T.

    Args:
        factor_type: `float` where all worlds have the same matrix, `Lanes` where each has its own.
    """

    @wp.kernel(module="unique", enable_backward=False)
    def solve_factored(
        # model
        factor: FactorTable,
        entries: wp.array2d[factor_type],
        inverse_pivots: wp.array2d[factor_type],
        # state in
        right_sides: wp.array2d[wp.vec3],
        # state out
        work: wp.array2d[Lanes3],
        solutions: wp.array2d[wp.vec3],
    ):
        """A thread a group of eight worlds. `entries` is of L, and with `inverse_pivots` has a row, or one a group."""
        group = wp.tid()
        matrix = wp.min(group, entries.shape[0] - 1)
        count = factor.place.shape[0]
        for lane in range(LANE_COUNT):
            world = wp.min(group * LANE_COUNT + lane, right_sides.shape[0] - 1)
            for particle in range(count):
                for axis in range(3):
                    work[group, factor.place[particle]][axis, lane] = right_sides[world, particle][axis]
        for row in range(count):
            solved = work[group, row]
            for entry in range(factor.offsets[row], factor.offsets[row + 1]):
                below = factor.rows[entry]
                work[group, below] = work[group, below] - times(entries[matrix, entry], solved)
        for step in range(count):
            row = count - 1 - step
            solved = times(inverse_pivots[matrix, row], work[group, row])
            for entry in range(factor.offsets[row], factor.offsets[row + 1]):
                solved -= times(entries[matrix, entry], work[group, factor.rows[entry]])
            work[group, row] = solved
        for lane in range(LANE_COUNT):
            world = group * LANE_COUNT + lane
            if world < solutions.shape[0]:
                for particle in range(count):
                    solutions[world, particle] = column(work[group, factor.place[particle]], lane)

    return solve_factored


@wp.struct
class InverseTable:
    """The inverses of the balloons' matrices, one after the other."""

    balloon: wp.array[wp.int32]
    """the balloon of each particle, shape (particle_count,)"""
    particle_offsets: wp.array[wp.int32]
    """where each balloon's particles begin, shape (balloon_count + 1,)"""
    entry_offsets: wp.array[wp.int32]
    """where each balloon's inverse begins in `entries`, shape (balloon_count,)"""
    entries: wp.array2d[float]
    """shape (matrix_count, entry_count)"""
    of_world: wp.array[wp.int32]
    """the matrix of each world, shape (world_count,)"""


@wp.kernel(enable_backward=False)
def multiply_shared_inverse(
    # model
    inverse: InverseTable,
    # state in
    right_sides: wp.array2d[wp.vec3],
    # state out
    solutions: wp.array2d[wp.vec3],
):
    """A thread a particle of eight worlds, which all have matrix 0: each entry that is loaded serves 24 numbers."""
    group, particle = wp.tid()
    balloon = inverse.balloon[particle]
    begin = inverse.particle_offsets[balloon]
    count = inverse.particle_offsets[balloon + 1] - begin
    first_entry = inverse.entry_offsets[balloon] + particle - begin
    last_world = right_sides.shape[0] - 1
    total = Lanes3()
    for other in range(count):
        entry = inverse.entries[0, first_entry + other * count]
        for lane in range(LANE_COUNT):
            right_side = right_sides[wp.min(group * LANE_COUNT + lane, last_world), begin + other]
            for axis in range(3):
                total[axis, lane] += entry * right_side[axis]
    for lane in range(LANE_COUNT):
        if group * LANE_COUNT + lane <= last_world:
            solutions[group * LANE_COUNT + lane, particle] = column(total, lane)


@wp.kernel(enable_backward=False)
def multiply_own_inverse(
    # model
    inverse: InverseTable,
    # state in
    right_sides: wp.array2d[wp.vec3],
    # state out
    solutions: wp.array2d[wp.vec3],
):
    """A thread a (world, particle)."""
    world, particle = wp.tid()
    balloon = inverse.balloon[particle]
    begin = inverse.particle_offsets[balloon]
    count = inverse.particle_offsets[balloon + 1] - begin
    first_entry = inverse.entry_offsets[balloon] + particle - begin
    matrix = inverse.of_world[world]
    total = wp.vec3()
    for other in range(count):
        entry = inverse.entries[matrix, first_entry + other * count]
        total += entry * right_sides[world, begin + other]
    solutions[world, particle] = total

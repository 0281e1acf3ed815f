"""Symmetric linear systems that were factorized or inverted beforehand, for several worlds at a time.

The unknown is a vec3 of each particle: one matrix serves x, y and z.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import scaled
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes3, of_lane
from balloon_warp.kernels.memory import put_in_tile
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.warps import block_barrier

wp.set_module_options(OPTIONS)


@wp.struct
class FactorTable:
    """L without its diagonal of ones, column by column, of P A P^T = L D L^T."""

    place: wp.array[wp.int32]
    """Row of each particle, shape (particle_count,)"""
    offsets: wp.array[wp.int32]
    """Begin of each column in `rows`, shape (particle_count + 1,)"""
    rows: wp.array[wp.int32]
    """Row numbers, ascending within a column, shape (entry_count,)"""


@wp.func
def any_of(going: wp.array[wp.int32], first: wp.int32, count: wp.int32):
    """Return whether any world of a group goes on, of those that exist."""
    found = bool(False)
    for world in range(first, wp.min(first + count, going.shape[0])):
        found = found or going[world] != 0
    return found


@cache
def factored_solver(factor_type: Any) -> Any:
    """Return the kernel that solves by L D L^T.

    Args:
        factor_type: `float` where all worlds have the same matrix, `Lanes` where each has its own.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def solve_factored(
        # model
        factor: FactorTable,
        entries: wp.array2d[factor_type],
        inverse_pivots: wp.array2d[factor_type],
        # state in
        right_sides: wp.array2d[wp.vec3],
        going: wp.array[wp.int32],
        # state out
        work: wp.array2d[Lanes3],
        solutions: wp.array2d[wp.vec3],
    ):
        """Solve for a group of eight worlds a thread, of which at least one is wanted.

        `entries` is of L, and with `inverse_pivots` has a row, or one a group.
        """
        group = wp.tid()
        if not any_of(going, group * LANE_COUNT, LANE_COUNT):
            return
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
                work[group, below] = work[group, below] - scaled(solved, entries[matrix, entry])
        for step in range(count):
            row = count - 1 - step
            solved = scaled(work[group, row], inverse_pivots[matrix, row])
            for entry in range(factor.offsets[row], factor.offsets[row + 1]):
                solved -= scaled(work[group, factor.rows[entry]], entries[matrix, entry])
            work[group, row] = solved
        for lane in range(LANE_COUNT):
            world = group * LANE_COUNT + lane
            if world < solutions.shape[0]:
                for particle in range(count):
                    solutions[world, particle] = of_lane(work[group, factor.place[particle]], lane)

    return solve_factored


@wp.struct
class InverseTable:
    """The inverses of the balloons' matrices, one after the other."""

    particle_offsets: wp.array[wp.int32]
    """Begin of each balloon's particles, shape (balloon_count + 1,)"""
    entry_offsets: wp.array[wp.int32]
    """Begin of each balloon's inverse in `entries`, shape (balloon_count,)"""
    entries: wp.array2d[float]
    """Entries of the inverses, shape (matrix_count, entry_count)"""
    of_world: wp.array[wp.int32]
    """Matrix of each world, shape (world_count,)"""


ROW_THREADS = wp.constant(32)
"""Number of adjacent threads with adjacent rows, which load entries together"""
PARTS = wp.constant(16)
"""Number of partial sums of every sum, by several threads, or by one in the same order"""


@wp.func
def part_begin(count: wp.int32, part: wp.int32):
    """Return the first term of a part."""
    return count * part // PARTS


@wp.kernel(enable_backward=False)
def multiply_own_inverse(
    # model
    inverse: InverseTable,
    tiles: wp.array[wp.vec2i],
    # state in
    right_sides: wp.array2d[wp.vec3],
    going: wp.array[wp.int32],
    # state out
    solutions: wp.array2d[wp.vec3],
):
    """Multiply by inverses of worlds that are few or differ.

    A block a (world, tile of 32 rows), a thread a (part, row).
    """
    world, tile, thread = wp.tid()
    if going[world] == 0:
        return
    balloon = tiles[tile][0]
    first_row = tiles[tile][1]
    begin = inverse.particle_offsets[balloon]
    count = inverse.particle_offsets[balloon + 1] - begin
    rows = wp.min(count - first_row, ROW_THREADS)
    first_entry = inverse.entry_offsets[balloon] + first_row
    matrix = inverse.of_world[world]
    parts = wp.tile_empty(shape=wp.static(int(PARTS * ROW_THREADS)), dtype=wp.vec3, storage="shared")
    for item in range(thread, PARTS * ROW_THREADS, wp.block_dim()):
        part = item // ROW_THREADS
        row = wp.min(item % ROW_THREADS, rows - 1)
        total = wp.vec3()
        for other in range(part_begin(count, part), part_begin(count, part + 1)):
            total += inverse.entries[matrix, first_entry + other * count + row] * right_sides[world, begin + other]
        put_in_tile(parts, item, total)
    block_barrier()
    for row in range(thread, rows, wp.block_dim()):
        total = wp.vec3()
        for part in range(PARTS):
            total += parts[part * ROW_THREADS + row]
        solutions[world, begin + first_row + row] = total


@cache
def shared_inverse_product(rows: int, worlds: int) -> Any:
    """Return the kernel for many worlds that have the same matrix.

    Args:
        rows: of a thread; each right side that is loaded serves all.
        worlds: of a thread; each entry that is loaded serves all.
    """
    Sums = wp.types.matrix(shape=(3 * rows, worlds), dtype=wp.float32)  # noqa: N806 - a type
    Entries = wp.types.vector(length=rows, dtype=wp.float32)  # noqa: N806 - a type

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def multiply_shared_inverse(
        # model
        inverse: InverseTable,
        tiles: wp.array[wp.vec2i],
        # state in
        right_sides: wp.array2d[wp.vec3],
        going: wp.array[wp.int32],
        # state out
        solutions: wp.array2d[wp.vec3],
    ):
        """Multiply by an inverse that worlds share.

        A thread a (group of worlds, tile, thread), which has every 32nd row of the tile.
        """
        group, tile, thread = wp.tid()
        if not any_of(going, group * worlds, worlds):
            return
        balloon = tiles[tile][0]
        row = tiles[tile][1] + thread
        begin = inverse.particle_offsets[balloon]
        count = inverse.particle_offsets[balloon + 1] - begin
        last_world = right_sides.shape[0] - 1
        total = Sums()
        part_count = int(PARTS)
        for part in range(part_count):
            of_part = Sums()
            for other in range(part_begin(count, part), part_begin(count, part + 1)):
                entries = Entries()
                for each in range(rows):
                    column = wp.min(row + each * ROW_THREADS, count - 1)  # of the symmetric matrix
                    entries[each] = inverse.entries[0, inverse.entry_offsets[balloon] + other * count + column]
                for turn in range(worlds):
                    right_side = right_sides[wp.min(group * worlds + turn, last_world), begin + other]
                    for each in range(rows):
                        for axis in range(3):
                            of_part[3 * each + axis, turn] += entries[each] * right_side[axis]
            total += of_part
        for each in range(rows):
            for turn in range(worlds):
                world = group * worlds + turn
                if world <= last_world and row + each * ROW_THREADS < count:
                    solutions[world, begin + row + each * ROW_THREADS] = wp.vec3(
                        total[3 * each, turn], total[3 * each + 1, turn], total[3 * each + 2, turn]
                    )

    return multiply_shared_inverse

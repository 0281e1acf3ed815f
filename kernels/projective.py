"""Projective solver: backward Euler by local and global steps, its linear systems, and its convergence.

After *Fast simulation of mass-spring systems* (Liu et al. 2013). A substep h seeks the displacements u that minimize

    g(u) = sum_p (m + h c) |u - w|^2 / (2 h^2) + E(x + u)

where E is the energy of springs and strings, c the damping, and w the displacement that there would be without them.
The local step projects each spring on its rest length: its vector d becomes L d/|d|. The global step then solves the
linear system (M + h C + h^2 L) u = (M + h C) w + h^2 (pull of the projections), whose matrix A never changes. Here it
is solved for the increment, which float32 resolves better,

    A du = (m + h c) (w - u) + h^2 F(x + u)

since k (L d/|d| - d) is the force of a spring: the local step is Hooke's law, at the particles of the last iteration. A
slack string has itself as projection, so it has no force either. Each such iteration lowers g, whatever h is.

The system is symmetric, and was factorized or inverted beforehand, for several worlds at a time. The unknown is a vec3
of each particle: one matrix serves x, y and z.

An iteration is a step down g along A^-1 times its slope; A is at least the curvature of g. A motion without stretch is
only inertia to g, but springs as well to A: it takes some h^2 k / m iterations to settle. With the momentum of Nesterov
(1983) it takes the root of that: the next one begins beyond the end of this one, by its move times n / (n + 3). n
counts since the momentum was last dropped, which it is wherever it leads up (O'Donoghue and Candes 2015). The balloon's
own momentum stays as it is.

A world has settled once an iteration changes little beside the effect of springs in the whole substep, both by the root
of their energies: |du|^2 = du A du, of the springs (u - w) (M + h C) (u - w). Where coordinates are large and springs
stiff, float32 resolves no more than that: then too, but not before `LEAST_OF_ROUNDED` iterations.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.algebra import scaled
from balloon_warp.kernels.compose import Clock, params_functions, sum_of_laws, time_in_frame_of, time_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes3, of_lane
from balloon_warp.kernels.laws.law import RESULT
from balloon_warp.kernels.laws.outer import DAMPING
from balloon_warp.kernels.loops.net_force import outer_force, string_loop
from balloon_warp.kernels.loops.springs import spring_loop
from balloon_warp.kernels.memory import put_in_tile, vector_at
from balloon_warp.kernels.tables import Tables, WorldState
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


TOLERANCE = 2.0e-3
"""Tolerance: change of the last iteration over the change of springs in a substep"""
WORTH_SAYING = 1.0e-2
"""Tolerance above which a warning is given"""
LEAST_ITERATIONS, MOST_ITERATIONS = 10, 200
"""Range of the number of iterations in a substep, where the scene says "auto" """
LEAST_OF_ROUNDED = wp.constant(60)
"""Least number of iterations before a change below float32's resolution counts as none"""
RESOLUTION = wp.constant(3.0e-8)
"""Relative resolution of coordinates in float32: half of its epsilon, some 1.7 times the changes seen in balloons at
rest"""


@wp.struct
class Settling:
    """Convergence of each world in a substep, and its limits."""

    least: wp.int32
    """Least number of iterations"""
    most: wp.int32
    """Largest number of iterations"""
    tolerance: float
    worth_saying: float
    diagonals: wp.array2d[float]
    """Diagonals of the matrices A [kg], shape (matrix_count, particle_count)"""
    of_world: wp.array[wp.int32]
    """Matrix of each world, shape (world_count,)"""
    iterations: wp.array[wp.int32]
    """Number of iterations made, shape (world_count,), as the next two"""
    gathered: wp.array[wp.int32]
    """Number of iterations in which momentum was gathered"""
    going: wp.array[wp.int32]
    """Whether a world needs more iterations"""
    any_going: wp.array[wp.int32]
    """Whether any world needs more iterations, shape (1,)"""


@cache
def settling_kernel(features: Features, inertia: Any) -> Any:
    """Return the kernel that applies the global step, and tests for convergence.

    Args:
        features: of the model.
        inertia: see `inertia_function`.
    """
    _, read_params = params_functions(features.columns, features.balloons)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def apply_increments(
        # model
        t: Tables,
        # state in
        frame: wp.array[wp.int32],
        points: wp.array2d[wp.vec3],
        # in
        free_displacements: wp.array2d[wp.vec3],
        residuals: wp.array2d[wp.vec3],
        increments: wp.array2d[wp.vec3],
        # in and out
        settling: Settling,
        displacements: wp.array2d[wp.vec3],
        reached: wp.array2d[wp.vec3],
        # out
        trial_points: wp.array2d[wp.vec3],
        unsettled: wp.array[wp.vec2],
    ):
        """Apply the increments of an iteration; a block a world, summed in an order that depends on no other world."""
        world, thread = wp.tid()
        if settling.going[world] == 0:
            return
        iterations = settling.iterations[world] + 1
        gathered = settling.gathered[world]
        matrix = settling.of_world[world]
        part = wp.vec4()
        for particle in range(thread, points.shape[1], wp.block_dim()):
            params = read_params(t, world, particle)
            if params.share > 0.0:
                increment = increments[world, particle]
                residual = residuals[world, particle]
                new = displacements[world, particle] + increment
                lag = new - free_displacements[world, particle]
                coarse = settling.diagonals[matrix, particle] * wp.length_sq(points[world, particle])
                part += wp.vec4(
                    wp.dot(residual, new - reached[world, particle]),
                    wp.dot(residual, increment),
                    inertia(params, t.step_seconds) * wp.length_sq(lag),
                    coarse,
                )
        sums = wp.tile_sum(wp.tile(part, preserve_type=True))[0]
        if sums[0] < 0.0:
            gathered = 0
        beyond = float(gathered) / float(gathered + 3)
        for particle in range(thread, points.shape[1], wp.block_dim()):
            new = displacements[world, particle] + increments[world, particle]
            onward = new + beyond * (new - reached[world, particle])
            reached[world, particle] = new
            displacements[world, particle] = onward
            trial_points[world, particle] = points[world, particle] + onward
        if thread == 0:
            squared = settling.tolerance * settling.tolerance
            rounded = sums[1] <= RESOLUTION * RESOLUTION * sums[3]
            settled = sums[1] <= squared * sums[2] or (rounded and iterations >= LEAST_OF_ROUNDED)
            ends = iterations >= settling.most or (settled and iterations >= settling.least)
            settling.iterations[world] = iterations
            settling.gathered[world] = gathered + 1
            settling.going[world] = wp.where(ends, 0, 1)
            if not ends:
                settling.any_going[0] = 1
            elif not rounded and sums[1] > settling.worth_saying * settling.worth_saying * sums[2]:
                change = wp.sqrt(sums[1] / wp.max(sums[2], 1.0e-30))
                before = unsettled[world]
                if before[0] == 0.0 or change > before[1]:
                    unsettled[world] = wp.vec2(float(frame[0] + 1), change)

    return apply_increments


@cache
def inertia_function(features: Features) -> Any:
    """Return the function for the effective mass of a particle in a step h, m + h c [kg], damping included.

    It is 0 for a fixed particle.
    """
    column = features.columns.places["damping"]

    @wp.func
    def inertia(params: Any, step_seconds: float):
        return params.mass + step_seconds * params.share * params.n[column]

    return inertia


@cache
def prediction_kernel(features: Features) -> Any:
    """Return the kernel that predicts displacements."""
    _, read_params = params_functions(features.columns, features.balloons)
    outer = tuple(law for law in features.of_kind("particle") if law is not DAMPING)
    particle_laws = sum_of_laws("particle", RESULT["particle"], outer, features.columns, features.air)
    inertia = inertia_function(features)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def predict_displacements(
        # model
        t: Tables,
        clock: Clock,
        substep: wp.int32,
        # state in
        state: WorldState,
        inflations: wp.array2d[wp.vec3],
        # out
        settling: Settling,
        free_displacements: wp.array2d[wp.vec3],
        displacements: wp.array2d[wp.vec3],
        reached: wp.array2d[wp.vec3],
        trial_points: wp.array2d[wp.vec3],
    ):
        """Predict the displacements w, where the iterations begin; a thread a (world, particle)."""
        world, particle = wp.tid()
        params = read_params(t, world, particle)
        point = state.points[world, particle]
        free = wp.vec3()
        if params.mass > 0.0:
            velocity = state.velocities[world, particle]
            time = time_of(t, state.frame, time_in_frame_of(clock, substep))
            force = inflations[world, particle] + particle_laws(
                point, velocity, params.mass, params.share, wp.vec3(), wp.vec4(), t.up, t.step_seconds, time, params.n
            )
            if wp.static(features.driven):
                force += outer_force(t.outer, world, particle)
            impulse = params.mass * velocity + t.step_seconds * force
            free = (t.step_seconds / inertia(params, t.step_seconds)) * impulse
        free_displacements[world, particle] = free
        displacements[world, particle] = free
        reached[world, particle] = free
        trial_points[world, particle] = point + free
        if particle == 0:
            settling.iterations[world] = 0
            settling.gathered[world] = 0
            settling.going[world] = 1
            settling.any_going[0] = 1

    return predict_displacements


@cache
def local_step_kernel(features: Features) -> Any:
    """Return the kernel of the local step."""
    _, read_params = params_functions(features.columns, features.balloons)
    pull_of_springs = spring_loop(features, vector_at)
    pull_of_strings = string_loop(features)
    inertia = inertia_function(features)

    @wp.kernel(module="unique", enable_backward=False, module_options={**OPTIONS, "fast_math": True})
    def find_residuals(
        # model
        t: Tables,
        # in
        free_displacements: wp.array2d[wp.vec3],
        displacements: wp.array2d[wp.vec3],
        trial_points: wp.array2d[wp.vec3],
        # out
        settling: Settling,
        residuals: wp.array2d[wp.vec3],
    ):
        """Compute the residuals, minus h^2 times the slope of g [kg m], in worlds that go on.

        A thread a (world, particle).
        """
        world, particle = wp.tid()
        if world == 0 and particle == 0:
            settling.any_going[0] = 0  # until one says so
        if settling.going[world] == 0:
            return
        params = read_params(t, world, particle)
        residual = wp.vec3()
        if params.share > 0.0:
            point = trial_points[world, particle]
            displacement = displacements[world, particle]
            # No law here looks at velocities or at the time.
            pull = pull_of_springs(
                t, trial_points[world], displacements[world], params, params.number, point, displacement, 0.0
            )
            if wp.static(features.has("string")):
                pull += pull_of_strings(t.strings, world, particle, point, displacement, params.n, t.step_seconds, 0.0)
            lag = free_displacements[world, particle] - displacement
            residual = inertia(params, t.step_seconds) * lag + t.step_seconds * t.step_seconds * pull
        residuals[world, particle] = residual

    return find_residuals


@wp.kernel(enable_backward=False)
def take_displacements(
    # model
    step_seconds: float,
    # in
    displacements: wp.array2d[wp.vec3],
    # state in and out
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
):
    """Apply the displacements, before contacts; a thread a (world, particle)."""
    world, particle = wp.tid()
    displacement = displacements[world, particle]
    points[world, particle] = points[world, particle] + displacement
    velocities[world, particle] = displacement / step_seconds

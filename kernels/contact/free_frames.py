"""Free frames: the particles of a world are far from everything that they may touch but ground and spheres.

Such a frame is simulated as if there were nothing else, or nothing but obstacles, where it is enough that balloons are
apart. The free distance of each particle is known at the frame's start; if one went further, the world is restored and
simulated once more with all contacts. So nothing is missed at any speed, and where nothing is near, it costs next to
nothing.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import FAR_AWAY
from balloon_warp.kernels.loops.fixtures import free_ball_function
from balloon_warp.kernels.loops.meeting import skin_functions
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import set_quanta, total_newtons

wp.set_module_options(OPTIONS)

FREE, BUSY, HURRIED = wp.constant(0), wp.constant(1), wp.constant(2)
"""Verdict on a world's frame: nothing can touch, something may, or a particle went farther than was free"""
LOWER, UPPER = wp.constant(0), wp.constant(1)
"""Rows of a box"""
CLEARANCE, SPEED = wp.constant(0), wp.constant(1)
"""Entries of a balloon: its distance to obstacles in this frame [m], and its highest speed [m/s]"""
FASTER = wp.constant(2.0)
"""Bound on a particle's speed in a frame, over its speed as the frame begins"""
FASTER_BETWEEN = wp.constant(1.2)
"""Bound between balloons: closer, since a busy frame costs more than one that is simulated again"""
ASTRAY = wp.constant(40.0)
"""Way beyond these bounds that a particle of a balloon that touches itself may go, over the thickness: two edges"""
GAINED = wp.constant(10.0)
"""Bound on a particle's acceleration in a frame [m/s^2]"""


Extent = wp.types.vector(length=7, dtype=wp.float32)
"""Extent of a balloon: upper corner of its box, negated lower corner [m], and its highest squared speed [m^2/s^2]"""


@wp.struct
class FreeFrames:
    """Bounds and verdicts of each world's frame."""

    boxes: wp.array3d[wp.vec3]
    """Box of each balloon as the frame begins: lower and upper corner [m]"""
    alone: wp.array3d[float]
    """Clearance and speed of each balloon, see `CLEARANCE`"""
    ways: wp.array[float]
    """Distance that each particle of a world may travel in the frame [m]"""
    verdicts: wp.array[wp.int32]
    """Verdict on each world, see `FREE`"""
    any_busy: wp.array[wp.int32]
    """Whether any world is not free"""


@wp.func
def copy_world(source: WorldState, target: WorldState, world: wp.int32, thread: wp.int32, threads: wp.int32):
    """Copy the part of a world's state that substeps change, by a number of threads."""
    for particle in range(thread, target.points.shape[1], threads):
        target.points[world, particle] = source.points[world, particle]
        target.velocities[world, particle] = source.velocities[world, particle]
    if source.gas_amounts.shape[1] > 0:
        for balloon in range(thread, target.gas_amounts.shape[1], threads):
            target.inflation_loads[world, balloon] = source.inflation_loads[world, balloon]
            target.pressures[world, balloon] = source.pressures[world, balloon]
            target.pressure_slopes[world, balloon] = source.pressure_slopes[world, balloon]
            target.gas_amounts[world, balloon] = source.gas_amounts[world, balloon]
            target.free_volumes[world, balloon] = source.free_volumes[world, balloon]
    for tube in range(thread, source.tube_flows.shape[1], threads):
        target.tube_flows[world, tube] = source.tube_flows[world, tube]
    for sphere in range(thread, source.sphere_positions.shape[1], threads):
        target.sphere_positions[world, sphere] = source.sphere_positions[world, sphere]
        target.sphere_velocities[world, sphere] = source.sphere_velocities[world, sphere]
        target.sphere_spins[world, sphere] = source.sphere_spins[world, sphere]
        target.sphere_forces[world, sphere] = source.sphere_forces[world, sphere]


@wp.func
def larger_extent(a: Extent, b: Extent):
    """Return the union of two extents."""
    return wp.max(a, b)


@cache
def surround_kernel(features: Features) -> Any:
    """Return the kernel that finds the distance of each balloon to obstacles."""
    keeps_off = features.fixtures and not features.touches_alone
    free_ball = free_ball_function(features) if keeps_off else None

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def surround_balloons(
        # model
        t: Tables,
        # state in
        state: WorldState,
        # out
        free: FreeFrames,
        before: WorldState,
    ):
        """Compute the extent of each balloon; a block a (world, balloon).

        The first block of a world copies the world's state.
        """
        world, balloon, thread = wp.tid()
        if balloon == 0:
            copy_world(state, before, world, thread, wp.block_dim())
        extent = Extent(-FAR_AWAY)
        for particle in range(t.particles.offsets[balloon] + thread, t.particles.offsets[balloon + 1], wp.block_dim()):
            p = state.points[world, particle]
            squared = wp.length_sq(state.velocities[world, particle])
            extent = wp.max(extent, Extent(p[0], p[1], p[2], -p[0], -p[1], -p[2], squared))
        whole = wp.tile_reduce(larger_extent, wp.tile(extent, preserve_type=True))[0]
        if thread == 0:
            lower = -wp.vec3(whole[3], whole[4], whole[5])
            upper = wp.vec3(whole[0], whole[1], whole[2])
            free.boxes[world, balloon, LOWER] = lower
            free.boxes[world, balloon, UPPER] = upper
            clearance = float(FAR_AWAY)
            if wp.static(keeps_off):
                clearance = free_ball(t, world, 0.0, 0.5 * (lower + upper), 0.5 * wp.length(upper - lower))
                clearance -= t.fixtures.fastest * t.frame_seconds
            free.alone[world, balloon, CLEARANCE] = clearance
            free.alone[world, balloon, SPEED] = wp.sqrt(whole[6])
            if world == 0 and balloon == 0:
                free.any_busy[0] = 0

    return surround_balloons


@cache
def judge_kernel(features: Features, looks_at_parts: bool) -> Any:
    """Return the kernel that decides which worlds have a free frame ahead.

    Args:
        looks_at_parts: whether parts of balloons that touch themselves are looked at after it; else they have none.
    """
    never_free = features.always_busy or (features.touches_itself and not looks_at_parts)
    thickness_between = skin_functions(features)[0] if features.touches else None

    @wp.func
    def halfway(t: Tables, free: FreeFrames, world: wp.int32, balloon: wp.int32, other: wp.int32):
        """Return the distance that particles of two balloons may travel before they could touch [m]."""
        lower = free.boxes[world, balloon, LOWER] - free.boxes[world, other, UPPER]
        upper = free.boxes[world, other, LOWER] - free.boxes[world, balloon, UPPER]
        between = wp.length(wp.max(wp.max(lower, upper), wp.vec3()))
        return 0.5 * (between - thickness_between(t, world, balloon, other))

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def judge_worlds(
        # model
        t: Tables,
        # in and out
        free: FreeFrames,
    ):
        """Judge which worlds have a free frame; a thread a world."""
        world = wp.tid()
        way = float(FAR_AWAY)
        between = float(FAR_AWAY)
        fastest = float(0.0)
        for balloon in range(free.alone.shape[1]):
            way = wp.min(way, free.alone[world, balloon, CLEARANCE])
            fastest = wp.max(fastest, free.alone[world, balloon, SPEED])
            if wp.static(features.touches):
                for other in range(balloon + 1, free.alone.shape[1]):
                    between = wp.min(between, halfway(t, free, world, balloon, other))
        if wp.static(never_free):
            way = float(0.0)
        went = fastest * t.frame_seconds
        gained = GAINED * t.frame_seconds * t.frame_seconds
        if wp.static(features.touches_itself):  # it is looked at as the frame begins and ends, not in between
            for balloon in range(free.alone.shape[1]):
                way = wp.min(way, FASTER * went + gained + ASTRAY * t.touch.thickness[balloon])
        free.ways[world] = wp.min(way, between)
        free.verdicts[world] = FREE
        if not (way > FASTER * went + gained and between > FASTER_BETWEEN * went + gained):  # or it is not finite
            free.verdicts[world] = BUSY
            free.any_busy[0] = 1

    return judge_worlds


@wp.kernel(enable_backward=False)
def put_worlds_back(
    # in
    free: FreeFrames,
    before: WorldState,
    threads: wp.int32,
    # state out
    state: WorldState,
    # out
    sphere_quanta: wp.array3d[wp.int64],
):
    """Restore worlds whose frame was not free to their earlier state; a thread a (world, thread)."""
    world, thread = wp.tid()
    if free.verdicts[world] != FREE:
        copy_world(before, state, world, thread, threads)
        for sphere in range(thread, sphere_quanta.shape[1], threads):
            set_quanta(sphere_quanta, world, sphere, before.sphere_forces[world, sphere])


@wp.kernel(enable_backward=False)
def keep_sphere_forces(
    # in
    free: FreeFrames,
    sphere_quanta: wp.array3d[wp.int64],
    # out
    sphere_forces: wp.array2d[wp.vec3],
):
    """Convert sphere forces of worlds whose frame was not free to newtons; a thread a (world, sphere)."""
    world, sphere = wp.tid()
    if free.verdicts[world] != FREE:
        sphere_forces[world, sphere] = total_newtons(sphere_quanta, world, sphere)


@cache
def busy_kernel(dtype: Any) -> Any:
    """Return the kernel that copies values of a type in worlds whose frame was not free."""

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def copy_busy(
        # in
        verdicts: wp.array[wp.int32],
        source: wp.array2d(dtype=dtype),
        # out
        target: wp.array2d(dtype=dtype),
    ):
        """Copy; a thread a (world, item)."""
        world, item = wp.tid()
        if verdicts[world] != FREE:
            target[world, item] = source[world, item]

    return copy_busy

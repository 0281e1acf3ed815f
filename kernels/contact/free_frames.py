"""Free frames: the balloons of a world are far from all that they may touch, and from themselves.

Where they are, but for ground and spheres, a frame is simulated as if there were nothing else, or nothing but
obstacles, where it is enough that balloons are apart. The free distance of each particle is known at the frame's start;
if one went further, the world is restored and simulated once more with all contacts. So nothing is missed at any speed,
and where nothing is near, it costs next to nothing.

Compact parts of self-touching balloons: bounds on their distances, by their poses and deformations.
Two parts cannot touch where the boxes around them are apart. Parts beside each other on the surface always meet by
their boxes. They cannot touch while the surface around them keeps its shape: where the placement of one part, turned
and scaled as a whole, also places the other, but for a little, places apart at the start still are.

Both bound the room that there is: how far particles may move relative to each other until any can touch. Parts are
looked at again once they have. So balloons that fly, rest or tremble are hardly ever looked at. The state keeps the
room and where it was found, so that a run that is resumed takes the same frames for free.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import FAR_AWAY
from balloon_warp.kernels.loops.contact import skin_functions
from balloon_warp.kernels.loops.fixtures import free_ball_function
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import block_barrier, set_quanta, total_newtons

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
    travel_limits: wp.array[float]
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
        free.travel_limits[world] = wp.min(way, between)
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


SMALL = wp.constant(1.0e-20)
"""Length of an axis that is none"""
MOST_ROOM = wp.constant(30.0)
"""Room beyond which it need not be known, over the skin's thickness: one and a half edges"""
Ways = wp.types.vector(length=6, dtype=wp.float32)
"""Largest and negated least components of particles' ways [m]"""


@wp.func
def larger_components(a: Ways, b: Ways):
    """Return the larger of each component."""
    return wp.max(a, b)


@wp.struct
class OwnParts:
    """Compact parts of balloons' surfaces at the start, and where they are in each world.

    A part's axes are those along which it extends most. A group is some parts after each other.
    """

    particles: wp.array[wp.int32]
    """Particles of the triangles of each part"""
    first: wp.array[wp.int32]
    """First entry of each part among these, and their number"""
    offsets: wp.array[wp.vec3]
    """Place of each particle from its part's center at the start [m]"""
    weights: wp.array[wp.vec2]
    """Weight of each particle in the images of its part's two longest axes [1/m]"""
    axes: wp.array[wp.mat33]
    """Axes of each part, a column each"""
    centers: wp.array[wp.vec3]
    """Center of each part at the start, the mean of its particles [m]"""
    sizes: wp.array[wp.vec2]
    """Radius of each part around its center at the start, and its least gap to features that it may touch [m]"""
    balloons: wp.array[wp.int32]
    """Balloon of each part"""
    groups: wp.array[wp.int32]
    """First part of each group, and the number of parts; a group is of one balloon"""
    needs_check: wp.array2d[wp.int32]
    """Whether a balloon's parts are to be looked at"""
    drifts: wp.array2d[wp.vec3]
    """Motion of a balloon as a whole in a frame [m]"""
    means: wp.array2d[wp.vec3]
    """Mean of each part's particles [m]"""
    maps: wp.array2d[wp.mat33]
    """Rotation and scale of each part since the start"""
    misfits: wp.array2d[float]
    """Largest distance of a particle from where these place it [m]"""
    boxes: wp.array3d[wp.vec3]
    """Box of each part [m]; after a frame also around where it was before, but for the drift"""
    group_boxes: wp.array3d[wp.vec3]
    """Box of each group, which has those of its parts [m]"""


@wp.kernel(enable_backward=False)
def find_strayed_balloons(
    # model
    t: Tables,
    # in
    verdicts: wp.array[wp.int32],
    state: WorldState,
    before: WorldState,
    # state in and out
    seen_points: wp.array2d[wp.vec3],
    rooms: wp.array2d[float],
    # out
    own: OwnParts,
):
    """Find the balloons whose particles may have exceeded their margin; a block a (world, balloon).

    Args:
        before: Where the frame began, or the state itself where it begins.
    """
    world, balloon, thread = wp.tid()
    begin = t.particles.offsets[balloon]
    end = t.particles.offsets[balloon + 1]
    ways = Ways(-FAR_AWAY)
    drift = wp.vec3()
    for particle in range(begin + thread, end, wp.block_dim()):
        point = state.points[world, particle]
        way = point - seen_points[world, particle]
        ways = wp.max(ways, Ways(way[0], way[1], way[2], -way[0], -way[1], -way[2]))
        drift += point - before.points[world, particle]
    most = wp.tile_reduce(larger_components, wp.tile(ways, preserve_type=True))[0]
    drifts = wp.tile_sum(wp.tile(drift, preserve_type=True))[0]
    strays = wp.length(wp.vec3(most[0] + most[3], most[1] + most[4], most[2] + most[5]))
    needs_check = verdicts[world] == FREE and not strays < rooms[world, balloon]  # or it is no number
    block_barrier()  # all have read the room
    if thread == 0:
        own.needs_check[world, balloon] = wp.where(needs_check, 1, 0)
        own.drifts[world, balloon] = drifts / float(wp.max(end - begin, 1))
        if needs_check:
            rooms[world, balloon] = MOST_ROOM * t.touch.thickness[balloon]
    if needs_check:
        for particle in range(begin + thread, end, wp.block_dim()):
            seen_points[world, particle] = state.points[world, particle]


@wp.func
def place_part(own: OwnParts, world: wp.int32, part: wp.int32, points: wp.array2d[wp.vec3],
               before: wp.array2d[wp.vec3], drift: wp.vec3):  # fmt: skip
    """Find where a part is: its mean, rotation, scale, misfit and box."""
    begin = own.first[part]
    end = own.first[part + 1]
    lower = wp.vec3(FAR_AWAY)
    upper = wp.vec3(-FAR_AWAY)
    mean = wp.vec3()
    first = wp.vec3()
    second = wp.vec3()
    for place in range(begin, end):
        particle = own.particles[place]
        point = points[world, particle]
        start = before[world, particle] + drift
        lower = wp.min(lower, wp.min(point, start))
        upper = wp.max(upper, wp.max(point, start))
        mean += point
        weight = own.weights[place]
        first += weight[0] * point
        second += weight[1] * point
    mean /= float(end - begin)
    # weights sum up to zero, so that these are images of two axes
    length = wp.length(first)
    first = first / wp.max(length, SMALL)
    second = second - wp.dot(second, first) * first
    width = wp.length(second)
    second = second / wp.max(width, SMALL)
    turn = wp.matrix_from_cols(first, second, wp.cross(first, second)) * wp.transpose(own.axes[part])
    turn = 0.5 * (length + width) * turn
    squared = float(0.0)
    for place in range(begin, end):
        strays = points[world, own.particles[place]] - mean - turn * own.offsets[place]
        squared = wp.max(squared, wp.length_sq(strays))
    own.means[world, part] = mean
    own.maps[world, part] = turn
    own.misfits[world, part] = wp.where(width > SMALL, wp.sqrt(squared), FAR_AWAY)
    own.boxes[world, part, LOWER] = lower
    own.boxes[world, part, UPPER] = upper


@wp.kernel(enable_backward=False)
def place_parts(
    # in
    state: WorldState,
    before: WorldState,
    # out
    own: OwnParts,
):
    """Find where all parts are; a thread a part."""
    world, part = wp.tid()
    balloon = own.balloons[part]
    if own.needs_check[world, balloon] == 1:
        place_part(own, world, part, state.points, before.points, own.drifts[world, balloon])


@wp.kernel(enable_backward=False)
def box_groups(own: OwnParts):
    """Find the boxes of groups; a thread a group."""
    world, group = wp.tid()
    if own.needs_check[world, own.balloons[own.groups[group]]] == 1:
        lower = wp.vec3(FAR_AWAY)
        upper = wp.vec3(-FAR_AWAY)
        for part in range(own.groups[group], own.groups[group + 1]):
            lower = wp.min(lower, own.boxes[world, part, LOWER])
            upper = wp.max(upper, own.boxes[world, part, UPPER])
        own.group_boxes[world, group, LOWER] = lower
        own.group_boxes[world, group, UPPER] = upper


@wp.func
def gap_between(boxes: wp.array3d[wp.vec3], world: wp.int32, first: wp.int32, second: wp.int32):
    """Return the largest distance of two boxes along an axis [m]; negative where they overlap."""
    below = boxes[world, first, LOWER] - boxes[world, second, UPPER]
    above = boxes[world, second, LOWER] - boxes[world, first, UPPER]
    return wp.max(wp.max(below, above))


@wp.func
def min_distance_between(own: OwnParts, world: wp.int32, one: wp.int32, other: wp.int32):
    """Return a bound on how near a particle or edge of a part is to one of another that it may touch [m]."""
    first = wp.where(own.sizes[one][0] < own.sizes[other][0], other, one)
    second = one + other - first
    way = own.centers[second] - own.centers[first]
    between = wp.length(way) - own.sizes[first][0] - own.sizes[second][0]
    least = wp.max(between, wp.max(own.sizes[first][1], own.sizes[second][1]))
    turn = own.maps[world, first]
    scale = wp.length(turn * wp.vec3(1.0, 0.0, 0.0))
    strays = own.misfits[world, first] + own.misfits[world, second]
    if first != second:
        # by how much the first's placement misplaces the second's center, and its particles around that
        strays += wp.length(own.means[world, second] - own.means[world, first] - turn * way)
        change = own.maps[world, second] - turn
        strays += wp.sqrt(wp.ddot(change, change)) * own.sizes[second][0]
    return scale * least - strays


@wp.func
def room_of_group(own: OwnParts, world: wp.int32, group: wp.int32, pad: float, most: float):
    """Return the room of a group's parts to each other, and to those of groups after it [m].

    Args:
        pad: Distance at which there is none [m].
        most: Largest that need be known [m].
    """
    room = float(most)
    balloon = own.balloons[own.groups[group]]
    other = wp.int32(group)
    while other < own.groups.shape[0] - 1 and room > 0.0:
        same = own.balloons[own.groups[other]] == balloon
        if same and gap_between(own.group_boxes, world, group, other) - pad < room:
            for first in range(own.groups[group], own.groups[group + 1]):
                for second in range(wp.max(first, own.groups[other]), own.groups[other + 1]):
                    gap = gap_between(own.boxes, world, first, second)
                    if gap - pad < room:
                        room = wp.min(room, wp.max(gap, min_distance_between(own, world, first, second)) - pad)
        other += 1
    return room


@cache
def judge_parts_kernel(features: Features) -> Any:
    """Return the kernel that finds the room between parts, and whether there is any."""
    thickness_between = skin_functions(features)[0]

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def judge_parts(
        # model
        t: Tables,
        # in
        own: OwnParts,
        is_over: wp.int32,
        # state in and out
        rooms: wp.array2d[float],
        # in and out
        free: FreeFrames,
    ):
        """Judge whether parts may touch in a frame; a thread a group.

        Args:
            is_over: Whether the frame is over, and was taken to be free.
        """
        world, group = wp.tid()
        balloon = own.balloons[own.groups[group]]
        if own.needs_check[world, balloon] == 1:
            pad = thickness_between(t, world, balloon, balloon) + 2.0 * t.touch.slack[balloon]
            room = room_of_group(own, world, group, pad, MOST_ROOM * t.touch.thickness[balloon])
            wp.atomic_min(rooms, world, balloon, room)
            if not room > 0.0:  # or it is no number
                wp.atomic_min(rooms, world, balloon, 0.0)
                free.verdicts[world] = wp.where(is_over == 1, HURRIED, BUSY)
                free.any_busy[0] = 1

    return judge_parts

"""How membranes tear, as kernels: what each face bears, where tears begin and run on, and how the gas leaves.

Before each substep's forces, once the stresses of triangles are known. A face that looks for where its tear goes on
marks another, and those that are marked tear in a launch of their own: no order of threads matters.
"""

import warp as wp

from balloon_warp.kernels.laws.air import air_of_height
from balloon_warp.kernels.laws.inflation import GAS, NORMAL_FORCE
from balloon_warp.kernels.laws.tearing import SPENT, pressure_beside_hole, softness_of_gas
from balloon_warp.kernels.loops.areas import face_measures
from balloon_warp.kernels.loops.wear import of_balloon
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.substep import ramp_at, time_of, volume_origin
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world

wp.set_module_options(OPTIONS)

LAST_FACE = wp.constant(wp.int64(2**31 - 1))
SQUARE_MICROMETERS = wp.constant(wp.float64(1.0e12))
"""of a square meter"""
GasColumns = wp.types.vector(length=7, dtype=wp.int32)
center_of_face, area_vector_of_face = face_measures(vector_at)


@wp.func
def packed(stress: float, face: wp.int32):
    """Stress and face as one number: the greatest is that of the greatest stress, or of the first face that has it."""
    bits = wp.int64(wp.cast(wp.max(stress, 0.0), wp.uint32))
    return (bits << wp.int64(32)) + LAST_FACE - wp.int64(face)


@wp.func
def unpacked(number: wp.int64):
    """The stress [Pa]."""
    return wp.cast(wp.uint32(number >> wp.int64(32)), wp.float32)


@wp.func
def is_gone(torn: wp.array2d[float], world: wp.int32, face: wp.int32):
    return torn[world, face] >= 0.0


@wp.kernel(enable_backward=False)
def weigh_faces(
    # model
    t: Tables,
    time_in_frame: float,
    # state in
    frame: wp.array[wp.int32],
    torn: wp.array2d[float],
    bursts: wp.array2d[wp.vec4],
):
    """A thread a (world, face): those that are torn pull no more; of the others the stress, and whether the balloon is
    to burst there."""
    world, face = wp.tid()
    tears = t.membranes.wear.tears
    begin = tears.triangle_offsets[face]
    end = tears.triangle_offsets[face + 1]
    gone = is_gone(torn, world, face)
    tears.gone[world, face] = wp.where(gone, wp.int8(1), wp.int8(0))
    tears.marks[world, face] = wp.int8(0)
    stress = float(0.0)
    for entry in range(begin, end):
        triangle = tears.triangles[entry]
        stress += tears.stresses[world, triangle]
        if gone:
            t.membranes.wear.left[world, triangle] = 0.0
    stress /= wp.max(float(end - begin), 1.0)
    tears.face_stresses[world, face] = stress
    balloon = t.faces.balloon[face]
    if end > begin and not gone and bursts[world, balloon][0] < 0.0:
        pierced = time_of(t, frame, time_in_frame) >= of_balloon(tears.needle_time, world, balloon)
        if pierced or stress >= of_balloon(tears.film_strength, world, balloon):
            wp.atomic_max(tears.weakest, world, balloon, packed(stress, face))


@wp.func
def torn_beside(t: Tables, torn: wp.array2d[float], world: wp.int32, face: wp.int32):
    """How many of a face's neighbors are torn."""
    tears = t.membranes.wear.tears
    count = wp.int32(0)
    for entry in range(tears.neighbor_offsets[face], tears.neighbor_offsets[face + 1]):
        if is_gone(torn, world, tears.neighbors[entry]):
            count += 1
    return count


@wp.func
def mark_next(t: Tables, torn: wp.array2d[float], world: wp.int32, face: wp.int32, reach: float, branches: wp.bool):
    """Mark where the tear of a face runs on: the neighbor that bears most, if that is more than it can; and another,
    where it begins, or branches off into what is whole. Whether it has gone on."""
    tears = t.membranes.wear.tears
    needed = of_balloon(tears.tear_strength, world, t.faces.balloon[face])
    first = wp.int32(0)  # 1 more than the face
    second = wp.int32(0)
    most = float(0.0)
    more = float(0.0)
    begins = bool(True)
    near = bool(False)
    for entry in range(tears.neighbor_offsets[face], tears.neighbor_offsets[face + 1]):
        other = tears.neighbors[entry]
        stress = tears.face_stresses[world, other]
        if is_gone(torn, world, other):
            begins = False
        elif stress > needed and stress > most:
            second = first + 0
            more = most + 0.0
            first = other + 1
            most = stress + 0.0
            near = reach >= tears.distances[entry]
        elif stress > needed and stress > more:
            second = other + 1
            more = stress + 0.0
    if first == 0 or not near:
        return False
    tears.marks[world, first - 1] = wp.int8(1)
    if second > 0:
        if begins or (branches and torn_beside(t, torn, world, second - 1) == 1):
            tears.marks[world, second - 1] = wp.int8(1)
    return True


@wp.kernel(enable_backward=False)
def run_tears(
    # model
    t: Tables,
    # state in and out
    bursts: wp.array2d[wp.vec4],
    torn: wp.array2d[float],
):
    """A thread a (world, face): where a tear begins, and where it runs on."""
    world, face = wp.tid()
    tears = t.membranes.wear.tears
    balloon = t.faces.balloon[face]
    burst = bursts[world, balloon]
    if burst[0] < 0.0:
        weakest = tears.weakest[world, balloon]
        if weakest > wp.int64(0) and weakest == packed(tears.face_stresses[world, face], face):
            tears.marks[world, face] = wp.int8(1)
    reach = torn[world, face]
    if reach >= 0.0 and reach < SPENT:
        reach += of_balloon(tears.tear_speed, world, balloon) * t.step_seconds
        branches = tears.branching[face] == wp.int8(1) and burst[3] > of_balloon(tears.branching_stress, world, balloon)
        if mark_next(t, torn, world, face, reach, branches):
            reach = 2.0 * SPENT
        torn[world, face] = wp.min(reach, 2.0 * SPENT)


@wp.kernel(enable_backward=False)
def tear_faces(
    # model
    t: Tables,
    # state in and out
    points: wp.array2d[wp.vec3],
    torn: wp.array2d[float],
    hole_areas: wp.array2d[wp.int64],
):
    """A thread a (world, face): those that are marked tear, and the hole is larger by them."""
    world, face = wp.tid()
    tears = t.membranes.wear.tears
    if tears.marks[world, face] == wp.int8(1) and not is_gone(torn, world, face):
        torn[world, face] = 0.0
        tears.gone[world, face] = wp.int8(1)
        for entry in range(tears.triangle_offsets[face], tears.triangle_offsets[face + 1]):
            t.membranes.wear.left[world, tears.triangles[entry]] = 0.0
        own = points[world]
        area = wp.length(area_vector_of_face(t.faces, own, face, center_of_face(t.faces, own, face)))
        wp.atomic_add(hole_areas, world, t.faces.balloon[face], wp.int64(wp.float64(area) * SQUARE_MICROMETERS))


@wp.func
def enclosed(t: Tables, points: wp.array[wp.vec3], balloon: wp.int32):
    """By a balloon's faces [m^3]."""
    volume = float(0.0)
    first = t.faces.balloon_offsets[balloon]
    origin = center_of_face(t.faces, points, first)
    for face in range(first, t.faces.balloon_offsets[balloon + 1]):
        center = center_of_face(t.faces, points, face)
        volume += wp.dot(center - origin, area_vector_of_face(t.faces, points, face, center)) / 3.0
    return volume


@wp.func
def softness_in(
    t: Tables,
    state: WorldState,
    world: wp.int32,
    balloon: wp.int32,
    columns: GasColumns,
    volume: float,
    height: float,
    pressure: float,
):
    """Of what is in a balloon of a volume [m^3] at a height [m], at a pressure above the air's there [Pa]: a gas, or
    air."""
    of_world = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]
    of_balloon = t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon]
    air = air_of_height(
        height, of_world[columns[0]], of_world[columns[1]], of_world[columns[2]], of_world[columns[3]],
        of_world[columns[4]],
    )  # fmt: skip
    density = air[2]
    gamma = float(1.0)
    if t.inflation_kind[balloon] == GAS:
        density = float(state.gas_amounts[world, balloon]) * of_balloon[columns[5]] / wp.max(volume, 1.0e-12)
        gamma = of_balloon[columns[6]]
    return softness_of_gas(volume, air[0] + pressure, density, gamma)


@wp.kernel(enable_backward=False)
def let_gas_out(
    # model
    t: Tables,
    time_in_frame: float,
    columns: GasColumns,
    # state in and out
    state: WorldState,
    points: wp.array2d[wp.vec3],
    hole_areas: wp.array2d[wp.int64],
):
    """A thread a (world, balloon): it bursts, and its pressure falls.

    Args:
        columns: of the world's numbers: pressure, temperature, density and lapse of the air, and gravity; of the
            balloon's: molar mass and gamma of its gas.
    """
    world, balloon = wp.tid()
    tears = t.membranes.wear.tears
    burst = state.bursts[world, balloon]
    weakest = tears.weakest[world, balloon]
    tears.weakest[world, balloon] = wp.int64(0)
    if burst[0] < 0.0 and weakest > wp.int64(0):
        pressure = state.pressures[world, balloon]
        if t.inflation_kind[balloon] != GAS:
            pressure = ramp_at(state, world, balloon, time_in_frame)
        height = wp.dot(points[world, volume_origin(t, balloon)], t.up)
        volume = enclosed(t, points[world], balloon)
        softness = softness_in(t, state, world, balloon, columns, volume, height, pressure)
        began = time_of(t, state.frame, time_in_frame)
        burst = wp.vec4(began, wp.max(pressure, 0.0), softness, unpacked(weakest))
    if burst[0] >= 0.0:
        hole = float(wp.float64(hole_areas[world, balloon]) / SQUARE_MICROMETERS)
        burst[1] = pressure_beside_hole(burst[1], burst[2], hole, t.step_seconds)
        state.bursts[world, balloon] = burst


@wp.kernel(enable_backward=False)
def note_bursts(
    # model
    inflation_kind: wp.array[wp.int32],
    # state in and out
    state: WorldState,
):
    """A thread a (world, balloon), as a frame ends: pressures of balloons that burst, and at last no gas."""
    world, balloon = wp.tid()
    burst = state.bursts[world, balloon]
    if burst[0] >= 0.0 and inflation_kind[balloon] != NORMAL_FORCE:
        pressure = burst[1]
        state.pressures[world, balloon] = pressure
        state.inflation_loads[world, balloon] = wp.vec2(pressure, 0.0)
        if pressure == 0.0:
            state.gas_amounts[world, balloon] = wp.float64(0.0)
            state.free_volumes[world, balloon] = wp.float64(0.0)

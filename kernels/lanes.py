"""The `lanes` schedule: a thread advances eight worlds side by side by a whole frame. For the CPU."""

import warp as wp

from balloon_warp.kernels.air import has_pressure
from balloon_warp.kernels.gas import GAS, VOLUME
from balloon_warp.kernels.inflation import NORMAL_FORCE
from balloon_warp.kernels.lanes_air import drag_lanes, inflation_lanes, measure_balloon_lanes, read_air_lanes
from balloon_warp.kernels.lanes_contact import leave_obstacle_lanes, move_sphere_lanes
from balloon_warp.kernels.lanes_correction import correct_lanes
from balloon_warp.kernels.lanes_gas import (
    add_particle_to_swelling,
    begin_swelling_lanes,
    find_load_lanes,
    move_gas_lanes,
)
from balloon_warp.kernels.lanes_inflation import aim_all_lanes
from balloon_warp.kernels.lanes_state import (
    DAMPING,
    GRAVITY,
    HELIUM,
    INERTIA,
    MASS,
    SWELLING,
    VISCOSITY,
    YIELD_STRETCH,
    LaneState,
    LaneTraits,
    read_lanes,
    world_of,
    write_lanes,
)
from balloon_warp.kernels.lanes_torsion import pull_of_hinge_lanes
from balloon_warp.kernels.lanes_types import (
    LANE_COUNT,
    Lanes,
    Lanes3,
    column,
    lanes_scaled,
    set_column,
    squared_lengths,
)
from balloon_warp.kernels.lanes_water import set_water_force_lanes
from balloon_warp.kernels.motion import lift, response
from balloon_warp.kernels.pull import pull_of_strings
from balloon_warp.kernels.springs import rubber_coefficient, spring_coefficient
from balloon_warp.kernels.tables import (
    SLICE,
    AirTable,
    BodyTable,
    CorrectionTable,
    FaceTable,
    ObstacleTable,
    SpringTable,
    StringTable,
    WaterTable,
    WorldState,
    first_entry,
)


@wp.func
def spring_force_lanes(d: Lanes3, constants: Lanes, scale: float, rest_length: float):
    """Force of a spring to the particle at distance d in each world [N]."""
    squared = squared_lengths(d)
    coefficients = Lanes()
    for lane in range(LANE_COUNT):
        coefficients[lane] = constants[lane] * spring_coefficient(squared[lane], scale, rest_length)
    return lanes_scaled(d, coefficients)


@wp.func
def pull_of_spring_lanes(
    springs: SpringTable, numbers: wp.array[Lanes], points: wp.array[Lanes3], point: Lanes3, particle: wp.int32
):
    """Net force of a particle's springs in each world [N]."""
    force = Lanes3()
    begin = first_entry(springs, particle)
    for slot in range(springs.valences[particle]):
        entry = begin + SLICE * slot
        end = springs.ends[entry]
        scale = float(1.0)
        if springs.scales.shape[0] > 0:
            scale = springs.scales[entry]
        d = points[end >> 2] - point
        force += spring_force_lanes(d, numbers[end & 3], scale, springs.rest_lengths[entry])
    if springs.hinges.ends.shape[0] > 0:
        force += pull_of_hinge_lanes(springs.hinges, numbers, points, particle)
    return force


@wp.func
def rubber_force_lanes(
    d: Lanes3, relative: Lanes3, constants: Lanes, viscosity: Lanes, yield_stretch: Lanes, scale: float, rest: float
):
    """Force of a spring that is viscous or can be overextended, to the particle at distance d that moves at `relative`,
    in each world [N]."""
    squared = squared_lengths(d)
    coefficients = Lanes()
    for lane in range(LANE_COUNT):
        opening = wp.dot(column(relative, lane), column(d, lane))
        coefficients[lane] = constants[lane] * rubber_coefficient(
            squared[lane], opening, scale, rest, viscosity[lane], yield_stretch[lane]
        )
    return lanes_scaled(d, coefficients)


@wp.func
def pull_of_rubber_lanes(
    springs: SpringTable,
    numbers: wp.array[Lanes],
    points: wp.array[Lanes3],
    velocities: wp.array[Lanes3],
    particle: wp.int32,
):
    """Net force of a particle's springs in each world [N], which are viscous or can be overextended."""
    force = Lanes3()
    begin = first_entry(springs, particle)
    for slot in range(springs.valences[particle]):
        entry = begin + SLICE * slot
        end = springs.ends[entry]
        scale = float(1.0)
        if springs.scales.shape[0] > 0:
            scale = springs.scales[entry]
        d = points[end >> 2] - points[particle]
        relative = velocities[end >> 2] - velocities[particle]
        force += rubber_force_lanes(
            d,
            relative,
            numbers[end & 3],
            numbers[VISCOSITY],
            numbers[YIELD_STRETCH],
            scale,
            springs.rest_lengths[entry],
        )
    if springs.hinges.ends.shape[0] > 0:
        force += pull_of_hinge_lanes(springs.hinges, numbers, points, particle)
    return force


@wp.func
def body_force_lanes(numbers: wp.array[Lanes], share: float, up: wp.vec3, velocity: Lanes3):
    """Gravity, helium and damping in each world [N]."""
    masses = numbers[MASS]
    gravity = numbers[GRAVITY]
    helium = numbers[HELIUM]
    damping = numbers[DAMPING]
    force = Lanes3()
    for lane in range(LANE_COUNT):
        upward = lift(share * masses[lane], gravity[lane], helium[lane])
        drag = share * damping[lane]
        for axis in range(3):
            force[axis, lane] = upward * up[axis] - drag * velocity[axis, lane]
    return force


@wp.func
def response_lanes(masses: Lanes, share: float, step_seconds: float):
    """Velocity gained in a step for each newton, in each world [m/s/N]."""
    responses = Lanes()
    for lane in range(LANE_COUNT):
        responses[lane] = response(share * masses[lane], step_seconds)
    return responses


@wp.func
def move_particle_lanes(
    traits: LaneTraits,
    bodies: BodyTable,
    springs: SpringTable,
    lanes: LaneState,
    group: wp.int32,
    time_in_frame: float,
    step_seconds: float,
    points: wp.array[Lanes3],
    # out
    new_points: wp.array[Lanes3],
):
    """Every particle by one substep, as if there were neither strings nor obstacles."""
    if traits.rubber:
        for particle in range(points.shape[0]):
            lanes.old_velocities[group, particle] = lanes.velocities[group, particle]
    for particle in range(points.shape[0]):
        numbers = lanes.balloons[group, bodies.balloon[particle]]
        share = bodies.mass_share[particle]
        point = points[particle]
        velocity = lanes.velocities[group, particle]
        if traits.rubber:
            force = pull_of_rubber_lanes(springs, numbers, points, lanes.old_velocities[group], particle)
        else:
            force = pull_of_spring_lanes(springs, numbers, points, point, particle)
        force += inflation_lanes(NORMAL_FORCE, numbers, time_in_frame, bodies.up, point, lanes.aims[group, particle])
        force += body_force_lanes(numbers, share, bodies.up, velocity)
        if lanes.water_forces.shape[1] > 0:
            force += lanes.water_forces[group, particle]
        new_velocity = velocity + lanes_scaled(force, response_lanes(numbers[MASS], share, step_seconds))
        lanes.velocities[group, particle] = new_velocity
        if traits.forward_euler:
            new_points[particle] = point + step_seconds * velocity
        else:
            new_points[particle] = point + step_seconds * new_velocity


@wp.func
def pull_of_string_lanes(strings: StringTable, state: WorldState, group: wp.int32, point: Lanes3, particle: wp.int32):
    """Net force of the strings that hold a particle in each world [N]."""
    force = Lanes3()
    for lane in range(LANE_COUNT):
        pull = pull_of_strings(strings, column(point, lane), world_of(state, group, lane), particle)
        force = set_column(force, lane, pull)
    return force


@wp.func
def move_particle_in_air_lanes(
    traits: LaneTraits,
    bodies: BodyTable,
    springs: SpringTable,
    strings: StringTable,
    obstacles: ObstacleTable,
    faces: FaceTable,
    air: AirTable,
    state: WorldState,
    lanes: LaneState,
    group: wp.int32,
    time_in_frame: float,
    step_seconds: float,
    points: wp.array[Lanes3],
    # out
    new_points: wp.array[Lanes3],
):
    """Every particle by one substep, as if there were no obstacles."""
    move_gas_lanes(air, state, lanes, group, time_in_frame, step_seconds)
    if traits.rubber or traits.forward_euler:
        for particle in range(points.shape[0]):
            lanes.old_velocities[group, particle] = lanes.velocities[group, particle]
    for balloon in range(air.kind.shape[0]):
        numbers = lanes.balloons[group, balloon]
        first = air.balloon_particles[balloon]
        last = air.balloon_particles[balloon + 1]
        area_vectors = lanes.area_vectors[group]
        if has_pressure(air, balloon):
            area_vectors = lanes.aims[group]
        begin_swelling_lanes(state, numbers, group, balloon)
        numbers[SWELLING + VOLUME] = measure_balloon_lanes(faces, points, balloon, first, last, area_vectors)
        for particle in range(first, last):
            share = bodies.mass_share[particle]
            point = points[particle]
            velocity = lanes.velocities[group, particle]
            area_vector = area_vectors[particle]
            if traits.rubber:
                force = pull_of_rubber_lanes(springs, numbers, points, lanes.old_velocities[group], particle)
            else:
                force = pull_of_spring_lanes(springs, numbers, points, point, particle)
            force += body_force_lanes(numbers, share, bodies.up, velocity)
            force += drag_lanes(numbers, area_vector, velocity)
            if lanes.water_forces.shape[1] > 0:
                force += lanes.water_forces[group, particle]
            if strings.offsets.shape[0] > 0:
                force += pull_of_string_lanes(strings, state, group, point, particle)
            velocity += lanes_scaled(force, response_lanes(numbers[INERTIA], share, step_seconds))
            lanes.velocities[group, particle] = velocity
            if air.kind[balloon] == GAS:
                add_particle_to_swelling(
                    bodies, obstacles, state, lanes, numbers, group, balloon, share, point, area_vector, velocity,
                    step_seconds,
                )  # fmt: skip
        if has_pressure(air, balloon):
            find_load_lanes(air, bodies, state, numbers, group, balloon, time_in_frame, step_seconds)
        for particle in range(first, last):
            point = points[particle]
            aim = lanes.aims[group, particle]
            force = inflation_lanes(air.kind[balloon], numbers, time_in_frame, bodies.up, point, aim)
            responses = response_lanes(numbers[INERTIA], bodies.mass_share[particle], step_seconds)
            velocity = lanes.velocities[group, particle] + lanes_scaled(force, responses)
            lanes.velocities[group, particle] = velocity
            if traits.forward_euler:
                velocity = lanes.old_velocities[group, particle]
            new_points[particle] = point + step_seconds * velocity


@wp.func
def add_string_lanes(
    traits: LaneTraits,
    bodies: BodyTable,
    strings: StringTable,
    state: WorldState,
    lanes: LaneState,
    group: wp.int32,
    step_seconds: float,
    points: wp.array[Lanes3],
    # in and out
    new_points: wp.array[Lanes3],
):
    """What strings at `points` add to a substep that was made without them, which is linear in the forces."""
    for held in range(strings.particles.shape[0]):
        particle = strings.particles[held]
        if held == 0 or particle != strings.particles[held - 1]:
            masses = lanes.balloons[group, bodies.balloon[particle], MASS]
            for lane in range(LANE_COUNT):
                world = world_of(state, group, lane)
                force = pull_of_strings(strings, column(points[particle], lane), world, particle)
                gain = response(bodies.mass_share[particle] * masses[lane], step_seconds) * force
                velocity = column(lanes.velocities[group, particle], lane) + gain
                lanes.velocities[group, particle] = set_column(lanes.velocities[group, particle], lane, velocity)
                if not traits.forward_euler:
                    point = column(new_points[particle], lane) + step_seconds * gain
                    new_points[particle] = set_column(new_points[particle], lane, point)


@wp.kernel(enable_backward=False)
def advance_groups(
    # model
    bodies: BodyTable,
    springs: SpringTable,
    strings: StringTable,
    obstacles: ObstacleTable,
    faces: FaceTable,
    water: WaterTable,
    air: AirTable,
    correction: CorrectionTable,
    traits: LaneTraits,
    substeps: wp.int32,
    step_seconds: float,
    first_group: wp.int32,
    # state in and out
    state: WorldState,
    lanes: LaneState,
):
    """A thread a group of eight worlds: one frame."""
    group = first_group + wp.tid()
    read_lanes(bodies, springs, obstacles, state, lanes, group)
    if traits.in_air:
        read_air_lanes(air, state, lanes, group)
    points = lanes.points[group]
    new_points = lanes.other_points[group]
    for substep in range(substeps):
        if substep % 2 == 1:
            points = lanes.other_points[group]
            new_points = lanes.points[group]
        else:
            points = lanes.points[group]
            new_points = lanes.other_points[group]
        time_in_frame = float(substep) * step_seconds
        if substep == 0 or traits.fresh_normals:
            aim_all_lanes(faces, bodies, lanes, group, points)
        move_sphere_lanes(bodies, obstacles, state, lanes, group, step_seconds)
        if lanes.water_forces.shape[1] > 0:
            set_water_force_lanes(water, faces, bodies, state, lanes, points, group, step_seconds)
        if traits.in_air:
            move_particle_in_air_lanes(
                traits, bodies, springs, strings, obstacles, faces, air, state, lanes, group,
                time_in_frame, step_seconds, points, new_points,
            )  # fmt: skip
        else:
            move_particle_lanes(traits, bodies, springs, lanes, group, time_in_frame, step_seconds, points, new_points)
            add_string_lanes(traits, bodies, strings, state, lanes, group, step_seconds, points, new_points)
        correct_lanes(bodies, correction, lanes, new_points, group, step_seconds)
        leave_obstacle_lanes(
            traits, bodies, air, obstacles, state, lanes, new_points, group, step_seconds, time_in_frame
        )
    write_lanes(state, lanes, new_points, group)

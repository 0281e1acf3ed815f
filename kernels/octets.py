"""The `octets` schedule: a thread advances a world by a whole frame, eight particles side by side. For the CPU."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.inflation import push
from balloon_warp.kernels.lanes_types import (
    LANE_COUNT,
    Lanes,
    Lanes3,
    column,
    lanes_scaled,
    set_column,
    squared_lengths,
)
from balloon_warp.kernels.octets_contact import leaving_obstacles, move_world_spheres, touching_any
from balloon_warp.kernels.octets_inflation import aim_all_octets
from balloon_warp.kernels.octets_state import (
    DRAG,
    LIFT,
    RAMP_BEGIN,
    RAMP_SLOPE,
    RESPONSE,
    OctetFaces,
    OctetSprings,
    OctetState,
    fetch,
    read_octets,
    store,
    whole_octet,
    write_octets,
)
from balloon_warp.kernels.pull import pull_of_strings
from balloon_warp.kernels.springs import spring_coefficient
from balloon_warp.kernels.tables import BodyTable, ObstacleTable, StringTable, WorldState


@wp.func
def pull_of_octet_springs(
    springs: OctetSprings, numbers: wp.array[Lanes], points: wp.array[wp.vec4], octet: wp.int32, point: Lanes3
):
    """Net force of each particle's springs [N]."""
    force = Lanes3()
    scales = Lanes(1.0)
    for slot in range(springs.offsets[octet], springs.offsets[octet + 1]):
        if springs.scales.shape[0] > 0:
            scales = springs.scales[slot]
        constants = numbers[springs.kinds[slot]]
        rest_lengths = springs.rest_lengths[slot]
        d = fetch(points, springs.ends[slot]) - point
        squared = squared_lengths(d)
        coefficients = Lanes()
        for lane in range(LANE_COUNT):
            coefficients[lane] = constants[lane] * spring_coefficient(squared[lane], scales[lane], rest_lengths[lane])
        force += lanes_scaled(d, coefficients)
    return force


@wp.func
def pull_of_octet_strings(strings: StringTable, world: wp.int32, octet: wp.int32, point: Lanes3):
    """Net force of the strings that hold each particle [N]. Few are held."""
    force = Lanes3()
    if strings.offsets.shape[0] > 0:
        begin = LANE_COUNT * octet
        end = wp.min(begin + LANE_COUNT, strings.offsets.shape[0] - 1)
        if strings.offsets[begin] < strings.offsets[end]:
            for particle in range(begin, end):
                lane = particle - begin
                pull = pull_of_strings(strings, column(point, lane), world, particle)
                force = set_column(force, lane, pull)
    return force


@wp.func
def body_force_octet(numbers: wp.array[Lanes], up: wp.vec3, velocity: Lanes3):
    """Gravity, helium and damping on each particle [N]."""
    return wp.outer(up, numbers[LIFT]) - lanes_scaled(velocity, numbers[DRAG])


@wp.func
def inflation_octet(numbers: wp.array[Lanes], time_in_frame: float):
    """Force of the inflation along an aim of length one on each particle [N]."""
    begin = numbers[RAMP_BEGIN]
    slope = numbers[RAMP_SLOPE]
    forces = Lanes()
    for lane in range(LANE_COUNT):
        forces[lane] = push(begin[lane] + slope[lane] * time_in_frame)
    return forces


@cache
def octet_kernel(fresh_normals: bool, spheres: bool, impulses: bool) -> Any:
    """The kernel that advances worlds; with fresh normals it aims the inflation every substep, or not at all. Without
    spheres it compiles sooner."""
    is_any_touching = touching_any(spheres)
    leave_obstacles = leaving_obstacles(spheres, impulses)

    @wp.kernel(module="unique", enable_backward=False)
    def advance_octets(
        # model
        bodies: BodyTable,
        springs: OctetSprings,
        strings: StringTable,
        obstacles: ObstacleTable,
        faces: OctetFaces,
        substeps: wp.int32,
        step_seconds: float,
        # state in and out
        state: WorldState,
        octets: OctetState,
    ):
        """A thread a world: one frame."""
        world = wp.tid()
        read_octets(bodies, springs, step_seconds, state, octets, world)
        points = octets.points[world]
        new_points = octets.other_points[world]
        for substep in range(substeps):
            if substep % 2 == 1:
                points = octets.other_points[world]
                new_points = octets.points[world]
            else:
                points = octets.points[world]
                new_points = octets.other_points[world]
            time_in_frame = float(substep) * step_seconds
            if wp.static(fresh_normals):
                aim_all_octets(bodies, faces, octets, world, points)
            if wp.static(spheres):
                move_world_spheres(bodies, obstacles, state, world, step_seconds)
            for octet in range(octets.velocities.shape[1]):
                numbers = octets.numbers[world, octet]
                point = fetch(points, whole_octet(octet))
                velocity = octets.velocities[world, octet]
                force = pull_of_octet_springs(springs, numbers, points, octet, point)
                force += lanes_scaled(octets.aims[world, octet], inflation_octet(numbers, time_in_frame))
                force += body_force_octet(numbers, bodies.up, velocity)
                force += pull_of_octet_strings(strings, world, octet, point)
                velocity += lanes_scaled(force, numbers[RESPONSE])
                point += step_seconds * velocity
                if is_any_touching(bodies, obstacles, state, world, point):
                    point, velocity = leave_obstacles(
                        bodies, obstacles, state, octets, world, octet, step_seconds, time_in_frame, point, velocity
                    )
                octets.velocities[world, octet] = velocity
                store(new_points, octet, point)
        write_octets(state, octets, new_points, world)

    return advance_octets

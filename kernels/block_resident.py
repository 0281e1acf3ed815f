"""The `block` schedule's kernel for worlds of at most 1,024 particles: all but the points stays in registers.

A thread has one particle, or two, which then share what a thread does for itself. What bounds it, for a particle and
substep with 12 springs: 12 loads and a store of 3 words from shared memory, 39 wavefronts a warp without bank
conflicts; and 14 instructions a spring and 23 more, 191 in all. A multiprocessor does one wavefront and four
instructions of a warp in a cycle, so that issue bounds it first, at 48 cycles for 32 particles: 132 multiprocessors at
1.98 GHz make 1.75e11 particle-substeps a second.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.block import count_frame_in_block
from balloon_warp.kernels.block_slots import SlotTable, slot_functions
from balloon_warp.kernels.block_spheres import sphere_functions
from balloon_warp.kernels.contact import leave_ground, leave_sphere, penalty_force
from balloon_warp.kernels.health import HealthTable, is_past, look_at_particle
from balloon_warp.kernels.inflation import FAR, aim_of, face_area_vector, face_center, nearer_area, push
from balloon_warp.kernels.motion import lift, response
from balloon_warp.kernels.pull import pull_of_strings
from balloon_warp.kernels.tables import (
    BodyTable,
    FaceTable,
    ObstacleTable,
    StringTable,
    WorldState,
    ground_friction,
    ground_height,
    particle_damping,
    particle_mass,
    row_of_world,
)
from balloon_warp.kernels.warps import (
    WARP_THREADS,
    any_in_warp,
    block_barrier,
    put,
    warp_sum,
)


@cache
def resident_kernel(
    threads: int,
    particles_a_thread: int,
    face_turns: int,
    kind_slots: tuple[int, int, int],
    face_slots: int,
    sphere_count: int,
    springs_vary: bool,
    has_strings: bool,
    has_ground: bool,
    fresh_normals: bool,
    odd_substeps: bool,
    max_registers: int,
) -> Any:
    """A kernel for just what a scene has."""
    face_capacity = threads * face_turns
    capacity = threads * particles_a_thread
    Springs, read_springs, pull_of_slots, _ = slot_functions(kind_slots, springs_vary)  # noqa: N806 - a type
    sphere_board, begin_spheres, moved_sphere, _, penalty_of, post_force, end_spheres = sphere_functions(
        threads, max(sphere_count, 1)
    )
    warps = threads // int(WARP_THREADS)
    area_sums = 2 * warps
    two = particles_a_thread == 2

    @wp.struct
    class Body:
        """What else a particle has for all of a frame."""

        number: wp.int32
        active: bool  # whether there is such a particle
        balloon: wp.int32
        upward: float  # gravity and helium [N]
        damping: float
        response: float  # velocity gained in a substep for each newton
        ramp: wp.vec2  # the inflation's

    @wp.func
    def measure_faces(faces: FaceTable, points: Any, lane: wp.int32, centers: Any, area_vectors: Any):
        """Every face by one thread, into the tiles."""
        for turn in range(face_turns):
            face = turn * threads + lane
            if face < faces.balloon.shape[0]:
                begin = faces.offsets[face]
                end = faces.offsets[face + 1]
                center = face_center(points, 0, faces.particles, begin, end)
                put(centers, face, center)
                put(area_vectors, face, face_area_vector(points, 0, faces.particles, begin, end, center))
        block_barrier()

    @wp.func
    def balloon_area(faces: FaceTable, area_vectors: Any, sums: Any, balloon: wp.int32, lane: wp.int32):
        """Area of a balloon whose faces have been measured, summed in the same order every time."""
        part = float(0.0)
        for turn in range(face_turns):
            face = turn * threads + lane
            if face >= faces.balloon_offsets[balloon] and face < faces.balloon_offsets[balloon + 1]:
                part += wp.length(area_vectors[face])
        row = (balloon & 1) * warps  # of two, so that the next balloon does not overwrite what is still read
        part = warp_sum(part)
        if lane % WARP_THREADS == 0:
            put(sums, row + lane // WARP_THREADS, part)
        block_barrier()
        mine = lane % WARP_THREADS
        return warp_sum(wp.where(mine < warps, sums[row + wp.min(mine, warps - 1)], 0.0))

    @wp.func
    def refreshed_aim(
        faces: FaceTable,
        springs: SlotTable,
        lane: wp.int32,
        centers: Any,
        area_vectors: Any,
        sums: Any,
        body: Body,
        point: wp.vec3,
    ):
        """The aim of a particle, when the faces have been measured; by all threads, who sum the areas."""
        normal = wp.vec3()
        nearest = wp.vec2(FAR, 0.0)
        for slot in range(face_slots):
            # Without a branch, so that the loads of all slots are under way together.
            face = springs.faces[slot, body.number]
            area_vector = area_vectors[wp.max(face, 0)]
            nearer = nearer_area(nearest, point, centers[wp.max(face, 0)], area_vector)
            normal += wp.where(face >= 0, wp.normalize(area_vector), wp.vec3())
            nearest = wp.where(face >= 0, nearer, nearest)
        aim = wp.vec3()
        for each in range(faces.balloon_offsets.shape[0] - 1):
            area = balloon_area(faces, area_vectors, sums, each, lane)
            if each == body.balloon:
                aim = aim_of(normal, nearest, area)
        return aim

    @wp.func
    def read_body(bodies: BodyTable, state: WorldState, world: wp.int32, place: wp.int32, step_seconds: float):
        """Into registers, the particle at a place; where there is none, the last again, which then does not move."""
        body = Body()
        body.active = place < state.points.shape[1]
        body.number = wp.min(place, state.points.shape[1] - 1)
        body.balloon = bodies.balloon[body.number]
        mass = particle_mass(bodies, world, body.number)
        gravity = bodies.gravity[row_of_world(world, bodies.gravity.shape[0])]
        body.upward = lift(mass, gravity, bodies.helium[row_of_world(world, bodies.helium.shape[0]), body.balloon])
        body.damping = particle_damping(bodies, world, body.number)
        body.response = wp.where(body.active, response(mass, step_seconds), 0.0)
        body.ramp = state.inflation_ramp[world, body.balloon]
        return body

    @wp.func
    def write_particle(state: WorldState, world: wp.int32, body: Body, point: wp.vec3, velocity: wp.vec3, aim: wp.vec3):
        """Out of registers, what a frame ends with."""
        if body.active:
            state.points[world, body.number] = point
            state.velocities[world, body.number] = velocity
            state.inflation_aims[world, body.number] = aim

    @wp.func
    def look_at_particles(
        bodies: BodyTable, health: HealthTable, state: WorldState, world: wp.int32, lane: wp.int32, points: Any
    ):
        """At those of a thread."""
        for particle in range(lane, state.points.shape[1], threads):
            look_at_particle(bodies, health, state.first_bad, world, particle, points[particle], points, 0)

    @wp.func
    def inflation_of(body: Body, aim: wp.vec3, time_in_frame: float):
        """[N]"""
        return push(body.ramp[0] + body.ramp[1] * time_in_frame) * aim

    @wp.func
    def advance_particle(
        bodies: BodyTable,
        strings: StringTable,
        world: wp.int32,
        time_in_frame: float,
        step_seconds: float,
        points: Any,
        body: Body,
        springs: Springs,
        aim: wp.vec3,
        point: wp.vec3,
        velocity: wp.vec3,
    ):
        """A step under all forces but those of contacts."""
        force = body.upward * bodies.up - body.damping * velocity + inflation_of(body, aim, time_in_frame)
        force += pull_of_slots(points, point, springs)
        if wp.static(has_strings):
            force += pull_of_strings(strings, point, world, body.number)
        new_velocity = velocity + body.response * force
        return point + step_seconds * new_velocity, new_velocity

    @wp.func
    def is_inside(body: Body, point: wp.vec3, center: wp.vec3, radius: float):
        """Whether a particle that moves is inside a sphere."""
        return wp.length_sq(point - center) < radius * radius and body.response > 0.0

    @wp.func
    def stand(ground: wp.vec2, up: wp.vec3, body: Body, point: wp.vec3, velocity: wp.vec3):
        """A particle that moves up to the ground, of some height and friction; most are above."""
        if wp.dot(point, up) < ground[0] and body.response > 0.0:
            return leave_ground(point, velocity, up, ground[0], ground[1])
        return point, velocity

    @wp.func
    def advance_substep(
        bodies: BodyTable,
        strings: StringTable,
        faces: FaceTable,
        slot_table: SlotTable,
        board: wp.uint64,
        world: wp.int32,
        lane: wp.int32,
        ground: wp.vec2,
        substep: wp.int32,
        step_seconds: float,
        body: Body,
        springs: Springs,
        body2: Body,
        springs2: Springs,
        source: Any,
        # in and out
        aim: wp.vec3,
        point: wp.vec3,
        velocity: wp.vec3,
        aim2: wp.vec3,
        point2: wp.vec3,
        velocity2: wp.vec3,
        target: Any,
        face_centers: Any,
        area_vectors: Any,
        sums: Any,
    ):
        """One substep, from one tile of points to the other."""
        time = float(substep) * step_seconds
        if wp.static(fresh_normals):
            measure_faces(faces, source, lane, face_centers, area_vectors)
            aim = refreshed_aim(faces, slot_table, lane, face_centers, area_vectors, sums, body, point)
            if wp.static(two):
                aim2 = refreshed_aim(faces, slot_table, lane, face_centers, area_vectors, sums, body2, point2)
        new_point, new_velocity = advance_particle(
            bodies, strings, world, time, step_seconds, source, body, springs, aim, point, velocity
        )
        point = new_point
        velocity = new_velocity
        if wp.static(two):
            new_point2, new_velocity2 = advance_particle(
                bodies, strings, world, time, step_seconds, source, body2, springs2, aim2, point2, velocity2
            )
            point2 = new_point2
            velocity2 = new_velocity2
        if wp.static(sphere_count > 0):
            for sphere in range(sphere_count):
                center, motion, radius = moved_sphere(board, bodies.up, sphere, substep, step_seconds, lane)
                meets = is_inside(body, point, center, radius)
                meets2 = bool(False)
                if wp.static(two):
                    meets2 = is_inside(body2, point2, center, radius)
                if any_in_warp(meets or meets2):
                    force = wp.vec3()
                    penalty = penalty_of(board, sphere)
                    if meets:
                        left, slowed, outward = leave_sphere(point, velocity, center, motion, radius, bodies.up)
                        point = left
                        velocity = slowed
                        force = penalty_force(penalty, inflation_of(body, aim, time), outward)
                    if wp.static(two):
                        if meets2:
                            left, slowed, outward = leave_sphere(point2, velocity2, center, motion, radius, bodies.up)
                            point2 = left
                            velocity2 = slowed
                            force += penalty_force(penalty, inflation_of(body2, aim2, time), outward)
                    post_force(board, sphere, substep, lane, force)
        if wp.static(has_ground):
            stood_point, stood_velocity = stand(ground, bodies.up, body, point, velocity)
            point = stood_point
            velocity = stood_velocity
            if wp.static(two):
                stood_point2, stood_velocity2 = stand(ground, bodies.up, body2, point2, velocity2)
                point2 = stood_point2
                velocity2 = stood_velocity2
        put(target, lane, point)
        if wp.static(two):
            put(target, lane + threads, point2)
        block_barrier()
        return aim, point, velocity, aim2, point2, velocity2

    @wp.func
    def carry_particles(
        bodies: BodyTable,
        strings: StringTable,
        obstacles: ObstacleTable,
        faces: FaceTable,
        slot_table: SlotTable,
        health: HealthTable,
        board: wp.uint64,
        state: WorldState,
        world: wp.int32,
        lane: wp.int32,
        substeps: wp.int32,
        step_seconds: float,
        even: Any,
        odd: Any,
        face_centers: Any,
        area_vectors: Any,
        sums: Any,
    ):
        """By the particles' threads: one frame."""
        ground = wp.vec2(ground_height(obstacles, world), ground_friction(obstacles, world))
        body = read_body(bodies, state, world, lane, step_seconds)
        springs = read_springs(slot_table, world, body.balloon, body.number)
        point = state.points[world, body.number]
        velocity = state.velocities[world, body.number]
        aim = wp.vec3()
        put(even, lane, point)
        body2 = Body()
        springs2 = Springs()
        point2 = wp.vec3()
        velocity2 = wp.vec3()
        aim2 = wp.vec3()
        if wp.static(two):
            body2 = read_body(bodies, state, world, lane + threads, step_seconds)
            springs2 = read_springs(slot_table, world, body2.balloon, body2.number)
            point2 = state.points[world, body2.number]
            velocity2 = state.velocities[world, body2.number]
            put(even, lane + threads, point2)
        block_barrier()
        if wp.static(not fresh_normals):
            measure_faces(faces, even, lane, face_centers, area_vectors)
            aim = refreshed_aim(faces, slot_table, lane, face_centers, area_vectors, sums, body, point)
            if wp.static(two):
                aim2 = refreshed_aim(faces, slot_table, lane, face_centers, area_vectors, sums, body2, point2)
        for pair in range(substeps // 2):
            substep = 2 * pair
            aim, point, velocity, aim2, point2, velocity2 = advance_substep(
                bodies, strings, faces, slot_table, board, world, lane, ground,
                substep, step_seconds, body, springs, body2, springs2, even,
                aim, point, velocity, aim2, point2, velocity2, odd, face_centers, area_vectors, sums,
            )  # fmt: skip
            aim, point, velocity, aim2, point2, velocity2 = advance_substep(
                bodies, strings, faces, slot_table, board, world, lane, ground,
                substep + 1, step_seconds, body, springs, body2, springs2, odd,
                aim, point, velocity, aim2, point2, velocity2, even, face_centers, area_vectors, sums,
            )  # fmt: skip
        if wp.static(odd_substeps):
            aim, point, velocity, aim2, point2, velocity2 = advance_substep(
                bodies, strings, faces, slot_table, board, world, lane, ground,
                substeps - 1, step_seconds, body, springs, body2, springs2, even,
                aim, point, velocity, aim2, point2, velocity2, odd, face_centers, area_vectors, sums,
            )  # fmt: skip
        write_particle(state, world, body, point, velocity, aim)
        far = is_past(point, health.near)
        if wp.static(two):
            write_particle(state, world, body2, point2, velocity2, aim2)
            far = far or is_past(point2, health.near)
        if far:  # few are
            if wp.static(odd_substeps):
                look_at_particles(bodies, health, state, world, lane, odd)
            else:
                look_at_particles(bodies, health, state, world, lane, even)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=max_registers,
        module_options={"fast_math": True, "max_unroll": 128},
    )
    def advance_resident(
        # model
        bodies: BodyTable,
        strings: StringTable,
        obstacles: ObstacleTable,
        faces: FaceTable,
        slot_table: SlotTable,
        health: HealthTable,
        substeps: wp.int32,
        step_seconds: float,
        # state in and out
        state: WorldState,
    ):
        """A block a world, one or two particles a thread: one frame."""
        world, lane = wp.tid()
        even = wp.tile_empty(shape=capacity, dtype=wp.vec3, storage="shared")
        odd = wp.tile_empty(shape=capacity, dtype=wp.vec3, storage="shared")
        face_centers = wp.tile_empty(shape=face_capacity, dtype=wp.vec3, storage="shared")
        area_vectors = wp.tile_empty(shape=face_capacity, dtype=wp.vec3, storage="shared")
        sums = wp.tile_empty(shape=area_sums, dtype=float, storage="shared")
        board = wp.uint64(0)
        if wp.static(sphere_count > 0):
            board = sphere_board()
            begin_spheres(board, bodies, obstacles, state, world, lane)
        carry_particles(
            bodies, strings, obstacles, faces, slot_table, health, board, state, world, lane, substeps, step_seconds,
            even, odd, face_centers, area_vectors, sums,
        )  # fmt: skip
        if wp.static(sphere_count > 0):
            end_spheres(board, health, state, world, substeps - 1, lane)
        count_frame_in_block(state, world, lane)

    return advance_resident

"""The `block` schedule's kernel for worlds of at most a thread a particle: all but the points stays in registers.

What bounds it, for a particle and substep with 12 springs: 12 loads and a store of 3 words from shared memory, 39
wavefronts a warp without bank conflicts; and some 15 instructions a spring and 40 more, 220 in all. A multiprocessor
does one wavefront and four instructions of a warp in a cycle, so that issue bounds it first, at 55 cycles for 32
particles: 132 multiprocessors at 1.98 GHz make 1.5e11 particle-substeps a second.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.block import (
    SphereForces,
    acceleration_by_touch,
    begin_sphere_forces,
    clear_sphere_force,
    count_frame_in_block,
    force_row,
    measured_balloon_area,
    meet_ground,
    meet_sphere,
    row_of,
    sphere_radius,
    were_touched,
)
from balloon_warp.kernels.contact import move_sphere
from balloon_warp.kernels.fixed_point import total_newtons
from balloon_warp.kernels.inflation import FAR, aim_of, face_area_vector, face_center, nearer_area, push
from balloon_warp.kernels.motion import lift, response
from balloon_warp.kernels.pull import pull_of_strings
from balloon_warp.kernels.springs import spring_coefficient, squared_length
from balloon_warp.kernels.tables import (
    BodyTable,
    FaceTable,
    ObstacleTable,
    StringTable,
    WorldState,
    ground_height,
    ground_restitution,
    particle_damping,
    particle_mass,
    row_of_world,
)


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
    faces: wp.array2d[wp.int32]
    """the faces around each particle, -1 where there are no more, shape (face_slot_count, particle_count)"""


@cache
def resident_kernel(
    threads: int,
    face_turns: int,
    kind_slots: tuple[int, int, int],
    face_slots: int,
    sphere_count: int,
    springs_vary: bool,
    has_strings: bool,
    has_ground: bool,
    fresh_normals: bool,
    max_registers: int,
) -> Any:
    """A kernel for just what a scene has."""
    face_capacity = threads * face_turns
    structural_slots = kind_slots[0]
    shear_end = structural_slots + kind_slots[1]
    slots = shear_end + kind_slots[2]
    Indices = wp.types.vector(length=slots, dtype=wp.int32)  # noqa: N806 - a type
    Numbers = wp.types.vector(length=slots, dtype=wp.float32)  # noqa: N806
    Spheres = wp.types.matrix(shape=(max(sphere_count, 1), 3), dtype=wp.float32)  # noqa: N806
    SphereNumbers = wp.types.vector(length=max(sphere_count, 1), dtype=wp.float32)  # noqa: N806

    @wp.struct
    class Particle:
        """A thread's particle, its springs, and the spheres, which every thread moves for itself."""

        point: wp.vec3
        velocity: wp.vec3
        aim: wp.vec3
        upward: float  # gravity and helium [N]
        gravity: float
        damping: float
        response: float  # velocity gained in a substep for each newton
        structural: float
        shear: float
        flexion: float
        neighbors: Indices
        scales: Numbers
        rests: Numbers  # rest length times spring constant [N]
        touched_before: bool  # whether spheres were touched two substeps ago
        ground_height: float
        sphere_radii: SphereNumbers
        centers: Spheres
        motions: Spheres

    @wp.func
    def read_springs(springs: SlotTable, world: wp.int32, balloon: wp.int32, particle: wp.int32, me: Particle):
        """Into registers; constants[kind] * scale is a spring's own."""
        row = row_of_world(world, springs.stiffness.shape[0])
        me.structural = springs.stiffness[row, balloon, 0]
        me.shear = springs.stiffness[row, balloon, 1]
        me.flexion = springs.stiffness[row, balloon, 2]
        for slot in range(slots):
            me.neighbors[slot] = springs.neighbors[slot, particle] & 0xFFFF  # tells the compiler: not negative
            me.scales[slot] = springs.scales[slot, particle] if wp.static(springs_vary) else 1.0
            me.rests[slot] = springs.rest_lengths[slot, particle]
        for slot in range(structural_slots):
            me.rests[slot] *= me.structural
        for slot in range(structural_slots, shear_end):
            me.rests[slot] *= me.shear
        for slot in range(shear_end, slots):
            me.rests[slot] *= me.flexion
        return me

    @wp.func
    def pull_of_slots(points: Any, me: Particle):
        """Net force of the springs [N]."""
        force = wp.vec3()
        for slot in range(structural_slots):
            d = points[me.neighbors[slot]] - me.point
            force += spring_coefficient(squared_length(d), me.structural * me.scales[slot], me.rests[slot]) * d
        for slot in range(structural_slots, shear_end):
            d = points[me.neighbors[slot]] - me.point
            force += spring_coefficient(squared_length(d), me.shear * me.scales[slot], me.rests[slot]) * d
        for slot in range(shear_end, slots):
            d = points[me.neighbors[slot]] - me.point
            force += spring_coefficient(squared_length(d), me.flexion * me.scales[slot], me.rests[slot]) * d
        return force

    @wp.func
    def measure_faces(faces: FaceTable, points: Any, lane: wp.int32, centers: Any, area_vectors: Any):
        """Every face by one thread, into the tiles."""
        for turn in range(face_turns):
            face = wp.min(turn * threads + lane, faces.balloon.shape[0] - 1)
            begin = faces.offsets[face]
            end = faces.offsets[face + 1]
            center = face_center(points, 0, faces.particles, begin, end)
            area_vector = face_area_vector(points, 0, faces.particles, begin, end, center)
            measured = turn * threads + lane < faces.balloon.shape[0]
            wp.tile_scatter_masked(centers, face, center, measured)
            wp.tile_scatter_masked(area_vectors, face, area_vector, measured)

    @wp.func
    def refresh_aim(
        faces: FaceTable,
        springs: SlotTable,
        points: Any,
        balloon: wp.int32,
        particle: wp.int32,
        lane: wp.int32,
        centers: Any,
        area_vectors: Any,
        me: Particle,
    ):
        """The aim of the particle; measuring faces takes all threads."""
        measure_faces(faces, points, lane, centers, area_vectors)
        normal = wp.vec3()
        nearest = wp.vec2(FAR, 0.0)
        for slot in range(face_slots):
            # Without a branch, so that the loads of all slots are under way together.
            face = springs.faces[slot, particle]
            area_vector = area_vectors[wp.max(face, 0)]
            nearer = nearer_area(nearest, me.point, centers[wp.max(face, 0)], area_vector)
            normal += wp.where(face >= 0, wp.normalize(area_vector), wp.vec3())
            nearest = wp.where(face >= 0, nearer, nearest)
        for each in range(faces.balloon_offsets.shape[0] - 1):
            area = measured_balloon_area(faces, area_vectors, each, lane)
            if each == balloon:
                me.aim = aim_of(normal, nearest, area)
        return me

    @wp.func
    def advance_substep(
        bodies: BodyTable,
        strings: StringTable,
        obstacles: ObstacleTable,
        faces: FaceTable,
        springs: SlotTable,
        sphere_forces: SphereForces,
        world: wp.int32,
        lane: wp.int32,
        particle: wp.int32,
        active: bool,
        substep: wp.int32,
        k_normal: float,
        step_seconds: float,
        source: Any,
        # in and out
        me: Particle,
        target: Any,
        face_centers: Any,
        area_vectors: Any,
    ):
        """One substep, from one tile of points to the other."""
        if wp.static(fresh_normals):
            me = refresh_aim(
                faces, springs, source, bodies.balloon[particle], particle, lane, face_centers, area_vectors, me
            )
        if wp.static(sphere_count > 0):
            touched = were_touched(sphere_forces.stamps[world], substep - 1)
            for sphere in range(sphere_count):
                pushed = acceleration_by_touch(obstacles, sphere_forces, touched, world, sphere, substep - 1)
                center, motion = move_sphere(
                    row_of(me.centers, sphere), row_of(me.motions, sphere), pushed, me.sphere_radii[sphere],
                    me.gravity, bodies.up, me.ground_height, ground_restitution(obstacles, world), step_seconds,
                )  # fmt: skip
                me.centers[sphere] = center
                me.motions[sphere] = motion
                if me.touched_before and lane == 0:
                    clear_sphere_force(sphere_forces, world, sphere, substep - 2)
            me.touched_before = touched
        inflation = push(k_normal) * me.aim
        force = me.upward * bodies.up - me.damping * me.velocity + inflation + pull_of_slots(source, me)
        if wp.static(has_strings):
            force += pull_of_strings(strings, me.point, world, particle)
        me.velocity += me.response * force
        me.point += step_seconds * me.velocity
        if me.response > 0.0:
            for sphere in range(sphere_count):
                point, velocity = meet_sphere(
                    obstacles, sphere_forces, world, sphere, substep, me.point, me.velocity,
                    row_of(me.centers, sphere), row_of(me.motions, sphere), me.sphere_radii[sphere], bodies.up,
                    inflation, active,
                )  # fmt: skip
                me.point = point
                me.velocity = velocity
            if wp.static(has_ground):
                point, velocity = meet_ground(obstacles, world, me.point, me.velocity, bodies.up, me.ground_height)
                me.point = point
                me.velocity = velocity
        wp.tile_scatter_masked(target, particle, me.point, active)
        return me

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
        springs: SlotTable,
        substeps: wp.int32,
        step_seconds: float,
        # state in and out
        state: WorldState,
        sphere_forces: SphereForces,
    ):
        """A block a world, a thread a particle: one frame."""
        world, lane = wp.tid()
        active = lane < state.points.shape[1]
        particle = wp.min(lane, state.points.shape[1] - 1)
        balloon = bodies.balloon[particle]
        mass = particle_mass(bodies, world, particle)
        me = Particle()
        me.gravity = bodies.gravity[row_of_world(world, bodies.gravity.shape[0])]
        me.ground_height = ground_height(obstacles, world)
        helium = bodies.helium[row_of_world(world, bodies.helium.shape[0]), balloon]
        ramp = state.inflation_ramp[world, balloon]

        me.point = state.points[world, particle]
        me.velocity = state.velocities[world, particle]
        me.upward = lift(mass, me.gravity, helium)
        me.damping = particle_damping(bodies, world, particle)
        me.response = response(mass, step_seconds)
        me = read_springs(springs, world, balloon, particle, me)
        for sphere in range(sphere_count):
            me.centers[sphere] = state.sphere_positions[world, sphere]
            me.motions[sphere] = state.sphere_velocities[world, sphere]
            me.sphere_radii[sphere] = sphere_radius(obstacles, world, sphere)
        if wp.static(sphere_count > 0):
            if lane == 0:
                begin_sphere_forces(state, sphere_forces, world)

        even = wp.tile_empty(shape=threads, dtype=wp.vec3, storage="shared")
        odd = wp.tile_empty(shape=threads, dtype=wp.vec3, storage="shared")
        face_centers = wp.tile_empty(shape=face_capacity, dtype=wp.vec3, storage="shared")
        area_vectors = wp.tile_empty(shape=face_capacity, dtype=wp.vec3, storage="shared")
        wp.tile_scatter_masked(even, particle, me.point, active)
        if wp.static(not fresh_normals):
            me = refresh_aim(faces, springs, even, balloon, particle, lane, face_centers, area_vectors, me)
        for substep in range(0, substeps, 2):
            k_normal = ramp[0] + ramp[1] * (float(substep) * step_seconds)
            me = advance_substep(
                bodies, strings, obstacles, faces, springs, sphere_forces, world, lane, particle, active,
                substep, k_normal, step_seconds, even, me, odd, face_centers, area_vectors,
            )  # fmt: skip
            if substep + 1 < substeps:
                k_normal = ramp[0] + ramp[1] * (float(substep + 1) * step_seconds)
                me = advance_substep(
                    bodies, strings, obstacles, faces, springs, sphere_forces, world, lane, particle, active,
                    substep + 1, k_normal, step_seconds, odd, me, even, face_centers, area_vectors,
                )  # fmt: skip

        if active:
            state.points[world, particle] = me.point
            state.velocities[world, particle] = me.velocity
            state.inflation_aims[world, particle] = me.aim
        count_frame_in_block(state, world, lane)
        if wp.static(sphere_count > 0):
            if lane == 0:
                for sphere in range(sphere_count):
                    state.sphere_positions[world, sphere] = row_of(me.centers, sphere)
                    state.sphere_velocities[world, sphere] = row_of(me.motions, sphere)
                    state.sphere_forces[world, sphere] = total_newtons(
                        sphere_forces.totals, force_row(world, substeps - 1), sphere
                    )

    return advance_resident

"""The `block` schedule's kernel for balloons with pressure or gas, of quads: all but the points stays in registers.

A thread has a particle. Its structural and shear springs go around it in a ring, e0 s0 e1 s1 ... e0, so that the points
at their other ends, once loaded, give the area vectors of the quads between them, too. The volume is 1/3 sum x . a over
the particles: it is homogeneous of degree three in the points, and a is its gradient. A barrier in the middle of a
substep lets every thread know how its balloon swells, and find the pressure for itself.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.air import air_density, load_of_balloon
from balloon_warp.kernels.block import count_frame_in_block
from balloon_warp.kernels.block_air import keep_load
from balloon_warp.kernels.block_slots import SlotTable, slot_functions
from balloon_warp.kernels.block_spheres import sphere_functions
from balloon_warp.kernels.contact import above_ground, leave_ground, leave_sphere, out_of_sphere, penalty_force
from balloon_warp.kernels.gas import GAS, VOLUME, Swelling, air_drag, area_vector_in_quad, swelling_of_particle
from balloon_warp.kernels.health import HealthTable, look_at_particle
from balloon_warp.kernels.motion import lift, response
from balloon_warp.kernels.pull import pull_of_strings
from balloon_warp.kernels.tables import (
    AirTable,
    BodyTable,
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
    put_warp_sums,
    shared_words,
    sum_of_warp_sums,
)

NUMBERS_OF_WARP = wp.constant(8)
"""that `put_warp_sums` puts"""


@cache
def resident_air_kernel(
    threads: int,
    kind_slots: tuple[int, int, int],
    balloon_count: int,
    sphere_count: int,
    springs_vary: bool,
    has_strings: bool,
    has_ground: bool,
    odd_substeps: bool,
    max_registers: int,
) -> Any:
    """A kernel for just what a scene has; the slots of structural and shear springs are as many, in rings."""
    ring = kind_slots[0]
    warps = threads // int(WARP_THREADS)
    balloon_sums = int(NUMBERS_OF_WARP) * warps
    shared_sums = shared_words(balloon_count * balloon_sums)
    Springs, read_springs, pull_of_slots, _ = slot_functions(kind_slots, springs_vary)  # noqa: N806 - a type
    sphere_board, begin_spheres, moved_sphere, sphere_now, penalty_of, post_force, end_spheres = sphere_functions(
        threads, max(sphere_count, 1)
    )

    @wp.struct
    class Body:
        """What a particle has for all of a frame, beside its springs."""

        number: wp.int32
        active: bool  # whether there is such a particle
        balloon: wp.int32
        origin: wp.int32  # the particle about which its balloon's volume is taken
        valence: wp.int32
        mass: float  # without gas [kg]
        share: float  # of its balloon's mass
        molar_mass: float
        upward: float  # gravity and helium [N]
        damping: float
        air_density: float
        drag_coefficient: float
        wind: wp.vec3
        ramp: wp.vec2  # pressure, or what is pumped

    @wp.func
    def read_body(
        bodies: BodyTable, air: AirTable, springs: SlotTable, state: WorldState, world: wp.int32, place: wp.int32
    ):
        """Into registers, the particle at a place; where there is none, the last again, which then does not move."""
        body = Body()
        body.active = place < state.points.shape[1]
        body.number = wp.min(place, state.points.shape[1] - 1)
        body.balloon = bodies.balloon[body.number]
        body.origin = air.balloon_particles[body.balloon]
        body.valence = springs.valences[body.number]
        body.mass = wp.where(body.active, particle_mass(bodies, world, body.number), 0.0)
        body.share = wp.where(body.active, bodies.mass_share[body.number], 0.0)
        body.molar_mass = air.molar_mass[row_of_world(world, air.molar_mass.shape[0]), body.balloon]
        gravity = bodies.gravity[row_of_world(world, bodies.gravity.shape[0])]
        helium = bodies.helium[row_of_world(world, bodies.helium.shape[0]), body.balloon]
        body.upward = lift(body.mass, gravity, helium)
        body.damping = particle_damping(bodies, world, body.number)
        body.air_density = air_density(air, world)
        body.drag_coefficient = air.drag_coefficient[row_of_world(world, air.drag_coefficient.shape[0]), body.balloon]
        body.wind = air.wind[row_of_world(world, air.wind.shape[0])]
        body.ramp = state.inflation_ramp[world, body.balloon]
        return body

    @wp.func
    def ring_area_vector(points: Any, point: wp.vec3, springs: Springs, valence: wp.int32):
        """Area vector of a particle, by the quads around it [m^2]. Slots past its valence hold the particle itself."""
        area_vector = wp.vec3()
        first = points[springs.neighbors[0]] - point
        before = first
        for slot in range(1, ring):
            opposite = points[springs.neighbors[ring + slot - 1]] - point
            after = points[springs.neighbors[slot]] - point
            area_vector += area_vector_in_quad(before, opposite, wp.where(slot == valence, first, after))
            before = after
        opposite = points[springs.neighbors[2 * ring - 1]] - point
        return area_vector + area_vector_in_quad(before, opposite, first)

    @wp.func
    def beside_obstacles(
        board: wp.uint64,
        up: wp.vec3,
        ground: wp.vec2,
        substep: wp.int32,
        step_seconds: float,
        lane: wp.int32,
        moves: bool,
        point: wp.vec3,
    ):
        """Where obstacles let a point go, and the normal of the last one that it met there, zero if none."""
        end = point
        normal = wp.vec3()
        for sphere in range(sphere_count):
            center, _motion, radius = moved_sphere(board, up, sphere, substep, step_seconds, lane)
            if moves:
                out, outward = out_of_sphere(end, normal, center, radius, up)
                end = out
                normal = outward
        if wp.static(has_ground):
            if moves:
                out, outward = above_ground(end, normal, up, ground[0])
                end = out
                normal = outward
        return end, normal

    @wp.func
    def swelling_of_balloon(sums: wp.uint64, balloon: wp.int32, mine: Swelling, lane: wp.int32):
        """How a thread's balloon swells, of what each thread adds to its own; by all threads of the block."""
        for each in range(balloon_count):
            first = each * balloon_sums + lane // WARP_THREADS * NUMBERS_OF_WARP
            put_warp_sums(sums, first, wp.where(each == balloon, mine, Swelling()))
        block_barrier()
        swelling = Swelling()
        for each in range(balloon_count):
            total = sum_of_warp_sums(sums, each * balloon_sums, warps)
            swelling = wp.where(each == balloon, total, swelling)
        return swelling

    @wp.func
    def advance_substep(
        bodies: BodyTable,
        strings: StringTable,
        air: AirTable,
        board: wp.uint64,
        world: wp.int32,
        lane: wp.int32,
        ground: wp.vec2,
        substep: wp.int32,
        step_seconds: float,
        body: Body,
        springs: Springs,
        source: Any,
        # in and out
        amount: wp.float64,
        load: wp.vec3,
        point: wp.vec3,
        velocity: wp.vec3,
        target: Any,
        sums: wp.uint64,
    ):
        """One substep, from one tile of points to the other."""
        time = float(substep) * step_seconds
        if air.kind[body.balloon] == GAS:
            pumped = step_seconds * (body.ramp[0] + body.ramp[1] * (time + 0.5 * step_seconds))
            amount = wp.max(amount + wp.float64(pumped), wp.float64(0.0))
        inertia = body.mass + body.share * float(amount) * body.molar_mass
        reaction = response(inertia, step_seconds)
        moves = reaction > 0.0
        area_vector = ring_area_vector(source, point, springs, body.valence)
        drag = air_drag(body.air_density, body.drag_coefficient, body.wind, area_vector, velocity)
        force = body.upward * bodies.up - body.damping * velocity + drag + pull_of_slots(source, point, springs)
        if wp.static(has_strings):
            force += pull_of_strings(strings, point, world, body.number)
        velocity += reaction * force
        height = wp.dot(point, bodies.up)
        push = load[1] + load[2] * height
        end, normal = beside_obstacles(
            board, bodies.up, ground, substep, step_seconds, lane, moves,
            point + step_seconds * (velocity + reaction * push * area_vector),
        )  # fmt: skip
        part = swelling_of_particle(
            area_vector, (end - point) / step_seconds, normal, inertia, body.share, height, push, step_seconds
        )
        part[VOLUME] = wp.dot(point - source[body.origin], area_vector) / 3.0
        if not body.active:
            part = Swelling()
        swelling = swelling_of_balloon(sums, body.balloon, part, lane)
        load = load_of_balloon(air, bodies, body.ramp, amount, swelling, world, body.balloon, time, step_seconds)
        inflation = (load[1] + load[2] * height) * area_vector
        velocity += reaction * inflation
        point += step_seconds * velocity
        for sphere in range(sphere_count):
            center, motion, radius = sphere_now(board, sphere, substep)
            meets = moves and wp.length_sq(point - center) < radius * radius
            if any_in_warp(meets):
                penalty = wp.vec3()
                if meets:
                    left, slowed, outward = leave_sphere(point, velocity, center, motion, radius, bodies.up)
                    point = left
                    velocity = slowed
                    penalty = penalty_force(penalty_of(board, sphere), inflation, outward)
                post_force(board, sphere, substep, lane, penalty)
        if wp.static(has_ground):
            if moves and wp.dot(point, bodies.up) < ground[0]:
                stood, slowed = leave_ground(point, velocity, bodies.up, ground[0], ground[1])
                point = stood
                velocity = slowed
        put(target, lane, point)
        block_barrier()
        return amount, load, point, velocity, area_vector

    @wp.kernel(
        module="unique",
        enable_backward=False,
        cuda_max_registers=max_registers,
        module_options={"fast_math": True, "max_unroll": 128},
    )
    def advance_resident_in_air(
        # model
        bodies: BodyTable,
        strings: StringTable,
        obstacles: ObstacleTable,
        air: AirTable,
        slot_table: SlotTable,
        health: HealthTable,
        substeps: wp.int32,
        step_seconds: float,
        # state in and out
        state: WorldState,
    ):
        """A block a world, a particle a thread: one frame."""
        world, lane = wp.tid()
        even = wp.tile_empty(shape=threads, dtype=wp.vec3, storage="shared")
        odd = wp.tile_empty(shape=threads, dtype=wp.vec3, storage="shared")
        sums = shared_sums()
        board = wp.uint64(0)
        if wp.static(sphere_count > 0):
            board = sphere_board()
            begin_spheres(board, bodies, obstacles, state, world, lane)
        ground = wp.vec2(ground_height(obstacles, world), ground_friction(obstacles, world))
        body = read_body(bodies, air, slot_table, state, world, lane)
        springs = read_springs(slot_table, world, body.balloon, body.number)
        point = state.points[world, body.number]
        velocity = state.velocities[world, body.number]
        amount = state.gas_amounts[world, body.balloon]
        old_load = state.inflation_loads[world, body.balloon]
        load = wp.vec3(0.0, old_load[0], old_load[1])
        area_vector = wp.vec3()
        put(even, lane, point)
        block_barrier()
        for pair in range(substeps // 2):
            amount, load, point, velocity, area_vector = advance_substep(
                bodies, strings, air, board, world, lane, ground, 2 * pair, step_seconds, body, springs, even,
                amount, load, point, velocity, odd, sums,
            )  # fmt: skip
            amount, load, point, velocity, area_vector = advance_substep(
                bodies, strings, air, board, world, lane, ground, 2 * pair + 1, step_seconds, body, springs, odd,
                amount, load, point, velocity, even, sums,
            )  # fmt: skip
        if wp.static(odd_substeps):
            amount, load, point, velocity, area_vector = advance_substep(
                bodies, strings, air, board, world, lane, ground, substeps - 1, step_seconds, body, springs, even,
                amount, load, point, velocity, odd, sums,
            )  # fmt: skip
        if body.active:
            state.points[world, body.number] = point
            state.velocities[world, body.number] = velocity
            state.inflation_aims[world, body.number] = area_vector
            if wp.static(odd_substeps):
                look_at_particle(bodies, health, state.first_bad, world, body.number, point, odd, 0)
            else:
                look_at_particle(bodies, health, state.first_bad, world, body.number, point, even, 0)
            if body.number == body.origin:
                state.gas_amounts[world, body.balloon] = amount
                keep_load(state, world, body.balloon, load)
        count_frame_in_block(state, world, lane)
        if wp.static(sphere_count > 0):
            end_spheres(board, health, state, world, substeps - 1, lane)

    return advance_resident_in_air

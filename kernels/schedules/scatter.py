"""The `scatter` schedule: a thread a spring, a string, a hinge, a face or a particle, with atomic adds into one array
of forces. The readable reference, which every other schedule is tested against."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.laws.torsion import FIRST_WING
from balloon_warp.kernels.loops.areas import area_vector_of_corner
from balloon_warp.kernels.loops.faces import face_push
from balloon_warp.kernels.loops.hinges import hinge_force, wing_size
from balloon_warp.kernels.loops.springs import constant_of_kind
from balloon_warp.kernels.loops.strings import string_pull
from balloon_warp.kernels.loops.wetness import wetness_loop
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.own import numbers_reader, own_functions
from balloon_warp.kernels.schedules.launched import Working, inertia_function
from balloon_warp.kernels.substep import kick, time_of
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


@cache
def spring_kernel(traits: Traits) -> Any:
    """The kernel of the springs."""
    coefficient = traits.laws_on("spring")
    read_numbers = numbers_reader(traits.columns)

    @wp.kernel(module="unique")
    def add_spring_forces(
        # model
        t: Tables,
        frame: wp.array[wp.int32],
        time_in_frame: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        forces: wp.array2d[wp.vec3],
    ):
        """A thread a (world, spring): equal and opposite forces on its two particles."""
        world, spring = wp.tid()
        time = time_of(t, frame, time_in_frame)
        p = t.pairs.particles[spring][0]
        q = t.pairs.particles[spring][1]
        n = read_numbers(t, world, t.particles.balloon[p])
        stiffness = constant_of_kind(n, t.pairs.kinds[spring]) * t.pairs.scales[spring]
        length = t.pairs.rest_lengths[spring]
        d = points[world, q] - points[world, p]
        opening = wp.dot(velocities[world, q] - velocities[world, p], d)
        force = d * coefficient(
            squared_length(d), opening, length, stiffness, stiffness * length, t.step_seconds, time, n
        )
        wp.atomic_add(forces, world, p, force)
        wp.atomic_sub(forces, world, q, force)

    return add_spring_forces


@cache
def string_kernel(traits: Traits) -> Any:
    """The kernel of the strings."""
    pull_of_string = string_pull(traits)
    read_numbers = numbers_reader(traits.columns)

    @wp.kernel(module="unique")
    def add_string_forces(
        # model
        t: Tables,
        frame: wp.array[wp.int32],
        time_in_frame: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        forces: wp.array2d[wp.vec3],
    ):
        """A thread a (world, string): its pull on its particle."""
        world, held = wp.tid()
        time = time_of(t, frame, time_in_frame)
        p = t.strings.particles[held]
        n = read_numbers(t, world, t.particles.balloon[p])
        pull = pull_of_string(
            t.strings, world, t.strings.order[held], points[world, p], velocities[world, p], n, t.step_seconds, time
        )
        wp.atomic_add(forces, world, p, pull)

    return add_string_forces


@cache
def hinge_kernel(traits: Traits) -> Any:
    """The kernel of the hinges."""
    force_at_role = hinge_force(traits, vector_at)
    read_numbers = numbers_reader(traits.columns)

    @wp.kernel(module="unique")
    def add_hinge_forces(
        # model
        t: Tables,
        # state in
        points: wp.array2d[wp.vec3],
        # out
        forces: wp.array2d[wp.vec3],
    ):
        """A thread a (world, hinge): forces on its two ends and on the corners of its wings."""
        world, hinge = wp.tid()
        p = t.hinges.ends[hinge][0]
        q = t.hinges.ends[hinge][1]
        n = read_numbers(t, world, t.particles.balloon[p])
        wp.atomic_add(forces, world, p, force_at_role(t.hinges, points[world], hinge, 0, n))
        wp.atomic_add(forces, world, q, force_at_role(t.hinges, points[world], hinge, 1, n))
        for wing in range(2):
            share = force_at_role(t.hinges, points[world], hinge, FIRST_WING + wing, n)
            begin = t.hinges.wing_offsets[2 * hinge + wing]
            for corner in range(begin, begin + wing_size(t.hinges, hinge, wing)):
                wp.atomic_add(forces, world, t.hinges.wing_particles[corner], share)

    return add_hinge_forces


@cache
def face_kernel(traits: Traits) -> Any:
    """The kernel of laws on faces."""
    push_at_corner = face_push(traits, vector_at, vector_at)
    read_numbers = numbers_reader(traits.columns)

    @wp.kernel(module="unique")
    def add_face_forces(
        # model
        t: Tables,
        frame: wp.array[wp.int32],
        time_in_frame: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        forces: wp.array2d[wp.vec3],
    ):
        """A thread a (world, face): its force, shared by its corners."""
        world, face = wp.tid()
        time = time_of(t, frame, time_in_frame)
        n = read_numbers(t, world, t.faces.balloon[face])
        share = push_at_corner(t, points[world], velocities[world], face, n, time)
        for corner in range(t.faces.offsets[face], t.faces.offsets[face + 1]):
            wp.atomic_add(forces, world, t.faces.particles[corner], share)

    return add_face_forces


@wp.kernel
def add_area_vectors(
    # model
    t: Tables,
    # state in
    points: wp.array2d[wp.vec3],
    # out
    area_vectors: wp.array2d[wp.vec3],
):
    """A thread a (world, face): its parts of its particles' area vectors."""
    world, face = wp.tid()
    begin = t.faces.offsets[face]
    end = t.faces.offsets[face + 1]
    count = end - begin
    for corner in range(count):
        particle = t.faces.particles[begin + corner]
        point = points[world, particle]
        first = points[world, t.faces.particles[begin + (corner + 1) % count]] - point
        arm = first
        arms = first
        double_area = wp.vec3()
        for further in range(2, count):
            next_arm = points[world, t.faces.particles[begin + (corner + further) % count]] - point
            double_area += wp.cross(arm, next_arm)
            arms += next_arm
            arm = next_arm
        part = area_vector_of_corner(double_area, first - arm, arms, float(count))
        wp.atomic_add(area_vectors, world, particle, part)


@cache
def particle_kernel(traits: Traits) -> Any:
    """The kernel of what acts on particles by themselves, which comes last."""
    _, read_own = own_functions(traits.columns)
    particle_laws = traits.laws_on("particle")
    inertia = inertia_function(traits)
    load_of_particle = wetness_loop(vector_at)
    level_column = traits.columns.places.get("water_level", 0)

    @wp.kernel(module="unique")
    def add_particle_forces(
        # model
        t: Tables,
        frame: wp.array[wp.int32],
        time_in_frame: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        working: Working,
        # out
        forces: wp.array2d[wp.vec3],
        new_velocities: wp.array2d[wp.vec3],
    ):
        """A thread a (world, particle): the last forces but the inflation, and the velocity after all of them."""
        world, particle = wp.tid()
        time = time_of(t, frame, time_in_frame)
        own = read_own(t, world, particle)
        velocity = velocities[world, particle]
        area_vector = wp.vec3()
        if wp.static(traits.measures_areas):
            area_vector = working.area_vectors[world, particle]
        water_load = wp.vec4()
        if wp.static(traits.in_water):
            water_load = load_of_particle(t.faces, points[world], particle, own.n[level_column], t.up)
        force = forces[world, particle] + particle_laws(
            points[world, particle], velocity, own.mass, own.share, area_vector, water_load,
            t.up, t.step_seconds, time, own.n,
        )  # fmt: skip
        forces[world, particle] = force
        new_velocities[world, particle] = kick(velocity, force, inertia(working, own), t.step_seconds)

    return add_particle_forces

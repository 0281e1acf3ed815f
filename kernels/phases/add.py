"""Forces of springs, strings, hinges, triangles and faces, by atomic adds into one array that particles take.

The readable reference, which every other way is tested against.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.torsion import FIRST_WING
from balloon_warp.kernels.loops.areas import area_vector_of_corner
from balloon_warp.kernels.loops.faces import face_push
from balloon_warp.kernels.loops.hinges import hinge_forces, wing_size
from balloon_warp.kernels.loops.membranes import material_reader, triangle_pull, wear_reader
from balloon_warp.kernels.loops.springs import pair_pull
from balloon_warp.kernels.loops.strings import held_string_pull
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.working import Working


@cache
def line_functions(traits: Traits) -> tuple[Any, Any]:
    """Make the functions that add what a spring, and a string, do to a world's forces."""
    pull_of_pair, pull_of_held_string = pair_pull(traits), held_string_pull(traits)

    @wp.func
    def add_spring(
        t: Tables, world: wp.int32, spring: wp.int32, points: Any, velocities: Any, time: float, forces: Any
    ):
        """Add a spring's equal and opposite forces to its two particles."""
        d, coefficient = pull_of_pair(t, world, spring, points, velocities, time)
        wp.atomic_add(forces, t.pairs.particles[spring][0], d * coefficient)
        wp.atomic_sub(forces, t.pairs.particles[spring][1], d * coefficient)

    @wp.func
    def add_string(t: Tables, world: wp.int32, held: wp.int32, points: Any, velocities: Any, time: float, forces: Any):
        """Add a string's force to its particle."""
        pull = pull_of_held_string(t, world, held, points, velocities, time)
        wp.atomic_add(forces, t.strings.particles[held], pull)

    return add_spring, add_string


@cache
def hinge_function(traits: Traits, at: Any, add: Any) -> Any:
    """Make the function that adds what a hinge does.

    Args:
        at: the function that reads a point.
        add: the one that adds a force to a particle's.
    """
    forces_of_hinge, read_numbers = hinge_forces(traits, at), numbers_reader(traits.columns)

    @wp.func
    def add_hinge(t: Tables, world: wp.int32, hinge: wp.int32, points: Any, forces: Any):
        """Add forces on its two ends and on the corners of its wings."""
        ends = t.hinges.ends[hinge]
        of_roles = forces_of_hinge(t.hinges, points, hinge, read_numbers(t, world, t.particles.balloon[ends[0]]))
        add(forces, ends[0], of_roles[0])
        add(forces, ends[1], of_roles[1])
        for wing in range(2):
            begin = t.hinges.wing_offsets[2 * hinge + wing]
            for corner in range(begin, begin + wing_size(t.hinges, hinge, wing)):
                add(forces, t.hinges.wing_particles[corner], of_roles[FIRST_WING + wing])

    return add_hinge


@cache
def surface_functions(traits: Traits, at: Any) -> tuple[Any, Any]:
    """Make the functions that add what a triangle of a membrane, and a face do to a world's forces.

    Args:
        at: the function that reads a point.
    """
    push_at_corner = face_push(traits, at, vector_at)
    read_numbers = numbers_reader(traits.columns)
    pull_of_triangle = triangle_pull(traits) if traits.membranes else None
    material_of, left_of = material_reader(traits), wear_reader(traits)

    @wp.func
    def add_triangle(t: Tables, world: wp.int32, triangle: wp.int32, points: Any, velocities: Any, forces: Any):
        """Add a membrane triangle's forces to its three corners."""
        corners = t.membranes.corners[triangle]
        p = corners[0]
        balloon = t.particles.balloon[p]
        n = read_numbers(t, world, balloon)
        pull, first, second = pull_of_triangle(
            points[corners[1]] - points[p], points[corners[2]] - points[p],
            velocities[corners[1]] - velocities[p], velocities[corners[2]] - velocities[p],
            t.membranes.corner_rests[triangle], material_of(t.membranes, balloon), n,
        )  # fmt: skip
        if wp.static(traits.wears):
            left = left_of(t.membranes, world, triangle)
            pull *= left
            first *= left
            second *= left
        wp.atomic_add(forces, p, pull)
        wp.atomic_add(forces, corners[1], first)
        wp.atomic_add(forces, corners[2], second)

    @wp.func
    def add_face(t: Tables, world: wp.int32, face: wp.int32, points: Any, velocities: Any, time: float, forces: Any):
        """Add a face's force to its corners, in equal shares."""
        share = push_at_corner(t, points, velocities, world, face, time)
        for corner in range(t.faces.offsets[face], t.faces.offsets[face + 1]):
            wp.atomic_add(forces, t.faces.particles[corner], share)

    return add_triangle, add_face


@phase("element")
def add_forces(traits: Traits, look: Look) -> Any:
    """Add what a spring, or string, or hinge, or triangle, or face does to its particles, in this order."""
    add_spring, add_string = line_functions(traits)
    add_hinge = hinge_function(traits, look.at, look.add)
    add_triangle, add_face = surface_functions(traits, look.at)

    @wp.func
    def add_forces(
        t: Tables, working: Working, points: Any, velocities: Any, world: wp.int32, element: wp.int32, time: float
    ):
        forces = working.forces[world]
        first_string = t.pairs.kinds.shape[0]
        first_hinge = first_string + t.strings.particles.shape[0]
        first_triangle = first_hinge + t.hinges.ends.shape[0]
        first_face = first_triangle + t.membranes.corners.shape[0]
        if element < first_string:
            add_spring(t, world, element, points, velocities, time, forces)
        elif element < first_hinge:
            if wp.static(traits.has("string")):
                add_string(t, world, element - first_string, points, velocities, time, forces)
        elif element < first_triangle:
            if wp.static(traits.has("hinge")):
                add_hinge(t, world, element - first_hinge, points, forces)
        elif element < first_face:
            if wp.static(bool(traits.membranes)):
                add_triangle(t, world, element - first_triangle, points, velocities, forces)
        else:
            if wp.static(traits.has("face")):
                add_face(t, world, element - first_face, points, velocities, time, forces)

    return add_forces


@wp.func
def add_area_vectors_of_face(t: Tables, working: Working, points: wp.array[wp.vec3], world: wp.int32, face: wp.int32):
    """Add a face's contributions to the area vectors of its particles."""
    begin = t.faces.offsets[face]
    end = t.faces.offsets[face + 1]
    count = end - begin
    for corner in range(count):
        particle = t.faces.particles[begin + corner]
        point = points[particle]
        first = points[t.faces.particles[begin + (corner + 1) % count]] - point
        arm = first
        arms = first
        double_area = wp.vec3()
        for further in range(2, count):
            next_arm = points[t.faces.particles[begin + (corner + further) % count]] - point
            double_area += wp.cross(arm, next_arm)
            arms += next_arm
            arm = next_arm
        part = area_vector_of_corner(double_area, first - arm, arms, float(count))
        wp.atomic_add(working.area_vectors, world, particle, part)


@phase("face", when=lambda traits: traits.measures_areas)
def add_area_vectors(traits: Traits, look: Look) -> Any:
    """Add a face's parts of the area vectors of its particles."""
    return add_area_vectors_of_face

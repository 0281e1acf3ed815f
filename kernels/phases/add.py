"""Forces of springs, strings, hinges, triangles and faces, by atomic adds into one array that particles take.

The readable reference, which every other way is tested against.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.torsion import FIRST_WING
from balloon_warp.kernels.loops.areas import corner_area
from balloon_warp.kernels.loops.faces import face_push
from balloon_warp.kernels.loops.hinges import hinge_forces, wing_size
from balloon_warp.kernels.loops.membranes import triangle_pull
from balloon_warp.kernels.loops.springs import pair_pull
from balloon_warp.kernels.loops.strings import held_string_pull
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working


@cache
def hinge_function(features: Features, at: Any, add: Any) -> Any:
    """Make the function that adds the forces of a hinge.

    Args:
        at: the function that reads a point.
        add: the one that adds a force to a particle's.
    """
    forces_of_hinge, read_numbers = hinge_forces(features, at), numbers_reader(features.columns)

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
def surface_functions(features: Features, at: Any) -> tuple[Any, Any]:
    """Make the functions that add the forces of a membrane's triangle, and of a face, to a world's."""
    push_at_corner = face_push(features, at, vector_at)
    read_numbers = numbers_reader(features.columns)
    pull_of_triangle = triangle_pull(features) if features.membranes else None

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
            t.membranes.corner_rests[triangle], t.membranes.materials[balloon], n,
        )  # fmt: skip
        if wp.static(features.wears):
            left = t.membranes.wear.left[world, triangle]
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
def add_forces(features: Features, look: Look) -> Any:
    """Add the forces of a spring, or string, or hinge, or triangle, or face on its particles, in this order."""
    add_hinge = hinge_function(features, look.at, look.add)
    add_triangle, add_face = surface_functions(features, look.at)
    pull_of_pair, pull_of_held_string = pair_pull(features), held_string_pull(features)

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
            if wp.static(features.has("string")):
                add_string(t, world, element - first_string, points, velocities, time, forces)
        elif element < first_triangle:
            if wp.static(features.has("hinge")):
                add_hinge(t, world, element - first_hinge, points, forces)
        elif element < first_face:
            if wp.static(bool(features.membranes)):
                add_triangle(t, world, element - first_triangle, points, velocities, forces)
        else:
            if wp.static(features.has("face")):
                add_face(t, world, element - first_face, points, velocities, time, forces)

    return add_forces


area_vector_at_corner = corner_area(vector_at)


@wp.func
def add_area_vectors_of_face(t: Tables, working: Working, points: wp.array[wp.vec3], world: wp.int32, face: wp.int32):
    """Add a face's contributions to the area vectors of its particles."""
    for corner in range(t.faces.offsets[face + 1] - t.faces.offsets[face]):
        particle = t.faces.particles[t.faces.offsets[face] + corner]
        part = area_vector_at_corner(t, points, face, corner, points[particle])
        wp.atomic_add(working.area_vectors, world, particle, part)


@phase("face", when=lambda features: features.measures_areas)
def add_area_vectors(features: Features, look: Look) -> Any:
    """Add a face's parts of the area vectors of its particles."""
    return add_area_vectors_of_face

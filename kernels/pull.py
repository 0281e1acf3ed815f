"""What a particle's springs and strings sum to, for schedules in which a particle gathers its own forces."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contiguous import float_at, int_at, vector_at
from balloon_warp.kernels.springs import rubber_coefficient, spring_coefficient, squared_length, string_coefficient
from balloon_warp.kernels.tables import (
    CHUNK,
    SLICE,
    HingeTable,
    SpringTable,
    StringTable,
    first_entry,
    row_of_world,
    spring_constants,
    spring_viscosity,
    spring_yield,
)
from balloon_warp.kernels.torsion import share_of_role, torsion_force, torsion_stiffness, wing_size
from balloon_warp.kernels.traits import Traits


@wp.func
def kind_constant(constants: wp.vec3, kind: wp.int32):
    """`constants[kind]`, without the memory that an index needs."""
    return wp.where(kind == 0, constants[0], wp.where(kind == 1, constants[1], constants[2]))


@cache
def hinge_puller(point_at: Any) -> Any:
    """The function that sums the torsion springs at a particle. Arguments as for `spring_puller`."""

    @wp.func
    def wing_at(hinges: HingeTable, points: Any, first: wp.int32, hinge: wp.int32, wing: wp.int32):
        """Where a wing is."""
        total = wp.vec3()
        for corner in range(hinges.wing_offsets[2 * hinge + wing], hinges.wing_offsets[2 * hinge + wing + 1]):
            total += point_at(points, first + hinges.wing_particles[corner])
        return total / float(wing_size(hinges, hinge, wing))

    @wp.func
    def pull_of_hinges(
        hinges: HingeTable, points: Any, first: wp.int32, world: wp.int32, balloon: wp.int32, particle: wp.int32
    ):
        """Net force of the hinges that a particle belongs to [N]; particle p stands at `points[first + p]`."""
        force = wp.vec3()
        stiffness = torsion_stiffness(hinges, world, balloon)
        for entry in range(hinges.particle_offsets[particle], hinges.particle_offsets[particle + 1]):
            hinge = hinges.particle_roles[entry] >> 2
            role = hinges.particle_roles[entry] & 3
            force += torsion_force(
                role,
                point_at(points, first + hinges.ends[hinge][0]),
                point_at(points, first + hinges.ends[hinge][1]),
                wing_at(hinges, points, first, hinge, 0),
                wing_at(hinges, points, first, hinge, 1),
                hinges.rest_angles[hinge],
                share_of_role(hinges, hinge, role) * stiffness,
            )
        return force

    return pull_of_hinges


@cache
def spring_puller(traits: Traits, point_at: Any) -> Any:
    """The function that sums a particle's springs; without the scales if they are all 1, and without looking at
    velocities if no spring is viscous.

    Args:
        point_at: the function that reads a point, of an array or a tile.
    """

    pull_of_hinges = hinge_puller(point_at)

    @wp.func
    def pull_of_springs(
        springs: SpringTable,
        points: Any,
        first: wp.int32,
        velocities: wp.array[wp.vec3],
        point: wp.vec3,
        velocity: wp.vec3,
        world: wp.int32,
        balloon: wp.int32,
        particle: wp.int32,
    ):
        """Net force of a particle's springs [N]; particle p stands at `points[first + p]`, and moves at
        `velocities[p]`."""
        force = wp.vec3()
        if wp.static(traits.rubber):
            viscosity = spring_viscosity(springs, world, balloon)
            yield_stretch = spring_yield(springs, world, balloon)
        constants = spring_constants(springs, world, balloon)
        begin = first_entry(springs, particle)
        for chunk in range(begin, begin + SLICE * springs.valences[particle], SLICE * CHUNK):
            for slot in range(CHUNK):
                entry = chunk + SLICE * slot
                scale = float(1.0)
                if wp.static(traits.springs_vary):
                    scale = float_at(springs.scales, entry)
                end = int_at(springs.ends, entry)
                length = float_at(springs.rest_lengths, entry)
                d = point_at(points, first + (end >> 2)) - point
                if wp.static(traits.rubber):
                    opening = wp.dot(vector_at(velocities, end >> 2) - velocity, d)
                    coefficient = rubber_coefficient(
                        squared_length(d), opening, scale, length, viscosity, yield_stretch
                    )
                else:
                    coefficient = spring_coefficient(squared_length(d), scale, length)
                force += kind_constant(constants, end & 3) * coefficient * d
        if wp.static(traits.torsion):
            force += pull_of_hinges(springs.hinges, points, first, world, balloon, particle)
        return force

    return pull_of_springs


@wp.func
def pull_of_strings(strings: StringTable, point: wp.vec3, world: wp.int32, particle: wp.int32):
    """Net force of the strings that hold a particle [N]."""
    force = wp.vec3()
    if strings.offsets.shape[0] > 0:
        for held in range(strings.offsets[particle], strings.offsets[particle + 1]):
            string = strings.order[held]
            d = strings.anchors[row_of_world(world, strings.anchors.shape[0]), string] - point
            length = strings.lengths[row_of_world(world, strings.lengths.shape[0]), string]
            stiffness = strings.stiffness[row_of_world(world, strings.stiffness.shape[0]), string]
            force += string_coefficient(squared_length(d), stiffness, length) * d
    return force

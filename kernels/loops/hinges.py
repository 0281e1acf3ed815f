"""The hinges that a particle belongs to: as an end of the edge, or as a corner beside it, in a wing."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.torsion import FIRST_WING, angle_beyond
from balloon_warp.kernels.tables import HingeTable


@wp.func
def wing_size(hinges: HingeTable, hinge: wp.int32, wing: wp.int32):
    """Return the corners of a hinge's first (0) or second (1) wing."""
    return hinges.wing_offsets[2 * hinge + wing + 1] - hinges.wing_offsets[2 * hinge + wing]


Places = wp.types.matrix(shape=(4, 3), dtype=wp.float32)
"""Vector for each of a hinge's four roles, a row each"""


@cache
def place_function(at: Any) -> Any:
    """Return the function that returns the positions of a hinge's ends and wings."""

    @wp.func
    def wing_of_hinge(hinges: HingeTable, points: Any, hinge: wp.int32, wing: wp.int32):
        """Return the position of a wing: the mean of its corners."""
        total = wp.vec3()
        for corner in range(hinges.wing_offsets[2 * hinge + wing], hinges.wing_offsets[2 * hinge + wing + 1]):
            total += at(points, hinges.wing_particles[corner])
        return total / float(wing_size(hinges, hinge, wing))

    @wp.func
    def places_of_hinge(hinges: HingeTable, points: Any, hinge: wp.int32):
        """Return the positions of a hinge's ends and wings [m]."""
        ends = hinges.ends[hinge]
        return (
            at(points, ends[0]),
            at(points, ends[1]),
            wing_of_hinge(hinges, points, hinge, 0),
            wing_of_hinge(hinges, points, hinge, 1),
        )

    return places_of_hinge


@cache
def hinge_forces(features: Features, at: Any) -> Any:
    """Return the function for the forces at all places of a hinge, whose angle is found once."""
    laws = features.laws_on("hinge")
    places_of_hinge = place_function(at)

    @wp.func
    def forces_of_hinge(hinges: HingeTable, points: Any, hinge: wp.int32, n: Any):
        """Return the force on a particle of each role, a row each [N]."""
        a, b, first, second = places_of_hinge(hinges, points, hinge)
        bend = angle_beyond(a, b, first, second, hinges.rest_angles[hinge])
        forces = Places()
        for role in range(4):
            force = laws(role, a, b, first, second, bend, n)
            if role >= FIRST_WING:
                force /= float(wing_size(hinges, hinge, role - FIRST_WING))
            forces[role] = force
        return forces

    return forces_of_hinge


@cache
def hinge_loop(features: Features, at: Any) -> Any:
    """Return the function that sums a particle's hinges."""
    laws = features.laws_on("hinge")
    places_of_hinge = place_function(at)

    @wp.func
    def force_at_role(hinges: HingeTable, points: Any, hinge: wp.int32, role: wp.int32, n: Any):
        """Force on a particle that has this role in a hinge [N]; the corners of a wing share theirs."""
        a, b, first, second = places_of_hinge(hinges, points, hinge)
        bend = angle_beyond(a, b, first, second, hinges.rest_angles[hinge])
        force = laws(role, a, b, first, second, bend, n)
        if role >= FIRST_WING:
            force /= float(wing_size(hinges, hinge, role - FIRST_WING))
        return force

    @wp.func
    def pull_of_hinges(hinges: HingeTable, points: Any, particle: wp.int32, n: Any):
        """Return the net force of a particle's hinges [N]."""
        force = wp.vec3()
        for entry in range(hinges.particle_offsets[particle], hinges.particle_offsets[particle + 1]):
            role = hinges.particle_roles[entry]
            force += force_at_role(hinges, points, role >> 2, role & 3, n)
        return force

    return pull_of_hinges

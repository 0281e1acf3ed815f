"""The hinges that a particle belongs to: as an end of the edge, or as a corner beside it, in a wing."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.torsion import FIRST_WING
from balloon_warp.kernels.tables import HingeTable
from balloon_warp.kernels.traits import Traits


@wp.func
def wing_size(hinges: HingeTable, hinge: wp.int32, wing: wp.int32):
    """Corners of a hinge's first (0) or second (1) wing."""
    return hinges.wing_offsets[2 * hinge + wing + 1] - hinges.wing_offsets[2 * hinge + wing]


@cache
def hinge_force(traits: Traits, at: Any) -> Any:
    """The function that gives the force at one place of a hinge."""
    laws = traits.laws_on("hinge")

    @wp.func
    def wing_of_hinge(hinges: HingeTable, points: Any, hinge: wp.int32, wing: wp.int32):
        """Where a wing is: the mean of its corners."""
        total = wp.vec3()
        for corner in range(hinges.wing_offsets[2 * hinge + wing], hinges.wing_offsets[2 * hinge + wing + 1]):
            total += at(points, hinges.wing_particles[corner])
        return total / float(wing_size(hinges, hinge, wing))

    @wp.func
    def force_at_role(hinges: HingeTable, points: Any, hinge: wp.int32, role: wp.int32, n: Any):
        """Force on a particle that has this role in a hinge [N]; the corners of a wing share theirs."""
        ends = hinges.ends[hinge]
        force = laws(
            role,
            at(points, ends[0]),
            at(points, ends[1]),
            wing_of_hinge(hinges, points, hinge, 0),
            wing_of_hinge(hinges, points, hinge, 1),
            hinges.rest_angles[hinge],
            n,
        )
        if role >= FIRST_WING:
            force /= float(wing_size(hinges, hinge, role - FIRST_WING))
        return force

    return force_at_role


@cache
def hinge_loop(traits: Traits, at: Any) -> Any:
    """The function that sums a particle's hinges."""
    force_at_role = hinge_force(traits, at)

    @wp.func
    def pull_of_hinges(hinges: HingeTable, points: Any, particle: wp.int32, n: Any):
        """Net force of a particle's hinges [N]."""
        force = wp.vec3()
        for entry in range(hinges.particle_offsets[particle], hinges.particle_offsets[particle + 1]):
            role = hinges.particle_roles[entry]
            force += force_at_role(hinges, points, role >> 2, role & 3, n)
        return force

    return pull_of_hinges

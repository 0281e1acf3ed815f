"""Torsion springs in eight worlds side by side."""

import warp as wp

from balloon_warp.kernels.lanes_state import TORSION
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3, column, set_column
from balloon_warp.kernels.tables import HingeTable
from balloon_warp.kernels.torsion import share_of_role, torsion_force, wing_size


@wp.func
def wing_lanes(hinges: HingeTable, points: wp.array[Lanes3], hinge: wp.int32, wing: wp.int32):
    """Where a wing is in each world."""
    total = Lanes3()
    for corner in range(hinges.wing_offsets[2 * hinge + wing], hinges.wing_offsets[2 * hinge + wing + 1]):
        total += points[hinges.wing_particles[corner]]
    return total / float(wing_size(hinges, hinge, wing))


@wp.func
def pull_of_hinge_lanes(hinges: HingeTable, numbers: wp.array[Lanes], points: wp.array[Lanes3], particle: wp.int32):
    """Net force of the hinges that a particle belongs to, in each world [N]."""
    forces = Lanes3()
    constants = numbers[TORSION]
    for entry in range(hinges.particle_offsets[particle], hinges.particle_offsets[particle + 1]):
        hinge = hinges.particle_roles[entry] >> 2
        role = hinges.particle_roles[entry] & 3
        ends = hinges.ends[hinge]
        a = points[ends[0]]
        b = points[ends[1]]
        first = wing_lanes(hinges, points, hinge, 0)
        second = wing_lanes(hinges, points, hinge, 1)
        share = share_of_role(hinges, hinge, role)
        for lane in range(LANE_COUNT):
            force = torsion_force(
                role, column(a, lane), column(b, lane), column(first, lane), column(second, lane),
                hinges.rest_angles[hinge], share * constants[lane],
            )  # fmt: skip
            forces = set_column(forces, lane, column(forces, lane) + force)
    return forces

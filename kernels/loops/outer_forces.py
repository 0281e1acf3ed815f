"""Outer forces on a particle, as the scene or a control says them."""

import warp as wp

from balloon_warp.kernels.outer_tables import ForceTable
from balloon_warp.kernels.tables import row_of_world


@wp.func
def outer_force(forces: ForceTable, world: wp.int32, particle: wp.int32):
    """Return a particle's shares in the forces that drive it, added up [N]."""
    total = wp.vec3()
    row = row_of_world(world, forces.newtons.shape[0])
    for slot in range(0, forces.slots.shape[1], 2):
        share = forces.slots[particle, slot]
        if share > 0.0:
            total += share * forces.newtons[row, wp.int32(forces.slots[particle, slot + 1])]
    return total

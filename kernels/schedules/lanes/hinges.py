"""Hinges in lanes: the forces at all places of each, found once, wait for the particles that have a role in it."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import Lanes3, set_lane
from balloon_warp.kernels.loops.hinges import hinge_forces
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.schedules.lanes.layouts import Layout, places_of, view_of
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.traits import Traits


@cache
def bend_function(traits: Traits, layout: Layout) -> Any:
    """The function that finds the forces of all hinges of a group of worlds, or of a world."""
    LaneTables, _, _ = lane_structs(layout)  # noqa: N806 - a type
    places = places_of(layout)
    forces_of_hinge = hinge_forces(traits, places.seen)
    read_numbers = numbers_reader(traits.columns)

    @wp.func
    def forces_in_lane(t: LaneTables, group: wp.int32, hinge: wp.int32, lane: wp.int32, points: Any):
        """On a particle of each role [N], one a row."""
        balloon = t.all.particles.balloon[t.all.hinges.ends[hinge][0]]
        n = read_numbers(t.all, places.world(group, lane, t.world_count), balloon)
        return forces_of_hinge(t.seen.hinges, view_of(points, lane), hinge, n)

    @wp.func
    def bend(t: LaneTables, group: wp.int32, points: Any):
        for hinge in range(t.seen.hinges.rest_angles.shape[0]):
            if wp.static(layout.worlds):
                of_roles_0, of_roles_1, of_roles_2, of_roles_3 = Lanes3(), Lanes3(), Lanes3(), Lanes3()
                for lane in range(t.lane_count):
                    forces = forces_in_lane(t, group, hinge, lane, points)
                    of_roles_0 = set_lane(of_roles_0, lane, forces[0])
                    of_roles_1 = set_lane(of_roles_1, lane, forces[1])
                    of_roles_2 = set_lane(of_roles_2, lane, forces[2])
                    of_roles_3 = set_lane(of_roles_3, lane, forces[3])
                t.hinge_forces[group, 4 * hinge] = of_roles_0
                t.hinge_forces[group, 4 * hinge + 1] = of_roles_1
                t.hinge_forces[group, 4 * hinge + 2] = of_roles_2
                t.hinge_forces[group, 4 * hinge + 3] = of_roles_3
            else:
                alone = forces_in_lane(t, group, hinge, 0, points)
                for role in range(4):
                    t.hinge_forces[group, 4 * hinge + role] = wp.vec4(
                        alone[role, 0], alone[role, 1], alone[role, 2], 0.0
                    )

    return bend

"""Access of items to each other in eight lanes, and of one world in a lane of them."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Lanes3
from balloon_warp.kernels.loops.eight import loops_of_eight
from balloon_warp.kernels.loops.net_force import Loops
from balloon_warp.kernels.phase import Look
from balloon_warp.kernels.schedules.lanes.layouts import (
    OCTETS,
    WORLDS,
    WORLDS_AS_OCTETS,
    Layout,
    add,
    near,
    of_item,
    places_of,
    put,
    put_item,
    view_of,
)
from balloon_warp.kernels.schedules.lanes.source import add_to_corners
from balloon_warp.kernels.schedules.lanes.state import params_functions_of
from balloon_warp.kernels.spheres import sphere_at


@wp.func
def take_forces(t: Any, params: Any):
    """Take the forces that hinges, faces and membranes have added to an item [N], and clear them."""
    forces = t.forces[params.group]
    force = of_item(forces, params.number)
    put_item(forces, params.number, Lanes3())
    return force


@wp.func
def itself(part: Any):
    """Return the part of the only thread."""
    return part


def _look(layout: Layout) -> Look:
    places = places_of(layout)

    @cache
    def loops(features: Features) -> Loops:
        """Return the loops over all forces on an item."""
        _, _, params_of_one = params_functions_of(features.columns.places["mass"], layout)
        return loops_of_eight(features, near, take_forces, view_of, params_of_one)

    @wp.func
    def world_of(t: Any, params: Any, lane: wp.int32):
        return places.world(params.group, lane, t.world_count)

    return Look(
        near, sphere_at, loops, put=put, velocity_at=near, put_velocity=put,
        in_team=(near, put, itself), add=add, add_to_corners=add_to_corners, world=world_of,
    )  # fmt: skip


LOOKS = {layout: _look(layout) for layout in (WORLDS, OCTETS, WORLDS_AS_OCTETS)}
"""Access functions for eight worlds, and for eight particles of one"""

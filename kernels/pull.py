"""What a particle's springs and strings sum to, for schedules in which a particle gathers its own forces."""

from typing import Any

import warp as wp

from balloon_warp.kernels.springs import spring_coefficient, squared_length, string_coefficient
from balloon_warp.kernels.tables import SpringTable, StringTable, spring_constant


@wp.func
def pull_of_springs(
    springs: SpringTable,
    points: Any,
    first: wp.int32,
    point: wp.vec3,
    world: wp.int32,
    balloon: wp.int32,
    particle: wp.int32,
):
    """Net force of a particle's springs [N]; particle p stands at `points[first + p]`."""
    force = wp.vec3()
    entry = springs.slice_offsets[particle // 32] + particle % 32
    kind_ends = springs.kind_ends[particle]
    slot = wp.int32(0)
    for kind in range(3):
        constant = spring_constant(springs, world, balloon, kind)
        pull = wp.vec3()
        while slot < kind_ends[kind]:
            scale = float(1.0)
            if springs.scales.shape[0] > 0:
                scale = springs.scales[entry]
            d = points[first + springs.neighbors[entry]] - point
            pull += spring_coefficient(squared_length(d), scale, springs.rest_lengths[entry]) * d
            entry += 32
            slot += 1
        force += constant * pull
    return force


@wp.func
def pull_of_strings(strings: StringTable, point: wp.vec3, world: wp.int32, particle: wp.int32):
    """Net force of the strings that hold a particle [N]."""
    force = wp.vec3()
    if strings.offsets.shape[0] > 0:
        for held in range(strings.offsets[particle], strings.offsets[particle + 1]):
            string = strings.order[held]
            d = strings.anchors[string] - point
            length = strings.lengths[world % strings.lengths.shape[0], string]
            stiffness = strings.stiffness[world % strings.stiffness.shape[0], string]
            force += string_coefficient(squared_length(d), stiffness, length) * d
    return force

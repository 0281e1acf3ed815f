"""Strings: one by one, and those that hold a particle."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.memory import int_at
from balloon_warp.kernels.outer_tables import StringTable
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.tables import Tables, row_of_world


@cache
def anchor_function(features: Features) -> Any:
    """Return the function that returns the anchor of a string at a time."""

    @wp.func
    def anchor_at(strings: StringTable, world: wp.int32, string: wp.int32, time: float):
        """Return the anchor of a string [m]; between two frames it moves along a line."""
        if wp.static(features.anchors_move):
            begin = strings.anchors[3 * world, strings.anchors.shape[1] - 1][0]
            return strings.anchors[3 * world, string] + (time - begin) * strings.anchors[3 * world + 1, string]
        return strings.anchors[row_of_world(world, strings.anchors.shape[0]), string]

    return anchor_at


@cache
def string_pull(features: Features) -> Any:
    """Return the function for the force of one string."""
    coefficient, anchor_at = features.laws_on("string"), anchor_function(features)

    @wp.func
    def pull_of_string(
        strings: StringTable,
        world: wp.int32,
        string: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
        n: Any,
        step_seconds: float,
        time: float,
    ):
        """Force of a string on the particle that it holds [N]."""
        d = anchor_at(strings, world, string, time) - point
        length = strings.lengths[row_of_world(world, strings.lengths.shape[0]), string]
        stiffness = strings.stiffness[row_of_world(world, strings.stiffness.shape[0]), string]
        return d * coefficient(
            squared_length(d), -wp.dot(velocity, d), length, stiffness, stiffness * length, step_seconds, time, n
        )

    return pull_of_string


@cache
def held_string_pull(features: Features) -> Any:
    """Return the function for the force of one string, in the order of the particles held."""
    pull_of_string = string_pull(features)
    read_numbers = numbers_reader(features.columns)

    @wp.func
    def pull_of_held_string(t: Tables, world: wp.int32, held: wp.int32, points: Any, velocities: Any, time: float):
        """Return the force of a string on the particle that it holds [N]."""
        p = t.strings.particles[held]
        n = read_numbers(t, world, t.particles.balloon[p])
        string = t.strings.order[held][0]
        return pull_of_string(t.strings, world, string, points[p], velocities[p], n, t.step_seconds, time)

    return pull_of_held_string


@cache
def string_loop(features: Features) -> Any:
    """Return the function that sums a particle's strings."""
    pull_of_string = string_pull(features)

    @wp.func
    def pull_of_strings(
        strings: StringTable,
        world: wp.int32,
        particle: wp.int32,
        point: wp.vec3,
        velocity: wp.vec3,
        n: Any,
        step_seconds: float,
        time: float,
    ):
        """Return the net force of a particle's strings [N]."""
        force = wp.vec3()
        if strings.offsets.shape[0] > 0:
            for held in range(int_at(strings.offsets, particle), int_at(strings.offsets, particle + 1)):
                force += pull_of_string(strings, world, strings.order[held][0], point, velocity, n, step_seconds, time)
        return force

    return pull_of_strings

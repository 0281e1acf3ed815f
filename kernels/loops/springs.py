"""Springs: one by one, and those of a particle."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.memory import float_at, int_at, pair_at, vector_at
from balloon_warp.kernels.params import numbers_reader
from balloon_warp.kernels.tables import CHUNK, SLICE, Tables, first_entry


@wp.func
def constant_of_kind(n: Any, kind: wp.int32):
    """Return a spring constant, which stand first among a balloon's numbers; without the memory that an index needs."""
    return wp.where(kind == 0, n[0], wp.where(kind == 1, n[1], n[2]))


@cache
def pair_pull(features: Features) -> Any:
    """Return the function that evaluates one spring of the table of pairs."""
    coefficient = features.laws_on("spring")
    read_numbers = numbers_reader(features.columns)

    @wp.func
    def pull_of_pair(t: Tables, world: wp.int32, spring: wp.int32, points: Any, velocities: Any, time: float):
        """Return the vector from a spring's first end to its second [m], and its tension over length [N/m].

        Their product is the force on the first end.
        """
        p = t.pairs.particles[spring][0]
        q = t.pairs.particles[spring][1]
        n = read_numbers(t, world, t.particles.balloon[p])
        stiffness = constant_of_kind(n, t.pairs.kinds[spring]) * t.pairs.scales[spring]
        length = t.pairs.rest_lengths[spring]
        d = points[q] - points[p]
        opening = wp.dot(velocities[q] - velocities[p], d)
        return d, coefficient(
            squared_length(d), opening, length, stiffness, stiffness * length, t.step_seconds, time, n
        )

    return pull_of_pair


@cache
def spring_pull(features: Features) -> Any:
    """Return the function for the force of a spring on the particle at one of its ends."""
    coefficient = features.laws_on("spring")
    moving = features.needs("spring", "opening")

    @wp.func
    def pull_of_spring(
        t: Tables,
        velocities: Any,
        params: Any,
        end: wp.int32,
        d: wp.vec3,
        stiffness: float,
        length: float,
        velocity: wp.vec3,
        time: float,
    ):
        """Return the force of a spring [N]; `d` leads to the other end [m].

        Padding leads to the particle itself, and has no force.
        """
        opening = float(0.0)
        if wp.static(moving):
            opening = wp.dot(vector_at(velocities, end) - velocity, d)
        pull = d * coefficient(
            squared_length(d), opening, length, stiffness, stiffness * length, t.step_seconds, time, params.n
        )
        if wp.static(features.guarded):
            pull = wp.where(end == params.number, wp.vec3(), pull)
        return pull

    return pull_of_spring


@cache
def spring_loop(features: Features, at: Any) -> Any:
    """Return the function that sums a particle's springs, read from the table."""
    pull_of_spring = spring_pull(features)

    @wp.func
    def pull_of_springs(
        t: Tables,
        points: Any,
        velocities: Any,
        params: Any,
        springs: Any,
        point: wp.vec3,
        velocity: wp.vec3,
        time: float,
    ):
        """Return the net force of a particle's springs [N]."""
        force = wp.vec3()
        begin = first_entry(t.springs.slice_offsets, params.number)
        for chunk in range(begin, begin + SLICE * int_at(t.springs.valences, params.number), SLICE * CHUNK):
            for slot in range(CHUNK):
                entry = chunk + SLICE * slot
                spring = pair_at(t.springs.entries, entry)
                end = wp.cast(spring[0], wp.int32)
                stiffness = constant_of_kind(params.n, end & 3)
                if wp.static(features.springs_vary):
                    stiffness *= float_at(t.springs.scales, entry)
                force += pull_of_spring(
                    t, velocities, params, end >> 2, at(points, end >> 2) - point, stiffness,
                    spring[1], velocity, time,
                )  # fmt: skip
        return force

    return pull_of_springs

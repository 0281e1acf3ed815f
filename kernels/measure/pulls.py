"""How hard each spring, each string and each law pulls, one by one: what a schedule only knows the sum of."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.laws.law import Law
from balloon_warp.kernels.loops.net_force import net_force_function, scalar_loops
from balloon_warp.kernels.loops.springs import constant_of_kind
from balloon_warp.kernels.loops.strings import string_pull
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.own import numbers_reader, own_functions
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


@cache
def spring_pull_kernel(traits: Traits) -> Any:
    """The kernel that measures springs."""
    coefficient = traits.laws_on("spring")
    read_numbers = numbers_reader(traits.columns)

    @wp.kernel(module="unique", enable_backward=False)
    def measure_springs(
        # model
        t: Tables,
        time: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        pulls: wp.array2d[float],
    ):
        """A thread a (world, spring): the force with which it pulls, or if negative pushes, its ends [N]."""
        world, spring = wp.tid()
        p = t.pairs.particles[spring][0]
        q = t.pairs.particles[spring][1]
        n = read_numbers(t, world, t.particles.balloon[p])
        stiffness = constant_of_kind(n, t.pairs.kinds[spring]) * t.pairs.scales[spring]
        length = t.pairs.rest_lengths[spring]
        d = points[world, q] - points[world, p]
        opening = wp.dot(velocities[world, q] - velocities[world, p], d)
        squared = squared_length(d)
        pulls[world, spring] = wp.sqrt(squared) * coefficient(
            squared, opening, length, stiffness, stiffness * length, t.step_seconds, time, n
        )

    return measure_springs


@cache
def string_pull_kernel(traits: Traits) -> Any:
    """The kernel that measures strings."""
    pull_of_string = string_pull(traits)
    read_numbers = numbers_reader(traits.columns)

    @wp.kernel(module="unique", enable_backward=False)
    def measure_strings(
        # model
        t: Tables,
        time: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        pulls: wp.array2d[float],
    ):
        """A thread a (world, string as it is held): the force on its particle [N]."""
        world, held = wp.tid()
        p = t.strings.particles[held]
        n = read_numbers(t, world, t.particles.balloon[p])
        string = t.strings.order[held]
        pulls[world, string] = wp.length(
            pull_of_string(t.strings, world, string, points[world, p], velocities[world, p], n, t.step_seconds, time)
        )

    return measure_strings


@cache
def _measure_laws(traits: Traits, laws: tuple[Law, ...]) -> Any:
    """The function that writes down what each of some laws does to a particle, one after the other."""
    alone = traits._replace(laws=laws[:1], pressures=False)
    net_force = net_force_function(alone, scalar_loops(alone, vector_at))
    others = _measure_laws(traits, laws[1:]) if len(laws) > 1 else None

    @wp.func
    def measure(
        t: Tables,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
        own: Any,
        time: float,
        number: wp.int32,
        pulls: wp.array3d[float],
    ):
        point = points[own.number]
        force, _area = net_force(t, points, velocities, own, own.number, point, velocities[own.number], time)
        pulls[own.world, number, own.number] = wp.length(force)
        if wp.static(others is not None):
            others(t, points, velocities, own, time, number + 1, pulls)

    return measure


@cache
def law_pull_kernel(traits: Traits, laws: tuple[Law, ...]) -> Any:
    """The kernel that measures laws on particles, hinges and faces."""
    _, read_own = own_functions(traits.columns)
    measure = _measure_laws(traits, laws)

    @wp.kernel(module="unique", enable_backward=False)
    def measure_laws(
        # model
        t: Tables,
        time: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        pulls: wp.array3d[float],
    ):
        """A thread a (world, particle): the force of each law on it [N]."""
        world, particle = wp.tid()
        own = read_own(t, world, particle)
        measure(t, points[world], velocities[world], own, time, 0, pulls)

    return measure_laws

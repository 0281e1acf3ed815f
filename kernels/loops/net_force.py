"""All forces on a particle but the inflation and contacts: here is where the laws enter."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.algebra import scaled
from balloon_warp.kernels.loops.areas import area_loop, hole_loop
from balloon_warp.kernels.loops.hinges import hinge_loop
from balloon_warp.kernels.loops.membranes import membrane_loop
from balloon_warp.kernels.loops.rings import ring_loop
from balloon_warp.kernels.loops.springs import spring_loop
from balloon_warp.kernels.loops.strings import string_loop
from balloon_warp.kernels.loops.wetness import ring_wetness_loop, wetness_loop
from balloon_warp.kernels.memory import in_tile, vector_at
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


class Loops(NamedTuple):
    """Loops over the forces on a particle; they take the particle's `own`, one or eight at a time."""

    around: Any
    """(t, points, velocities, own, springs, point, velocity, time) to the net force of its springs, and where they are
    needed and found on the way, to its area vector and A_p n, see `laws.inflation`"""
    others: Any
    """(t, points, velocities, own, point, velocity, time) to that of strings, hinges and membranes; None if
    there are none, or the springs' has it already"""
    water_load: Any
    """(t, points, own)"""
    particle_laws: Any
    """Function from the force so far, the inputs of laws on a particle, and the row of its numbers, to the sum with
    these laws"""


@cache
def net_force_function(traits: Traits, loops: Loops) -> Any:
    """Return the function that sums the forces on a particle."""
    others = loops.others is not None
    area_vector_of_holes = hole_loop(vector_at) if traits.bursts and traits.measures_areas else None

    @wp.func
    def net_force(t: Any, points: Any, velocities: Any, own: Any, springs: Any, point: Any, velocity: Any, time: float):
        """Return the net force [N], and where they are needed, area vector and A_p n of the particle [m^2].

        Args:
            velocities: of all particles, where a law asks for its neighbors'.
            springs: what the loop over springs goes by, beside the tables.
        """
        force, area_vector, facing = loops.around(t, points, velocities, own, springs, point, velocity, time)
        if wp.static(others):
            force += loops.others(t, points, velocities, own, point, velocity, time)
        skin = area_vector
        if wp.static(area_vector_of_holes is not None):  # what is torn bounds the gas, but no law acts on it
            skin -= area_vector_of_holes(t, points, own.world, own.number, point)
        water_load = wp.vec4()
        if wp.static(traits.in_water):
            force = loops.particle_laws(
                force, point, velocity, own.mass, own.share, skin, loops.water_load(t, points, own),
                t.up, t.step_seconds, time, own.n,
            )  # fmt: skip
        else:
            force = loops.particle_laws(
                force, point, velocity, own.mass, own.share, skin, water_load, t.up, t.step_seconds, time, own.n
            )
        return force, area_vector, facing

    return net_force


@cache
def one_after_the_other(
    traits: Traits, pull_of_springs: Any, area_vector_of_own: Any, facing_of_own: Any = None
) -> Any:
    """Return the function that loops over a particle's springs, and then over its faces."""

    @wp.func
    def around(t: Any, points: Any, velocities: Any, own: Any, springs: Any, point: Any, velocity: Any, time: float):
        """Force [N], area vector and A_p n [m^2]."""
        force = pull_of_springs(t, points, velocities, own, springs, point, velocity, time)
        area_vector = scaled(point, 0.0)
        facing = scaled(point, 0.0)
        if wp.static(traits.measures_areas):
            area_vector = area_vector_of_own(t, points, own, springs, point)
        if wp.static(facing_of_own is not None):
            facing = facing_of_own(t, points, own, springs, point)
        return force, area_vector, facing

    return around


@cache
def scalar_loops(
    traits: Traits, at: Any, springs: Any = None, area_vector: Any = None, facing: Any = None, aims: bool = False
) -> Loops:
    """Return the loops for one particle at a time.

    Args:
        at: the function that reads a point.
        springs: the loop over springs, if they are not read from the table.
        area_vector: the loop over faces, if it goes another way.
        facing: the one that finds A_p n, if it does.
        aims: whether rings find A_p n on the way.
    """
    sum_strings = string_loop(traits)
    sum_hinges = hinge_loop(traits, at)
    sum_membrane = membrane_loop(traits, at, vector_at) if traits.membranes else None
    area_vector_of_particle = area_loop(traits.quads, at)
    load_of_particle = ring_wetness_loop(at) if traits.rings else wetness_loop(at)
    level_column = traits.columns.places.get("water_level", 0)
    others = any(traits.has(kind) for kind in ("string", "hinge")) or sum_membrane is not None

    @wp.func
    def other_pulls(t: Tables, points: Any, velocities: Any, own: Any, point: wp.vec3, velocity: wp.vec3, time: float):
        """Return the net force of strings, hinges and membranes [N]."""
        force = wp.vec3()
        if wp.static(traits.has("string")):
            force += sum_strings(t.strings, own.world, own.number, point, velocity, own.n, t.step_seconds, time)
        if wp.static(traits.has("hinge")):
            force += sum_hinges(t.hinges, points, own.number, own.n)
        if wp.static(sum_membrane is not None):
            force += sum_membrane(
                t.membranes, points, velocities, own.world, own.number, own.balloon, point, velocity, own.n
            )
        return force

    @wp.func
    def area_vector_of_own(t: Tables, points: Any, own: Any, springs: Any, point: wp.vec3):
        """Return the area vector of a particle [m^2]."""
        return area_vector_of_particle(t.fans, points, own.number, point)

    @wp.func
    def water_load_of_own(t: Tables, points: Any, own: Any):
        """Return depth times area vector [m^3], and wetted area [m^2]."""
        if wp.static(traits.rings):
            return load_of_particle(t.rings, points, own.number, own.n[level_column], t.up)
        else:
            return load_of_particle(t.faces, points, own.number, own.n[level_column], t.up)

    if traits.rings and not springs and (traits.measures_areas or at is in_tile):
        around = ring_loop(traits, at, aims)
    else:
        pull_of_springs = springs or spring_loop(traits, at)
        around = one_after_the_other(traits, pull_of_springs, area_vector or area_vector_of_own, facing)
    return Loops(
        around,
        other_pulls if others else None,
        water_load_of_own,
        traits.laws_added("particle"),
    )

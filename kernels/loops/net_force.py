"""Net force on a particle but for inflation and contacts: where the laws enter."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.algebra import scaled
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.areas import area_loop, hole_loop
from balloon_warp.kernels.loops.hinges import hinge_loop
from balloon_warp.kernels.loops.membranes import membrane_loop
from balloon_warp.kernels.loops.rings import ring_loop
from balloon_warp.kernels.loops.springs import spring_loop
from balloon_warp.kernels.loops.strings import string_loop
from balloon_warp.kernels.loops.wetness import ring_wetness_loop, wetness_loop
from balloon_warp.kernels.memory import in_tile, vector_at
from balloon_warp.kernels.tables import Tables


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
def net_force_function(features: Features, loops: Loops) -> Any:
    """Return the function that sums the forces on a particle."""
    others = loops.others is not None
    area_vector_of_holes = hole_loop(vector_at) if features.bursts and features.measures_areas else None

    @wp.func
    def net_force(
        t: Any, points: Any, velocities: Any, params: Any, springs: Any, point: Any, velocity: Any, water_load: Any,
        time: float,
    ):  # fmt: skip
        """Return the net force [N], and where they are needed, area vector and A_p n of the particle [m^2].

        Args:
            velocities: of all particles, where a law asks for its neighbors'.
            springs: inputs of the loop over springs, beside the tables.
            water_load: see `phases.soak`; anything where there is no liquid.
        """
        force, area_vector, vertex_normal = loops.around(t, points, velocities, params, springs, point, velocity, time)
        if wp.static(others):
            force += loops.others(t, points, velocities, params, point, velocity, time)
        skin = area_vector
        if wp.static(area_vector_of_holes is not None):  # torn faces bound the gas, but no law acts on them
            skin -= area_vector_of_holes(t, points, params.world, params.number, point)
        force = loops.particle_laws(
            force, point, velocity, params.mass, params.share, skin, water_load, t.up, t.step_seconds, time, params.n
        )
        return force, area_vector, vertex_normal

    return net_force


@cache
def one_after_the_other(
    features: Features, pull_of_springs: Any, own_area_vector: Any, own_vertex_normal: Any = None
) -> Any:
    """Return the function that loops over a particle's springs, and then over its faces."""

    @wp.func
    def around(t: Any, points: Any, velocities: Any, params: Any, springs: Any, point: Any, velocity: Any, time: float):
        """Force [N], area vector and A_p n [m^2]."""
        force = pull_of_springs(t, points, velocities, params, springs, point, velocity, time)
        area_vector = scaled(point, 0.0)
        vertex_normal = scaled(point, 0.0)
        if wp.static(features.measures_areas):
            area_vector = own_area_vector(t, points, params, springs, point)
        if wp.static(own_vertex_normal is not None):
            vertex_normal = own_vertex_normal(t, points, params, springs, point)
        return force, area_vector, vertex_normal

    return around


@cache
def scalar_loops(
    features: Features,
    at: Any,
    springs: Any = None,
    area_vector: Any = None,
    vertex_normal: Any = None,
    inflation_directions: bool = False,
) -> Loops:
    """Return the loops for one particle at a time.

    Args:
        at: the function that reads a point.
        springs: the loop over springs, if they are not read from the table.
        area_vector: the loop over faces, if it goes another way.
        vertex_normal: the function that finds A_p n, if it does.
        inflation_directions: whether rings find A_p n on the way.
    """
    sum_strings = string_loop(features)
    sum_hinges = hinge_loop(features, at)
    sum_membrane = membrane_loop(features, at, vector_at) if features.membranes else None
    area_vector_of_particle = area_loop(features.quads, at)
    load_of_particle = ring_wetness_loop(at) if features.rings else wetness_loop(at)
    level_column = features.columns.places.get("water_level", 0)
    others = any(features.has(kind) for kind in ("string", "hinge")) or sum_membrane is not None

    @wp.func
    def other_pulls(
        t: Tables, points: Any, velocities: Any, params: Any, point: wp.vec3, velocity: wp.vec3, time: float
    ):
        """Return the net force of strings, hinges and membranes [N]."""
        force = wp.vec3()
        if wp.static(features.has("string")):
            force += sum_strings(
                t.strings, params.world, params.number, point, velocity, params.n, t.step_seconds, time
            )
        if wp.static(features.has("hinge")):
            force += sum_hinges(t.hinges, points, params.number, params.n)
        if wp.static(sum_membrane is not None):
            force += sum_membrane(
                t.membranes, points, velocities, params.world, params.number, params.balloon, point, velocity, params.n
            )
        return force

    @wp.func
    def own_area_vector(t: Tables, points: Any, params: Any, springs: Any, point: wp.vec3):
        """Return the area vector of a particle [m^2]."""
        return area_vector_of_particle(t.fans, points, params.number, point)

    @wp.func
    def own_water_load(t: Tables, points: Any, params: Any):
        """Return depth times area vector [m^3], and wetted area [m^2]."""
        if wp.static(features.rings):
            return load_of_particle(t.rings, points, params.number, params.n[level_column], t.up)
        else:
            return load_of_particle(t.faces, points, params.number, params.n[level_column], t.up)

    if features.rings and not springs and (features.measures_areas or at is in_tile):
        around = ring_loop(features, at, inflation_directions)
    else:
        pull_of_springs = springs or spring_loop(features, at)
        around = one_after_the_other(features, pull_of_springs, area_vector or own_area_vector, vertex_normal)
    return Loops(
        around,
        other_pulls if others else None,
        own_water_load,
        features.laws_added("particle"),
    )

"""Sums of derivatives by places, velocities and inverse masses of particles, by contacts in any order.

Bars of contacts have `points`, `velocities` and `eases`, shape (W, P), and `sums`, shape (W, P, SUMS), and `largest`,
see `exact_sums`; for masses, `gas_masses` and `numbers`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.exact_sums import add_exactly, parts_per_unit, sum_at
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.net_force import ease_function
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working

OF_PLACES, OF_VELOCITIES, OF_EASES = (wp.constant(kind) for kind in range(3))
"""Kinds of sums"""
EASE, SUMS = wp.constant(6), 7
"""Entries of a particle's sums: after place and velocity its inverse mass"""


@wp.func
def add_to_sums(bars: Any, world: wp.int32, particle: wp.int32, place: wp.vec3, velocity: wp.vec3, ease: float):
    """Add derivatives to the sums of a particle, by any thread in any order."""
    of_places = parts_per_unit(bars.largest, world, OF_PLACES)
    of_velocities = parts_per_unit(bars.largest, world, OF_VELOCITIES)
    for axis in range(3):
        add_exactly(bars.sums, world, particle, axis, of_places, place[axis])
        add_exactly(bars.sums, world, particle, axis + 3, of_velocities, velocity[axis])
    add_exactly(bars.sums, world, particle, EASE, parts_per_unit(bars.largest, world, OF_EASES), ease)


@wp.func
def take_sums(bars: Any, world: wp.int32, particle: wp.int32):
    """Add a particle's sums to its derivatives, and clear them."""
    place = wp.vec3()
    velocity = wp.vec3()
    for axis in range(3):
        place[axis] = sum_at(bars.sums, bars.largest, world, particle, axis, OF_PLACES)
        velocity[axis] = sum_at(bars.sums, bars.largest, world, particle, axis + 3, OF_VELOCITIES)
    ease = sum_at(bars.sums, bars.largest, world, particle, EASE, OF_EASES)
    bars.points[world, particle] = bars.points[world, particle] + place
    bars.velocities[world, particle] = bars.velocities[world, particle] + velocity
    bars.eases[world, particle] = bars.eases[world, particle] + ease
    for entry in range(SUMS):
        bars.sums[world, particle, entry] = wp.int64(0)


@cache
def weighing_function(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the adjoint of a particle's inverse mass.

    Args:
        columns: of the numbers that are derived by.
    """
    ease_of_moving = ease_function(features)
    column = features.columns.places["mass"]
    place_of_mass = columns.index(column) if column in columns else -1

    @wp.func
    def weigh_back(t: Tables, working: Working, bars: Any, world: wp.int32, particle: wp.int32):
        if bars.eases[world, particle] != 0.0:
            ease = ease_of_moving(t, working, world, particle)
            by_mass = -bars.eases[world, particle] * ease * ease * t.particles.mass_share[particle]
            bars.eases[world, particle] = 0.0
            bars.gas_masses[world, particle] = bars.gas_masses[world, particle] + by_mass
            if wp.static(place_of_mass >= 0):
                before = bars.numbers[world, particle, wp.static(place_of_mass)]
                bars.numbers[world, particle, wp.static(place_of_mass)] = before + by_mass

    return weigh_back

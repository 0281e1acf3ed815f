"""Strings: from a fixed anchor to a particle. They pull and do not push."""

import warp as wp

from balloon_warp.kernels.laws.hooke import hooke, hooke_energy
from balloon_warp.kernels.laws.law import Law


@wp.func
def string(squared_length: float, stiffness: float, stiffness_times_length: float):
    """Force per unit displacement [N/m]: a spring while taut, nothing while slack."""
    return wp.max(hooke(squared_length, stiffness, stiffness_times_length), 0.0)


@wp.func
def string_energy(squared_length: float, rest_length: float, stiffness: float):
    """Return the energy of a spring while taut [J]."""
    return wp.where(
        squared_length > rest_length * rest_length, hooke_energy(squared_length, rest_length, stiffness), 0.0
    )


STRING = Law(
    "string",
    string,
    energy=string_energy,
    wants=lambda scene: bool(scene.string),
    stiffness=lambda stiffness: stiffness,
)

"""Springs: structural, shear and flexion alike (paper, "Spring Forces")."""

import warp as wp

from balloon_warp.kernels.algebra import inverse_root
from balloon_warp.kernels.laws.law import Law, Parameter


@wp.func
def hooke(squared_length: float, stiffness: float, stiffness_times_length: float):
    """Force per unit displacement [N/m] of a spring: k (|d| - L) d/|d| is (k - k L/|d|) d.

    Coincident ends have d = 0 and a finite coefficient: no force, no NaN.
    """
    return stiffness - stiffness_times_length * inverse_root(squared_length)


@wp.func
def hooke_energy(squared_length: float, rest_length: float, stiffness: float):
    """Return the energy of a spring, 1/2 k (|d| - L)^2 [J]."""
    strain = wp.sqrt(squared_length) - rest_length
    return 0.5 * stiffness * strain * strain


KINDS = (
    Parameter(
        "structural",
        "N/m",
        20.0,
        least=0.0,
        path="stiffness.structural",
        meaning="Spring constant k along the edges of faces",
    ),
    Parameter("shear", "N/m", 10.0, least=0.0, path="stiffness.shear", meaning="Spring constant k across faces"),
    Parameter(
        "flexion",
        "N/m",
        2.0,
        least=0.0,
        path="stiffness.flexion",
        meaning="Spring constant k past one particle, against bending",
    ),
)
"""Spring constants of the three kinds of springs (paper, figure 3), which the loops over springs look up"""

HOOKE = Law("spring", hooke, energy=hooke_energy, stiffness=lambda stiffness: stiffness)

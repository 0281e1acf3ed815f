"""Rubber and film that tear: where a tear begins, how it runs, and how the gas leaves.

A tear begins where the larger principal true stress reaches the `strength`, or where a needle pierces. From face to
face it runs on where the stress at its tip exceeds the `tear_strength`, at most as fast as waves on the surface of the
unstretched material, 0.955 root(mu / rho) (Rayleigh's, of what is incompressible). Below a stress a balloon opens along
one tear; above it tears branch, and it bursts to pieces (Moulinet and Adda-Bedia 2015, Popping balloons: a case study
of dynamical fragmentation, PRL 115, 184301). A face that is torn pulls no more and bears no pressure.

The gas leaves through the hole as through any that has a sharp edge, see `laws.orifice`, by the pressure, density and
volume that it had: a burst is too quick for heat, and for the volume to follow.
"""

import warp as wp

from balloon_warp.kernels.laws.law import FAR, TINY, Parameter
from balloon_warp.kernels.laws.orifice import SHARP_EDGE, orifice_flow

NEVER = 1.0e9
"""[s]"""
RAYLEIGH = 0.955
"""speed of waves on a surface over that of shear waves inside, of what is incompressible"""
TEARING, BRANCHING = 0.1, 0.5
"""of the strength are the stress that a tear needs to go on, and that from which on it branches, where nobody says"""
AIR_GAMMA = wp.constant(1.4)
WHOLE = wp.constant(-1.0)
"""of a face, instead of how far a tear may have run from it"""
SPENT = wp.constant(1.0e8)
"""that far, once it has gone on from there"""
SLIGHT = wp.constant(1.0e-3)
"""below it a pressure is none [Pa]: float32 tells the air's to 8e-3"""
PARAMETERS = (
    Parameter("film_strength", "Pa", FAR, least=TINY, path="material.strength"),
    Parameter("tear_strength", "Pa", float("nan"), least=TINY, path="material.tear_strength"),
    Parameter("branching_stress", "Pa", float("nan"), least=TINY, path="material.branching_stress"),
    Parameter("tear_speed", "m/s", float("nan"), least=TINY, path="material.tear_speed"),
    Parameter("needle_time", "s", NEVER, least=0.0, path="material.needle_time"),
)
"""of the balloon; NaN is settled once all is known"""


@wp.func
def true_stress(by_trace: float, by_det: float, major: float, minor: float):
    """The larger principal one [Pa], l dW/dl, of the slopes of the relaxed energy and the squared stretches."""
    return 2.0 * major * (by_trace + by_det * minor)


@wp.func
def softness_of_gas(volume: float, pressure: float, density: float, gamma: float):
    """By how much the pressure of a gas falls with each cubic meter that leaves without heat, over the root of its
    density [Pa/m^3 (kg/m^3)^(-1/2)].

    Args:
        pressure: in full [Pa].
        gamma: of the gas, or 1 where heat passes at other times.
    """
    without_heat = wp.where(gamma == 1.0, AIR_GAMMA, gamma)
    return without_heat * pressure / (wp.max(volume, 1.0e-12) * wp.sqrt(wp.max(density, 1.0e-3)))


@wp.func
def pressure_beside_hole(pressure: float, softness: float, hole: float, step_seconds: float):
    """What of a pressure above the air's [Pa] is left after a step beside a hole of an area [m^2]."""
    by_root_of_density = orifice_flow(SHARP_EDGE * hole, 1.0, 1.0, pressure, softness, step_seconds)
    left = pressure - softness * step_seconds * by_root_of_density
    return wp.where(left < SLIGHT, 0.0, left)

"""Rubber and film that tear: where a tear begins, how it runs, and how the gas leaves.

A tear begins where the larger principal true stress reaches the `strength`, or where a needle pierces. From face to
face it runs on where the stress at its tip exceeds the `tear_strength`, at most as fast as waves on the surface of the
unstretched material, 0.955 root(mu / rho) (Rayleigh's, of what is incompressible). Below a stress a balloon opens along
one tear; above it tears branch, and it bursts to pieces (Moulinet and Adda-Bedia 2015, Popping balloons: a case study
of dynamical fragmentation, PRL 115, 184301). A face that is torn pulls no more and bears no pressure.

The gas leaves through the hole as through an orifice: by Bernoulli and Torricelli the flow is C A root(2 p / rho), and
with gamma p_air / V as what the pressure falls by, its root falls by a steady amount in each second and square meter.
"""

import warp as wp

from balloon_warp.kernels.laws.law import FAR, TINY, Parameter

NEVER = 1.0e9
"""[s]"""
RAYLEIGH = 0.955
"""speed of waves on a surface over that of shear waves inside, of what is incompressible"""
TEARING, BRANCHING = 0.1, 0.5
"""of the strength are the stress that a tear needs to go on, and that from which on it branches, where nobody says"""
DISCHARGE = wp.constant(0.6)
"""of a hole with a sharp edge: what flows over what would without narrowing"""
AIR_GAMMA = wp.constant(1.4)
WHOLE = wp.constant(-1.0)
"""of a face, instead of how far a tear may have run from it"""
SPENT = wp.constant(1.0e8)
"""that far, once it has gone on from there"""
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
def leaking(volume: float, pressure: float, air_density: float):
    """By how much the root of the pressure falls in each second and square meter of hole [Pa^(1/2)/(s m^2)].

    Args:
        pressure: in full [Pa].
    """
    flow = DISCHARGE * wp.sqrt(2.0 / wp.max(air_density, 1.0e-3))
    return 0.5 * AIR_GAMMA * pressure * flow / wp.max(volume, 1.0e-12)

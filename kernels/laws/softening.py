"""Softening of rubber (Mullins 1948): once stretched, it pulls less until it is stretched further.

A pseudo-elastic law (Ogden and Roxburgh 1999, A pseudo-elastic model for the Mullins effect in filled rubber), with the
third number that Mars gave it: the stress is that of the law, times

    eta = 1 - s erf((P - W) / (m + b P))

W the energy density of the law [Pa], P the greatest that there has been. On first loading P = W and eta = 1; where P
stays, the stress is the slope of an energy that is less than W by the part lost for good. s is their 1 / r.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.laws.law import TINY, Parameter

SOFTENING = (
    Parameter("softening", "1", least=0.0, most=0.95, path="material.softening"),
    Parameter("softening_energy", "Pa", 1.0e5, least=TINY, path="material.softening_energy"),
    Parameter("softening_share", "1", 0.3, least=0.0, most=10.0, path="material.softening_share"),
)
"""Parameters of the balloon; they have no columns among the laws', since few balloons have them"""


@wp.func
def softened(energy: float, peak: float, softening: float, softening_energy: float, softening_share: float):
    """Return the factor eta on the stress, from 1 - softening to 1.

    Args:
        energy: Energy density [Pa], at most the peak.
    """
    return 1.0 - softening * wp.erf((peak - energy) / (softening_energy + softening_share * peak))


def steepening(energy: Any, softening: Any, softening_energy: Any, softening_share: Any) -> Any:
    """Return the largest derivative of eta by the energy density below its peak [1/Pa].

    That is right at the peak. It makes rubber stiffer as it begins to give way. For the host.
    """
    root_of_pi = 1.7724539
    return 2.0 * softening / (root_of_pi * (softening_energy + softening_share * energy))

"""Springs that are viscous, and those that are overextended from some stretch on (Tarantino 1996)."""

from typing import Any

import warp as wp

from balloon_warp.kernels.laws.hooke import hooke
from balloon_warp.kernels.laws.law import Law, Parameter

NEVER_YIELDS = 1.0e9
"""Yield stretch of springs that do not yield: 1 - 1 / stretch is 1 in float32"""
NEVER_ZERO = wp.constant(1.0e-30)
"""Least divisor, below all that count"""


@wp.func
def rubber(
    squared_length: float,
    opening: float,
    stiffness: float,
    stiffness_times_length: float,
    viscosity: float,
    yield_stretch: float,
):
    """Return the addition to Hooke's coefficient [N/m]: t k (d . d') / |d|^2, t the viscosity.

    From the yield stretch on, it takes the whole pull away.
    """
    elastic = hooke(squared_length, stiffness, stiffness_times_length)
    if elastic > stiffness * (1.0 - 1.0 / yield_stretch):  # elastic / stiffness is 1 - L/|d|
        return -elastic
    return viscosity * stiffness * opening / squared_length


@wp.func
def rubber_at_limit(
    squared_length: float,
    opening: float,
    stiffness: float,
    stiffness_times_length: float,
    viscosity: float,
    yield_stretch: float,
    correction_limit: float,
):
    """Return the addition to Hooke's coefficient [N/m] that removes the force at the corrected length.

    A pull k L s at the strain s comes to its end smoothly at the limit c, as k L s (1 - (s / c)^2)^2, with slopes from
    -0.8 k to k. Many springs are at their limit, and rounding is not to decide which of them pull: where their force
    falls faster than Hooke's rises, a difference grows.
    """
    elastic = hooke(squared_length, stiffness, stiffness_times_length)
    plain = rubber(squared_length, opening, stiffness, stiffness_times_length, viscosity, yield_stretch)
    rest = stiffness - elastic  # k L / |d|
    used = wp.clamp(elastic / wp.max(correction_limit * rest, NEVER_ZERO), 0.0, 1.0)  # s / c
    left = 1.0 - used * used
    left *= left
    return left * plain - (1.0 - left) * elastic


VISCOSITY = Parameter(
    "viscosity",
    "s",
    least=0.0,
    path="stiffness.viscosity",
    meaning="Damping constant along a spring over its spring constant (Tarantino 1996)",
    domain=(0.005, 0.015),
)
YIELD_STRETCH = Parameter(
    "yield_stretch",
    "1",
    NEVER_YIELDS,
    least=1.0,
    path="stiffness.yield_stretch",
    meaning="Length over rest length above which the spring force stays constant (Tarantino 1996)",
    domain=(2.0, 4.0),
)
CORRECTION_LIMIT = Parameter(
    "correction_limit",
    "1",
    0.1,
    least=0.001,
    of="world",
    path="correction_limit",
    meaning="Strain beyond which a spring is shortened",
    domain=(0.3, 0.7),
)


def dashpot(stiffness: Any, viscosity: Any) -> Any:
    """Return the damping constant of a spring along it [N s/m]."""
    return viscosity * stiffness


RUBBER = Law(
    "spring",
    rubber,
    (VISCOSITY, YIELD_STRETCH),
    neutral={"viscosity": 0.0, "yield_stretch": NEVER_YIELDS},
    wants=lambda scene: scene.correction != "tarantino",
    drag=dashpot,
)
RUBBER_AT_LIMIT = Law(
    "spring",
    rubber_at_limit,
    (VISCOSITY, YIELD_STRETCH, CORRECTION_LIMIT),
    wants=lambda scene: scene.correction == "tarantino",
    drag=dashpot,
)

"""Balloons that are almost empty: the gas left in them, and their pressure near the volume 0."""

import warp as wp

from balloon_warp.kernels.laws.air import molar_volume

COLLAPSING = wp.constant(0.5)
"""Fraction of a balloon's volume that remains after a step, below which the step is not first-order accurate"""
EMPTY = wp.constant(0.02)
"""Fraction of the mesh's volume that stays in a flat balloon, which no pump or opening takes out"""
EMPTIEST = wp.constant(1.0e-6)
"""Least volume fraction"""


@wp.func
def end_of_collapse(volume: float, held: float, air_pressure: float):
    """Return the volume at the end of a step [m^3] of a gas that would lose most of it in the step.

    There the pressure is p_a (V_a / x - 1) at the volume x of the end, V_a that at the air's pressure, and K the rise
    of the volume in the step with a pressure [m^3/Pa]: x = B + K p_a (V_a / x - 1). The larger root is never below 0,
    whatever is in there.

    Args:
        volume: B, as it would be at the end without any pressure [m^3].
        held: K p_a V_a [m^6].
        air_pressure: K p_a [m^3].
    """
    half = 0.5 * (volume - air_pressure)
    root = wp.sqrt(half * half + held)
    if half > 0.0:
        return half + root
    return held / wp.max(root - half, 1.0e-30)  # the same, to the last digit


@wp.func
def amount_when_flat(mesh_volume: float, air: wp.vec3):
    """Return the amount of gas in a flat balloon [mol], in air of a pressure and temperature."""
    return EMPTY * wp.max(mesh_volume, 0.0) / molar_volume(air[0], air[1])

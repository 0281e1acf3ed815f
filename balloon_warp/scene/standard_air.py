"""The U.S. Standard Atmosphere 1976 up to 80 km, where air is the same mixture at all heights."""

import math

EARTH_RADIUS = 6356766.0
"""Radius by which gravity falls with height [m]"""
STANDARD_GRAVITY = 9.80665
MOLAR_MASS, GAS_CONSTANT = 0.0289644, 8.31432
"""Molar mass of dry air [kg/mol], and the gas constant [J/(mol K)], as that standard has them"""
LOWEST, HIGHEST = -5000.0, 80000.0
"""Altitudes between which it is used [m]"""
LAYERS = (
    (0.0, 0.0065),
    (11000.0, 0.0),
    (20000.0, -0.001),
    (32000.0, -0.0028),
    (47000.0, 0.0),
    (51000.0, 0.0028),
    (71000.0, 0.002),
)
"""Geopotential heights at which layers begin [m], and their lapse rates [K/m]; the first goes on below"""


def standard_air(altitude: float) -> dict[str, float]:
    """Return `pressure` [Pa], `temperature` [K] and `lapse` rate [K/m] at an altitude above sea [m]."""
    shrinks = EARTH_RADIUS / (EARTH_RADIUS + altitude)
    height = altitude * shrinks  # geopotential: with the work against gravity that falls
    pressure, temperature = 101325.0, 288.15
    for number, (begin, lapse) in enumerate(LAYERS):
        top = LAYERS[number + 1][0] if number + 1 < len(LAYERS) else math.inf
        rise = min(height, top) - begin
        warmer = temperature - lapse * rise
        by_weight = STANDARD_GRAVITY * MOLAR_MASS / GAS_CONSTANT
        if lapse:
            pressure *= (warmer / temperature) ** (by_weight / lapse)
        else:
            pressure *= math.exp(-by_weight * rise / temperature)
        temperature = warmer
        if height <= top:
            return {"pressure": pressure, "temperature": temperature, "lapse": lapse * shrinks**2}
    raise AssertionError(altitude)

"""Materials and air that are known, with their sources; properties given for some particles.

Materials that are known, with the sources of values, and the estimates.

- latex: Mueller and Strehlow 2004, Rubber and Rubber Balloons, for a toy balloon: 2 C1 = 3 bar, 2 C2 = 0.3 bar. Skin
  and density are estimates, usual ones of toy balloons and of vulcanized rubber; the skin of latex_thick is one of
  large balloons.
- natural_rubber_treloar: Ogden 1972, Large Deformation Isotropic Elasticity, fitted to Treloar's measurements of 1944,
  in Pa as texts have it since. The skin is an estimate, and the density that of natural rubber with nothing in it (906
  to 930 in books); Treloar's had sulfur.
- foil: polyester film of 12 um. Density by DuPont's sheet H-37232-3; Young's modulus, 4.5 GPa, is an estimate between
  the 4.8 to 5.0 GPa there, of 23 um, and the 3.8 GPa of the sheet of Mylar LBT, of 12 um.
- nylon: film of 15 um; 2.4 GPa and the density are estimates, for data sheets differ with moisture.

The shear modulus of an incompressible film is a third of Young's modulus. Polyester's Poisson's ratio is 0.38 (the same
sheet), so that stretched both ways alike it has E / (1 - 0.38), and here 2 E, a quarter more. The metal and the layer
that seals are left out; with them sellers of balloons give 20 to 50 um.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError

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


LATEX: Mapping[str, Any] = {
    "kind": "mooney_rivlin",
    "shear_modulus": 3.3e5,
    "mooney_ratio": 0.1,
    "thickness": 2.0e-4,
    "density": 940.0,
}
FILM_STRETCH = 1.1
"""Largest stretch of a film without tearing"""
STRAIN_BOUND = 0.003
"""Mean strain at the largest planned pressure that film may have instead of its own, see FOIL.md"""
PRESETS: Mapping[str, Mapping[str, Any]] = {
    "latex": LATEX,
    "latex_thick": {**LATEX, "thickness": 5.0e-4},
    "natural_rubber_treloar": {
        "kind": "ogden",
        "ogden_moduli": (6.3e5, 1.2e3, -1.0e4),
        "ogden_exponents": (1.3, 5.0, -2.0),
        "thickness": 2.0e-4,
        "density": 910.0,
    },
    "foil": {
        "kind": "neo_hookean",
        "shear_modulus": 1.5e9,
        "thickness": 1.2e-5,
        "density": 1390.0,
        "most_stretch": FILM_STRETCH,
        "strain_bound": STRAIN_BOUND,
    },
    "nylon": {
        "kind": "neo_hookean",
        "shear_modulus": 8.0e8,
        "thickness": 1.5e-5,
        "density": 1150.0,
        "most_stretch": FILM_STRETCH,
        "strain_bound": STRAIN_BOUND,
    },
}


def pins_of(given: Any) -> Any:
    """Make a list of a single name, and numbers of a mask; other values stay as they are."""
    if isinstance(given, str):
        return [given]
    is_mask = isinstance(given, list) and bool(given) and all(isinstance(pin, bool) for pin in given)
    return np.flatnonzero(given).tolist() if is_mask else given


def pinned_by(rule: Callable[[NDArray[np.float64]], Any], points: NDArray[np.float64]) -> list[int]:
    """Find the points of a mesh that a rule holds for, by their numbers.

    Args:
        points: as the mesh has them, shape (n, 3).

    Raises:
        InputError: the rule does not say yes or no of each point.
    """
    said = np.asarray(rule(points.copy()))
    if said.shape != (len(points),) or said.dtype != bool:
        raise InputError(
            f"the function must return a boolean for each point, of shape ({len(points)},) "
            f"(got {said.dtype} of shape {said.shape})"
        )
    return np.flatnonzero(said).tolist()


def weighed_by(rule: Callable[[NDArray[np.float64]], Any], points: NDArray[np.float64]) -> list[float]:
    """Ask a rule about each point of a mesh.

    Args:
        points: as the mesh has them, shape (n, 3).

    Raises:
        InputError: the rule does not give a number for each point.
    """
    said = np.asarray(rule(points.copy()))
    if said.shape != (len(points),) or said.dtype.kind not in "biuf":
        raise InputError(
            f"the function must return a number for each point, of shape ({len(points)},) "
            f"(got {said.dtype} of shape {said.shape})"
        )
    return said.astype(float).tolist()

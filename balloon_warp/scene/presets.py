"""Materials that are known.

- latex: Mueller and Strehlow 2004, Rubber and Rubber Balloons, for a toy balloon: 2 C1 = 3 bar, 2 C2 = 0.3 bar. Skin
  and density are usual ones of toy balloons and of natural rubber.
- natural_rubber_treloar: Ogden 1972, Large Deformation Isotropic Elasticity, fitted to Treloar's rubber.
- foil: metallized polyester film, 12 um; nylon: metallized nylon film, 15 um. By data sheets of such films, Young's
  modulus is some 4.5 and 2.4 GPa; a third of that is the shear modulus of what is incompressible.
"""

from collections.abc import Mapping
from typing import Any

LATEX: Mapping[str, Any] = {
    "kind": "mooney_rivlin",
    "shear_modulus": 3.3e5,
    "mooney_ratio": 0.1,
    "thickness": 2.0e-4,
    "density": 940.0,
}
FILM_STRETCH = 1.1
"""to which a film is not stretched without tearing"""
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
    },
    "nylon": {
        "kind": "neo_hookean",
        "shear_modulus": 8.0e8,
        "thickness": 1.5e-5,
        "density": 1150.0,
        "most_stretch": FILM_STRETCH,
    },
}

"""Materials that are known, with the sources of values, and the estimates.

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

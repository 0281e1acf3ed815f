"""Rubbers that are fitted: their values, and their loads in each test."""

from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from balloon_warp.fitting.quantities import Test
from balloon_warp.kernels.laws.membrane import MEMBRANES, MOST_STRETCH, OGDEN_EXPONENTS
from balloon_warp.model.materials import slopes_by_stretches

Values = NDArray[np.float64]
Kind = Literal["neo_hookean", "mooney_rivlin", "gent", "ogden"]
KINDS: tuple[Kind, ...] = get_args(Kind)
EXPONENTS = (1.3, 5.0, -2.0)
"""Exponents of an Ogden material for rubber (Ogden 1972), where the data do not determine them"""
BOUNDS = {
    "shear_modulus": (1e-3, 1e12),
    "mooney_ratio": (1e-6, 1e3),
    "gent_limit": (1e-2, 1e6),
    "ogden_modulus": (1e-6, 1e12),
    "ogden_exponent": (0.2, OGDEN_EXPONENTS.most or 20.0),
    "radius": (1e-6, 1e3),
}
"""Least and largest sizes of values, by the beginning of their names"""
MODULI = tuple(f"ogden_modulus_{term}" for term in (1, 2, 3))


class Family(NamedTuple):
    """Values of a rubber that are fitted; all keep their signs."""

    names: tuple[str, ...]
    starts: tuple[tuple[float, ...], ...]
    """Values at which searches begin; their signs are kept"""


FAMILIES: dict[Kind, Family] = {
    "neo_hookean": Family(("shear_modulus",), ((3.0e5,),)),
    "mooney_rivlin": Family(("shear_modulus", "mooney_ratio"), ((3.0e5, 0.02), (3.0e5, 0.2))),
    "gent": Family(("shear_modulus", "gent_limit"), ((3.0e5, 20.0), (3.0e5, 60.0), (3.0e5, 150.0))),
    "ogden": Family(MODULI, ((6.0e5, 1.2e3, -1.0e4), (4.0e5, 3.0e3, -3.0e4))),
}
WITH_EXPONENTS = Family(
    (*MODULI, *(f"ogden_exponent_{term}" for term in (1, 2, 3))),
    (
        (6.3e5, 1.2e3, -1.0e4, 1.3, 5.0, -2.0),
        (4.0e5, 1.0e2, -5.0e3, 1.7, 7.0, -2.5),
        (1.0e6, 1.0e0, -1.0e4, 0.8, 10.0, -1.5),
        (3.0e5, 3.0e3, -1.0e5, 2.0, 4.0, -0.8),
    ),
)
"""An Ogden material whose exponents are fitted, too"""


def bounds_of(names: tuple[str, ...]) -> tuple[Values, Values]:
    """Return the least and the largest size of values."""
    bounds = [next(pair for start, pair in BOUNDS.items() if name.startswith(start)) for name in names]
    return np.array([least for least, _ in bounds]), np.array([most for _, most in bounds])


def law_numbers(kind: Kind, values: Values) -> dict[str, Any]:
    """Return the law's parameters of values, in the order of their names."""
    if kind == "ogden":
        exponents = values[3:6] if len(values) >= 6 else np.array(EXPONENTS)
        return {"ogden_moduli": np.array(values[:3]), "ogden_exponents": np.array(exponents)}
    most = {"most_stretch": max(MOST_STRETCH.default, 6.0)} if kind == "gent" else {}
    return dict(zip(FAMILIES[kind].names, map(float, values), strict=False)) | most


def shear_modulus_slopes(kind: Kind, values: Values) -> Values:
    """Return the derivatives of the shear modulus by the values, shape (n,)."""
    if kind != "ogden":
        return np.eye(len(values))[0]
    exponents = law_numbers(kind, values)["ogden_exponents"]
    return 0.5 * np.concatenate([exponents, values[:3]])[: len(values)]


def shear_modulus(kind: Kind, values: Values) -> float:
    """Return the shear modulus at rest [Pa]; for Ogden half the sum of moduli times exponents."""
    numbers = law_numbers(kind, values)
    return float(values[0] if kind != "ogden" else 0.5 * numbers["ogden_moduli"] @ numbers["ogden_exponents"])


def nominal_stresses(kind: Kind, values: Values, test: Test, stretches: Values) -> Values:
    """Return the stress over the area at rest of a strip or sheet, without stress through its thickness [Pa].

    A uniaxial test leaves the width free, a planar one keeps it, an equibiaxial one stretches it alike.
    """
    across = {"uniaxial": stretches**-0.5, "planar": np.ones(len(stretches))}.get(test, stretches)
    told = {name: np.full(1, each) if np.ndim(each) == 0 else each for name, each in law_numbers(kind, values).items()}
    slopes = slopes_by_stretches(MEMBRANES[kind], told, np.maximum(stretches, across), np.minimum(stretches, across))
    return np.where(stretches >= across, *slopes)


def sphere_pressures(kind: Kind, values: Values, volumes: Values, thickness: float, radius: float) -> Values:
    """Return the law of a thin sphere: 2 h / R W_1 / stretch^2 [Pa]."""
    stretches = (3.0 * volumes / (4.0 * np.pi)) ** (1.0 / 3.0) / radius
    return 2.0 * thickness / radius * nominal_stresses(kind, values, "equibiaxial", stretches) / stretches**2


def material_of(kind: Kind, values: Values, thickness: float) -> dict[str, Any]:
    """Return the material of a scene: its kind, its thickness [m] and its law's parameters by name."""
    numbers = {name: value for name, value in law_numbers(kind, values).items() if name != "most_stretch"}
    return {"kind": kind, "thickness": thickness} | {
        name: value.tolist() if np.ndim(value) else value for name, value in numbers.items()
    }


def material_table(material: dict[str, Any], thickness_known: bool) -> str:
    """Return the table of a scene file."""
    remarks = {} if thickness_known else {"thickness": "  # of your balloon: the tests do not tell it"}
    lines = [f"{name} = {_written(value)}{remarks.get(name, '')}\n" for name, value in material.items()]
    return "".join(["[balloon.material]\n", *lines])


def _written(value: Any) -> str:
    """Return a value of a table: a text, a number or a list of numbers, of six digits."""
    if isinstance(value, str):
        return f'"{value}"'
    return f"[{', '.join(map(_written, value))}]" if isinstance(value, list) else f"{value:.6g}"

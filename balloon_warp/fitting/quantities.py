"""Vocabulary of measured tables: quantities, their units, tests, and words beside them."""

import re
from typing import Literal, NamedTuple

Test = Literal["inflation", "uniaxial", "equibiaxial", "planar"]
LITER, INCH = 1.0e-3, 0.0254
VOLUMES = {
    "m3": 1.0, "l": LITER, "liter": LITER, "liters": LITER, "litre": LITER, "litres": LITER, "dm3": LITER,
    "dl": 0.1 * LITER, "cl": 0.01 * LITER, "ml": 1e-3 * LITER, "cm3": 1e-6, "cc": 1e-6, "ccm": 1e-6, "ul": 1e-9,
    "mm3": 1e-9, "in3": INCH**3, "ft3": (12.0 * INCH) ** 3,
}  # fmt: skip
"""Units of volume [m^3]"""
LENGTHS = {
    "m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "um": 1e-6, "in": INCH, "inch": INCH, "inches": INCH, "ft": 12.0 * INCH
}  # fmt: skip
"""Units of length [m]"""
WATER, MERCURY, POUNDS, KILOGRAMS = 9.80665, 133.322387415, 6894.757293168, 98066.5
"""Pressure of 1 mm of water at 4 deg C and of mercury at 0 deg C, of a pound-force on a square inch, and of a
kilogram-force on a square centimeter [Pa]"""
PRESSURES = {
    "pa": 1.0, "pascal": 1.0, "n/m2": 1.0, "hpa": 100.0, "kpa": 1e3, "gpa": 1e9, "kn/m2": 1e3, "mn/m2": 1e6,
    "n/mm2": 1e6, "n/cm2": 1e4, "mbar": 100.0, "bar": 1e5, "atm": 101325.0, "torr": 101325.0 / 760.0, "psi": POUNDS,
    "ksi": 1e3 * POUNDS, "lb/in2": POUNDS, "lbf/in2": POUNDS, "kg/cm2": KILOGRAMS, "kgf/cm2": KILOGRAMS,
    "kg/mm2": 100.0 * KILOGRAMS, "kgf/mm2": 100.0 * KILOGRAMS, "dyn/cm2": 0.1, "mmhg": MERCURY,
    "cmhg": 10.0 * MERCURY, "inhg": 25.4 * MERCURY, "mmh2o": WATER, "cmh2o": 10.0 * WATER, "inh2o": 25.4 * WATER,
}  # fmt: skip
"""Units of pressure and stress [Pa]; those of one letter's case are in `CASED`"""
CASED = {"MPa": 1e6, "mPa": 1e-3}
PERCENT = {"%", "percent", "prozent", "pct"}
PURE = {"1": 1.0, "-": 1.0}
"""Units of a ratio"""
STRAINS = PURE | dict.fromkeys(PERCENT, 0.01)


class Quantity(NamedTuple):
    """Kind of the values of a column."""

    measures: Literal["size", "load"]
    of_inflation: bool
    """Whether a balloon has it, rather than a sheet or a strip"""
    names: frozenset[str]
    units: dict[str, float]
    usual: str
    """Units as a sentence names them"""


def _names(text: str) -> frozenset[str]:
    return frozenset(text.split())


OF_LENGTH = "m, cm, mm or in"
OF_PRESSURE = "Pa, kPa, mbar, bar, mmHg, cmH2O or psi"
QUANTITIES = {
    "volume": Quantity("size", True, _names("volume volumes vol v volumen"), VOLUMES, "m^3, l, ml or cm^3"),
    "diameter": Quantity("size", True, _names("diameter diameters dia d durchmesser ø"), LENGTHS, OF_LENGTH),
    "radius": Quantity("size", True, _names("radius radii r"), LENGTHS, OF_LENGTH),
    "circumference": Quantity("size", True, _names("circumference perimeter girth umfang"), LENGTHS, OF_LENGTH),
    "pressure": Quantity(
        "load",
        True,
        _names("pressure pressures p druck überdruck ueberdruck pression presión presion"),
        PRESSURES,
        OF_PRESSURE,
    ),
    "stretch": Quantity("size", False, _names("stretch stretches lambda λ streckung"), PURE, "no unit"),
    "strain": Quantity(
        "size", False, _names("strain strains epsilon eps ε dehnung elongation"), STRAINS, "% or no unit"
    ),
    "stress": Quantity(
        "load",
        False,
        _names("stress stresses sigma \u03c3 spannung contrainte"),
        PRESSURES,
        "Pa, kPa, MPa, N/mm^2 or psi",
    ),
}
ABSOLUTE = _names("absolute abs absolut a")
DEVIATION = _names(
    "deviation deviations dev std stdev stddev sd se sem uncertainty uncertainties unc error errors err "
    "standardabweichung stdabw unsicherheit fehler ± +-"
)
"""Words of a column of standard deviations"""
FORMS = {"stress": _names("true cauchy wahre"), "strain": _names("true log logarithmic hencky")}
"""Words of a stress on the present area, and of a strain that is the logarithm of the stretch"""
NOMINAL = _names("nominal engineering eng technical conventional technische nominelle")
SILENT = _names(
    "gauge gage g rel relative over excess inner outer inside internal external measured mean average balloon of in "
    "the difference delta gas air total standard principal -"
)
"""Words that change nothing"""
OTHERS = _names("rate energy flow number")
"""Words behind the name of a quantity that make it another one"""
EXPECTED = (
    f"expected a column of volume ({QUANTITIES['volume'].usual}) and one of gauge pressure ({OF_PRESSURE}), as in: "
    f"volume [m^3], pressure [Pa]; or one of stretch or strain and one of stress ({QUANTITIES['stress'].usual}), as "
    "in: stretch, stress [MPa]"
)
TESTS: dict[Test, str] = {
    "equibiaxial": r"equi ?biax\w*|biax\w*|equi|et|ebt",
    "planar": r"planar|pure ?shear|plane ?strain|strip ?biax\w*|ps",
    "uniaxial": r"uniax\w*|simple ?tension|einachsig\w*|ut",
}
"""Words that name a test"""
TENSILE = r"tensile|tension|zug\w*"
"""Words of a uniaxial test where no other is named"""


def without_test(text: str) -> tuple[str, Test | None]:
    """Return a text without the words that name a test, and the test; None if there is none, or several."""
    found: set[Test] = set()
    for test in ("planar", "equibiaxial", "uniaxial"):  # a strip-biaxial test is planar
        text, count = re.subn(_whole(TESTS[test]), " ", text, flags=re.IGNORECASE)
        if count:
            found.add(test)
    text, count = re.subn(_whole(TENSILE), " ", text, flags=re.IGNORECASE)
    if count and not found:
        found.add("uniaxial")
    return text, found.pop() if len(found) == 1 else None


def _whole(words: str) -> str:
    """Return a pattern of whole words, which may stand between `_` or `-`; blanks in them may be these."""
    return rf"(?<![^\W_])(?:{words.replace(' ?', '[-_ ]?')})(?![^\W_])"

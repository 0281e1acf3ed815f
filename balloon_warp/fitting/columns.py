"""Heads of measured tables: which column holds what, and in which unit."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from balloon_warp.errors import InputError

LITER, INCH = 1.0e-3, 0.0254
VOLUMES = {
    "m3": 1.0, "l": LITER, "liter": LITER, "liters": LITER, "litre": LITER, "litres": LITER, "dm3": LITER,
    "dl": 0.1 * LITER, "cl": 0.01 * LITER, "ml": 1e-3 * LITER, "cm3": 1e-6, "cc": 1e-6, "ccm": 1e-6, "ul": 1e-9,
    "mm3": 1e-9, "in3": INCH**3, "ft3": (12.0 * INCH) ** 3,
}  # fmt: skip
"""Units of volume [m^3]"""
WATER, MERCURY, POUNDS = 9.80665, 133.322387415, 6894.757293168
"""Pressure of 1 mm of water at 4 deg C and of mercury at 0 deg C, and of a pound-force on a square inch [Pa]"""
PRESSURES = {
    "pa": 1.0, "pascal": 1.0, "n/m2": 1.0, "hpa": 100.0, "kpa": 1e3, "n/mm2": 1e6, "mbar": 100.0, "bar": 1e5,
    "atm": 101325.0, "torr": 101325.0 / 760.0, "psi": POUNDS, "mmhg": MERCURY, "cmhg": 10.0 * MERCURY,
    "inhg": 25.4 * MERCURY, "mmh2o": WATER, "cmh2o": 10.0 * WATER, "inh2o": 25.4 * WATER,
}  # fmt: skip
"""Units of pressure [Pa]; those of one letter's case are in `CASED`"""
CASED = {"MPa": 1e6, "mPa": 1e-3}
ABSOLUTE = {"absolute", "abs", "absolut", "a"}
SILENT = {
    "gauge", "gage", "g", "rel", "relative", "over", "excess", "inner", "inside", "internal", "measured", "mean",
    "balloon", "of", "in", "the", "difference", "delta", "gas", "air", "total",
}  # fmt: skip
"""Words of a head that change nothing"""


class Quantity(NamedTuple):
    """Kind of the values of a column."""

    names: frozenset[str]
    units: dict[str, float]
    usual: str
    """Units as a sentence names them"""


QUANTITIES = {
    "volume": Quantity(frozenset({"volume", "volumes", "vol", "v", "volumen"}), VOLUMES, "m^3, l, ml or cm^3"),
    "pressure": Quantity(
        frozenset({"pressure", "pressures", "p", "druck", "überdruck", "ueberdruck", "pression", "presión", "presion"}),
        PRESSURES,
        "Pa, kPa, mbar, bar, mmHg, cmH2O or psi",
    ),
}
EXPECTED = (
    f"expected a column of volume ({QUANTITIES['volume'].usual}) and one of gauge pressure "
    f"({QUANTITIES['pressure'].usual}), as in: volume [m^3], pressure [Pa]"
)


class Column(NamedTuple):
    """A column of a table."""

    number: int
    factor: float
    """SI units in the column's"""


def columns_of(source: object, head: Sequence[str]) -> dict[str, Column]:
    """Find the columns of volume and of gauge pressure.

    Units stand in brackets of any kind, or after a blank, `_`, `/` or `,`; without one the numbers are in SI units.

    Args:
        source: what a sentence calls the file.
        head: names of the columns.

    Raises:
        InputError: there is no such column, there are two, or one is not understood.
    """
    found: dict[str, Column] = {}
    for number, text in enumerate(head):
        first, *words = _words(text) or [""]
        for name, quantity in QUANTITIES.items():
            if first.lower() in quantity.names:
                if name in found:
                    raise InputError(f"{source}: has two columns of {name}, {head[found[name].number]!r} and {text!r}")
                found[name] = Column(number, _factor(source, name, text, words))
    if len(found) < len(QUANTITIES):
        raise InputError(f"{source}: its head, {', '.join(head)[:80]!r}, is not understood; {EXPECTED}")
    return {name: found[name] for name in QUANTITIES}


def _words(text: str) -> list[str]:
    """Return the words of a column's name, and of its unit without powers and blanks."""
    for old, new in (("³", "3"), ("²", "2"), ("₂", "2"), ("^", ""), ("**", ""), ("µ", "u"), ("μ", "u")):
        text = text.replace(old, new)
    text = re.sub(r"\b(mm|cm|in)\s+(hg|h2o)\b", r"\1\2", text, flags=re.IGNORECASE)
    text = re.sub(r"\b(n)\s*/\s*(m{1,2})\s*2", r"\1÷\g<2>2", text, flags=re.IGNORECASE)
    return [word.replace("÷", "/") for word in re.split(r"[\s\[\](){}<>_/,:;=#.]+", text) if word]


def _factor(source: object, name: str, text: str, words: Sequence[str]) -> float:
    """Return the SI units in the unit of a column, 1 where it has none.

    Raises:
        InputError: the unit is not known, there are several, or the pressure is absolute.
    """
    quantity, factors = QUANTITIES[name], []
    for word in words:
        lower = word.lower()
        known = CASED.get(word) if name == "pressure" else None
        known = quantity.units.get(lower) if known is None else known
        of_gauge = quantity.units.get(lower[:-1]) if name == "pressure" and lower[-1] in "ag" else None
        if name == "pressure" and (lower in ABSOLUTE or (known is None and of_gauge and lower[-1] == "a")):
            raise InputError(f"{source}: {text!r} is absolute; expected gauge pressure, without that of the air")
        if known is not None or of_gauge is not None:
            factors.append(known if known is not None else of_gauge)
        elif lower not in SILENT:
            raise InputError(f"{source}: {name}: {word!r} in {text!r} is not understood; expected {quantity.usual}")
    if len(factors) > 1:
        raise InputError(f"{source}: {name}: {text!r} names several units; expected one")
    return factors[0] if factors else 1.0

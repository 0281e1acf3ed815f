"""Measured tables: quantities and units by the heads of their columns, and files of curves."""

import csv
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.system.files import regular_content

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


LABELS = frozenset({"test", "mode", "type", "loading", "deformation", "experiment", "versuch"})
"""Names of a column that says of which test a row is"""
SIGMA = frozenset({"sigma", "\u03c3"})
"""A stress, or beside another quantity its deviation"""


class Column(NamedTuple):
    """A column of a table."""

    number: int
    quantity: str
    factor: float
    """SI units in the column's"""
    text: str = ""
    """Name in the head"""
    test: Test | None = None
    logarithmic: bool = False
    """Whether a strain is the logarithm of a stretch"""
    true: bool = False
    """Whether a stress is over the present area, not that at rest"""

    @property
    def form(self) -> tuple[str, bool, bool]:
        """Form of the size or load: quantity, whether logarithmic, whether true."""
        return self.quantity, self.logarithmic, self.true

    @property
    def key(self) -> tuple[str, bool, Test | None]:
        """Properties that a table has once."""
        quantity = QUANTITIES[self.quantity]
        return quantity.measures, quantity.of_inflation, self.test


class Deviation(NamedTuple):
    """A column of standard deviations."""

    number: int
    factor: float | None
    """SI units in the column's; None for those of the column that it belongs to"""
    relative: bool
    """Whether it is over the value that it belongs to"""


class Pair(NamedTuple):
    """Columns of one test."""

    test: Test | None
    size: Column
    load: Column
    size_deviation: Deviation | None = None
    load_deviation: Deviation | None = None


@dataclass
class _Words:
    """Words of a column's name, by their meaning."""

    quantity: str = ""
    bare: bool = False
    """Whether it is a deviation of the column on its left, without the name of a quantity"""
    leads: bool = True
    """Whether no unknown word stands before the quantity"""
    units: dict[str, float] = field(default_factory=dict)
    """SI units in each unit that is named"""
    unknown: list[str] = field(default_factory=list)
    formed: bool = False
    """Whether a stress is true, or a strain logarithmic"""
    deviates: bool = False
    relative: bool = False
    absolute: bool = False


def pairs_of(source: object, head: Sequence[str]) -> tuple[list[Pair], int | None]:
    """Find the columns of each test, and the number of the column that names the test of each row, if there is one.

    Units stand in brackets of any kind, or after a blank, `_`, `/` or `,`; without one the numbers are in SI units.
    Standard deviations stand in a column of that name, `pressure deviation`, or simply `std` right of their quantity.

    Args:
        source: name of the file in sentences.
        head: names of the columns.

    Raises:
        InputError: there are no such columns, there are two, or one is not understood.
    """
    columns: list[Column] = []
    deviations: list[tuple[_Words, Test | None, Deviation]] = []
    labels = None
    for number, text in enumerate(head):
        plain, test = without_test(text)
        parts = _parts(plain)
        words = _words(parts, columns[-1].quantity if columns else "")
        if labels is None and len(parts) == 1 and parts[0].lower() in LABELS:
            labels = number
        elif words.deviates and words.leads and words.quantity:
            deviation = Deviation(number, _factor(source, words, text), words.relative)
            deviations.append((words, columns[-1].test if words.bare else test, deviation))
        elif column := _column(source, number, text, test, words):
            columns.append(column)
    pairs = _pairs(source, columns)
    if not pairs:
        raise InputError(f"{source}: its head, {', '.join(head)[:80]!r}, is not understood; {EXPECTED}")
    owners: dict[int, Deviation] = {}
    for words, test, deviation in deviations:
        owner = _owner(columns, deviation.number, words.quantity, test)
        if owner is not None and owners.setdefault(owner.number, deviation) is not deviation:
            raise InputError(f"{source}: has two columns of deviations of {owner.text!r}; expected one")
    with_deviations = [
        pair._replace(size_deviation=owners.get(pair.size.number), load_deviation=owners.get(pair.load.number))
        for pair in pairs
    ]
    return with_deviations, labels


def _column(source: object, number: int, text: str, test: Test | None, words: _Words) -> Column | None:
    """Return a column of values; None for another.

    Raises:
        InputError: a word of it is not understood, or a pressure is absolute.
    """
    name = words.quantity or ("stress" if test and not words.unknown else "")  # "uniaxial [MPa]"
    if not name or not words.leads or OTHERS & {word.lower() for word in words.unknown}:
        return None
    factor = _factor(source, words, text)
    return Column(
        number, name, 1.0 if factor is None else factor, text, None if QUANTITIES[name].of_inflation else test,
        name == "strain" and words.formed, name == "stress" and words.formed,
    )  # fmt: skip


def _pairs(source: object, columns: Sequence[Column]) -> list[Pair]:
    """Return the columns of sizes and loads that belong together.

    Raises:
        InputError: there are two of a kind.
    """
    found: dict[tuple[str, bool, Test | None], Column] = {}
    for column in columns:
        other = found.get(column.key)
        if other is not None and other.form == column.form:
            raise InputError(
                f"{source}: has two columns of {column.quantity}, {other.text!r} and {column.text!r}; expected one"
            )
        if other is None or (other.true and not column.true):  # the measured column comes first
            found[column.key] = column
    pairs = []
    if ("size", True, None) in found and ("load", True, None) in found:
        pairs.append(Pair("inflation", found["size", True, None], found["load", True, None]))
    named = list(dict.fromkeys(test for _, inflation, test in found if not inflation and test))
    for test in [None, *named]:
        own = [found.get((measures, False, test)) for measures in ("size", "load")]
        size, load = (
            column or found.get((measures, False, None)) for measures, column in zip(("size", "load"), own, strict=True)
        )
        if size and load and (test or not named or not (load.true or size.logarithmic)):  # else measured again
            pairs.append(Pair(test, size, load))
    return pairs


def _owner(columns: Sequence[Column], number: int, quantity: str, test: Test | None) -> Column | None:
    """Return the column that a column of deviations belongs to: the nearest of its kind on its left, or right."""
    measures, inflation = QUANTITIES[quantity].measures, QUANTITIES[quantity].of_inflation
    own = [each for each in columns if each.key[:2] == (measures, inflation) and (test is None or each.test == test)]
    return min(own, key=lambda each: (each.number > number, abs(each.number - number)), default=None)


def _parts(text: str) -> list[str]:
    """Return the words of a column's name, and of its unit without powers and blanks."""
    for old, new in (
        ("³", "3"), ("²", "2"), ("₂", "2"), ("**", ""), ("^", ""), ("µ", "u"), ("μ", "u"), ("%", " % "), ("±", " ± "),
    ):  # fmt: skip
        text = text.replace(old, new)
    text = re.sub(r"\b(mm|cm|in)\s+(hg|h2o)\b", r"\1\2", text, flags=re.IGNORECASE)
    text = re.sub(r"\b(n)[\s·*.]*(mm|cm|m)-2\b", r"\1/\g<2>2", text, flags=re.IGNORECASE)
    text = re.sub(r"\b(k?n|mn|kgf?|lbf?|dyn)\s*/\s*(mm|cm|m|in)\s*2\b", r"\1÷\g<2>2", text, flags=re.IGNORECASE)
    text = re.sub(r"\b(mm|m|in)(/\1|[\s·]*\1-1)\b", "1", text, flags=re.IGNORECASE)
    text = re.sub(r"\bu\s*\(", "uncertainty (", text)
    text = re.sub(r"\b(extension|stretch|elongation)[\s_-]*ratio\b", "stretch", text, flags=re.IGNORECASE)
    text = re.sub(r"(?<=[^\W\d_])-(?=[^\W\d_])", " ", text)
    words = re.split(r"[\s\[\](){}<>_/,:;=#.·]+", text)
    return [word.replace("÷", "/").strip("-") or "-" for word in words if word]


def _words(parts: Sequence[str], left: str) -> _Words:
    """Return the meaning of the words of a column's name; `left` is the quantity of the column on its left."""
    said, names = _Words(), list(map(_quantity, parts))
    others = [name for part, name in zip(parts, names, strict=True) if name and part.lower() not in SIGMA]
    lower = {part.lower() for part in parts}
    said.quantity = next(iter(others or filter(None, names)), "")
    said.deviates = bool(lower & DEVIATION) or bool(lower & SIGMA and said.quantity != "stress")
    said.bare = said.deviates and not said.quantity
    before = bool(said.quantity)
    said.quantity = said.quantity or (left if said.deviates else "")
    for part, name in zip(parts, names, strict=True):
        if name and (name == said.quantity or part.lower() in SIGMA):
            before = False
        elif part.isdigit() and said.quantity:  # "lambda_1"
            continue
        elif (factor := _unit(said.quantity, part)) is not None:
            said.units[part.lower()] = factor
        elif part.lower() in PERCENT:
            said.relative = True
        elif said.quantity == "pressure" and (part.lower() in ABSOLUTE or _of_air(part.lower(), "a")):
            said.absolute = True
        elif part.lower() in FORMS.get(said.quantity, ()):
            said.formed = True
        elif not _is_silent(part.lower(), said.quantity):
            said.unknown.append(part)
            said.leads &= not before
    if len(said.units) > 1:  # "diameter in mm" has no inches
        said.units.pop("in", None)
    return said


def _is_silent(lower: str, quantity: str) -> bool:
    """Return whether a word changes nothing beside a quantity."""
    plain = lower in NOMINAL and quantity in ("stretch", "strain", "stress")
    return plain or lower in SILENT or lower in DEVIATION


def _quantity(part: str) -> str:
    """Return the quantity that a word names, numbered or not; empty if it is none."""
    lower = part.lower()
    for name in (lower, lower.rstrip("0123456789")):
        for quantity, told in QUANTITIES.items():
            if name in told.names:
                return quantity
    return ""


def _unit(quantity: str, part: str) -> float | None:
    """Return the SI units in a unit of a quantity, or of stress where none is named; None if it is none."""
    units, lower = QUANTITIES[quantity or "stress"].units, part.lower()
    if units is PRESSURES and part in CASED:
        return CASED[part]
    return units.get(lower[:-1] if quantity == "pressure" and _of_air(lower, "g") else lower)


def _of_air(lower: str, end: str) -> bool:
    """Return whether a word is a unit of pressure with the letter of an absolute or a gauge one behind it."""
    return lower not in PRESSURES and lower[-1:] == end and lower[:-1] in PRESSURES


def _factor(source: object, words: _Words, text: str) -> float | None:
    """Return the SI units in the unit of a column; None where it has none.

    Raises:
        InputError: the unit is not known, there are several, or the pressure is absolute.
    """
    name = words.quantity or "stress"
    if words.absolute and not words.deviates:
        raise InputError(f"{source}: {text!r} is absolute; expected gauge pressure, without that of the air")
    unknown = [*words.unknown, *("%" for _ in range(words.relative and not words.deviates))]
    if unknown:
        raise InputError(
            f"{source}: {name}: {unknown[0]!r} in {text!r} is not understood; expected {QUANTITIES[name].usual}"
        )
    if len(words.units) + (words.relative and words.deviates) > 1:
        raise InputError(f"{source}: {name}: {text!r} names several units; expected one")
    return next(iter(words.units.values()), None)


Values = NDArray[np.float64]
Rows = NDArray[np.bool_]
TURNED = 0.1
"""Least change of size over the curve's range after which its direction has changed"""
LEAST_RUN = 4
"""Least mean number of rows in a run for the rows to be in order of time"""
APART = 0.02
"""Difference of loads over the largest from which on one branch is told from another"""


def rising(sizes: Values) -> tuple[Rows, Rows]:
    """Return which rows load, and which of them no row before had stretched as far, each of shape (n,).

    All do where rows are in no order, or go one way.
    """
    turns, up = [0], True
    extreme, least = 0, TURNED * np.ptp(sizes)
    for row, size in enumerate(sizes):
        ahead = (size - sizes[extreme]) * (1.0 if up else -1.0)
        if ahead > 0.0:
            extreme = row
        elif -ahead > least:
            turns.append(extreme)
            extreme, up = row, not up
    loads, first = np.zeros(len(sizes), bool), np.zeros(len(sizes), bool)
    largest = -np.inf
    for number, begin in enumerate(turns):
        start, end = begin + (begin > 0), turns[number + 1] + 1 if number + 1 < len(turns) else len(sizes)
        if number % 2 == 0 and end - start > 1:
            loads[start:end] = True
            first[start:end] = sizes[start:end] > largest
            largest = max(largest, sizes[start:end].max())
    if len(sizes) < LEAST_RUN * len(turns) or not loads.any():
        return np.ones(len(sizes), bool), np.ones(len(sizes), bool)
    return loads, first


def drop_of(sizes: Values, loads: Values, reference: Rows, others: Rows) -> float:
    """Return by how much loads of other rows are lower than those of reference rows, on the sizes of both."""
    order = np.argsort(sizes[reference])
    known_sizes, known = sizes[reference][order], loads[reference][order]
    others = others & (sizes >= known_sizes[0]) & (sizes <= known_sizes[-1])
    if not others.any():
        return 0.0
    expected = np.interp(sizes[others], known_sizes, known)
    return float((expected - loads[others]).mean() / max(np.abs(expected).mean(), 1e-300))


AXES = {True: ("volume", "pressure", " m^3"), False: ("stretch", "nominal stress", "")}
"""Names, of an inflation and of another test, of sizes and loads, and the unit of sizes"""
TEST_NAMES: dict[Test, str] = {
    "inflation": "an inflation",
    "uniaxial": "a uniaxial test",
    "equibiaxial": "an equibiaxial test",
    "planar": "a planar test",
}


@dataclass(frozen=True)
class Curve:
    """A measured curve: an inflation, or the stretching of a strip or sheet."""

    sizes: Values
    """Volumes [m^3] or stretches [1], shape (n,)"""
    loads: Values
    """Gauge pressures, or stresses over the area at rest [Pa], shape (n,)"""
    test: Test = "inflation"
    size_deviations: Values | None = None
    """Standard deviations of the sizes, where they are known, shape (n,)"""
    load_deviations: Values | None = None
    """Standard deviations of the loads, where they are known, shape (n,)"""
    remarks: tuple[str, ...] = ()
    """Sentences on the choices made in reading the file"""
    name: str = "the curve"
    """Name in sentences"""
    of_sphere: bool = False
    """Whether volumes follow from a diameter"""

    @property
    def load_name(self) -> str:
        """Name of the loads."""
        return "pressure" if self.test == "inflation" else "stress"

    @property
    def summary(self) -> str:
        """Description of the curve and its ranges, in words."""
        size, load, unit = AXES[self.test == "inflation"]
        known = ", ".join(
            f"deviations of {name}"
            for name, deviations in ((size, self.size_deviations), (load, self.load_deviations))
            if deviations is not None
        )
        return (
            f"{self.name}: {len(self.sizes)} rows of {TEST_NAMES[self.test]}: {size} {self.sizes.min():.4g} to "
            f"{self.sizes.max():.4g}{unit}, {load} {self.loads.min():.4g} to {self.loads.max():.4g} Pa"
            f"{known and f', {known}'}"
        )


Lines = list[tuple[int, list[str]]]
"""Rows of a table, with the numbers of their lines"""
LEAST_ROWS = 5
LARGEST_TABLE = 100_000_000
"""Most bytes of a table"""
AIR = (8.0e4, 1.3)
"""Least pressure [Pa], and largest of the highest over the lowest, of a column that is the air's with little on top"""
LARGEST_STRETCH, LARGEST_PLAIN_STRAIN = 20.0, 10.0
"""Stretch beyond that of any rubber, and strain without a unit from which on it is rather in %"""
SEPARATORS = ";\t,"
HEADLESS = Pair("inflation", Column(0, "volume", 1.0), Column(1, "pressure", 1.0))
NO_VALUE = frozenset({"", "nan", "na", "n/a", "-"})
"""Cells of a column that is shorter than others, or whose value is missing"""


def read_curves(path: Path) -> list[Curve]:
    """Read a table of one or several tests: the columns that its head names, in their units.

    Without a head the first two columns are volumes and gauge pressures, in m^3 and Pa. Of rows that load and then
    unload with less load, those that load are taken.

    Raises:
        InputError: it cannot be read, its head is not understood, or it has too few rows, or a wrong number.
    """
    rows = _rows(path)
    pairs, labels, title = [HEADLESS], None, ""
    if rows and not any(map(_is_number, rows[0][1])):
        title, head = _head(rows)
        pairs, labels = pairs_of(path, head)
    said = without_test(title)[1] or without_test(path.stem)[1]
    curves = []
    for pair in pairs:
        parts: dict[Test | None, Lines] = {pair.test or said: rows}
        if labels is not None and pair.test is None:
            parts = _by_test(path, rows, labels)
        for test, own in parts.items():
            curve = _curve(path, pair._replace(test=test), own, alone=len(pairs) * len(parts) == 1)
            if curve.test in [other.test for other in curves]:
                raise InputError(f"{path}: has two {curve.test} tests; expected the name of each test in its head")
            curves.append(curve)
    return curves


def _head(rows: Lines) -> tuple[str, list[str]]:
    """Take the rows before the numbers, and return those of one cell, and the names of the columns with their units."""
    title = []
    while len(rows) > 1 and len(list(filter(str.strip, rows[0][1]))) == 1 and not any(map(_is_number, rows[1][1])):
        title += rows.pop(0)[1]
    head = [name.strip() for name in rows.pop(0)[1]]
    if rows and len(rows[0][1]) == len(head) and not any(map(_is_number, rows[0][1])) and all(rows[0][1]):
        head = [f"{name} [{unit.strip('[]() ')}]" for name, unit in zip(head, rows.pop(0)[1], strict=True)]
    return " ".join(title), head


def _by_test(path: Path, rows: Lines, column: int) -> dict[Test | None, Lines]:
    """Return the rows of each test.

    Raises:
        InputError: a row is of none.
    """
    parts: dict[Test | None, Lines] = {}
    for line, row in rows:
        text = row[column].strip() if column < len(row) else ""
        test = without_test(text)[1]
        if test is None:
            raise InputError(f"{path}, line {line}: test: expected one of {', '.join(TESTS)} (got {text or 'nothing'})")
        parts.setdefault(test, []).append((line, row))
    return parts


def _curve(path: Path, pair: Pair, rows: Lines, alone: bool) -> Curve:
    """Return the curve of one test.

    Args:
        alone: whether it is the only one of the table: no cell may then be empty.

    Raises:
        InputError: it has too few rows, or a wrong number.
    """
    test, remarks = pair.test, ()
    if test is None:
        test = "uniaxial"
        remarks = (
            f"{path}: no test is named, so that it is taken as uniaxial; its head or its name may say equibiaxial or "
            "planar",
        )
    needed = (pair.size.number, pair.load.number)
    if not alone:
        rows = [row for row in rows if any(_cell(row[1], number).lower() not in NO_VALUE for number in needed)]
    size, load = ("volume", "pressure") if test == "inflation" else ("stretch", "stress")
    if len(rows) < LEAST_ROWS:
        whose = "" if alone else f" of the {test} test"
        raise InputError(
            f"{path}: expected at least {LEAST_ROWS} rows of a {size} and a {load}{whose} (got {len(rows)})"
        )
    told, loads = _numbers(path, rows, pair.size), _numbers(path, rows, pair.load)
    sizes, slopes = _sizes(pair.size, told)
    load_slopes = 1.0 / sizes if pair.load.true else np.ones(len(loads))  # without change of volume
    _require_sizes(path, rows, pair.size, told, sizes)
    curve = Curve(
        sizes,
        loads * load_slopes,
        test,
        _deviations(path, rows, pair.size, pair.size_deviation, told, slopes),
        _deviations(path, rows, pair.load, pair.load_deviation, loads, load_slopes),
        remarks,
        str(path) if alone else f"{path}, {test}",
        pair.size.quantity in ("diameter", "radius", "circumference"),
    )
    _require_loads(path, curve)
    return _loaded(curve)


def _sizes(column: Column, told: Values) -> tuple[Values, Values]:
    """Return volumes [m^3] or stretches, and their derivatives by the column's values in SI units."""
    with np.errstate(over="ignore"):
        if column.quantity == "strain":
            sizes = np.exp(told) if column.logarithmic else 1.0 + told
            return sizes, sizes if column.logarithmic else np.ones(len(told))
        if column.quantity in ("stretch", "volume"):
            return told, np.ones(len(told))
    radius = told * {"diameter": 0.5, "radius": 1.0, "circumference": 0.5 / np.pi}[column.quantity]
    return 4.0 / 3.0 * np.pi * radius**3, 4.0 * np.pi * radius**3 / np.maximum(told, 1e-300)


def _require_sizes(path: Path, rows: Lines, column: Column, told: Values, sizes: Values) -> None:
    """Make sure that sizes can be.

    Raises:
        InputError: one cannot, or all are alike.
    """
    name = column.quantity
    for (line, row), size in zip(rows, sizes, strict=True):
        if size <= 0.0:
            least = "a strain above -1" if name == "strain" else "a number above 0"
            raise InputError(f"{path}, line {line}: {name}: expected {least} (got {_cell(row, column.number)})")
    if np.ptp(sizes) == 0.0:
        what = f"the {name}s of a balloon that grows" if name not in ("stretch", "strain") else "a test that stretches"
        raise InputError(f"{path}: {name}: is {told[0]:g} in every row; expected {what}")
    largest = LARGEST_PLAIN_STRAIN if name == "strain" and column.factor == 1.0 else LARGEST_STRETCH
    if name in ("stretch", "strain") and (told.max() > largest or sizes.max() > 1.0 + LARGEST_STRETCH):
        raise InputError(
            f"{path}: {name}: {told.max():g} is beyond any rubber; expected a {name} below {largest:g}, or one "
            "in % with a head that says so, as in: strain [%]"
        )


def _require_loads(path: Path, curve: Curve) -> None:
    """Make sure that loads can be.

    Raises:
        InputError: nothing pulls or presses, or the pressures are absolute.
    """
    loads = curve.loads
    if curve.test != "inflation":
        if not (loads * (curve.sizes - 1.0)).sum() > 0.0:
            raise InputError(
                f"{path}: stress: expected stresses above 0 at stretches above 1 (got {loads.min():g} to "
                f"{loads.max():g} Pa)"
            )
        return
    if loads.max() <= 0.0:
        raise InputError(f"{path}: pressure: expected gauge pressures above 0 (got {loads.max():g} at most)")
    if loads.min() > AIR[0] and loads.max() < AIR[1] * loads.min():
        raise InputError(
            f"{path}: pressure: {loads.min():g} to {loads.max():g} Pa look absolute; expected gauge pressures, "
            "without that of the air"
        )


def _deviations(
    path: Path, rows: Lines, column: Column, deviation: Deviation | None, told: Values, slopes: Values
) -> Values | None:
    """Return the standard deviations of values derived from a column; 0 counts as the least that is more.

    Raises:
        InputError: there is no such number.
    """
    if deviation is None:
        return None
    name = f"deviation of {column.quantity}"
    numbers = np.array([_number(path, line, name, row, deviation.number) for line, row in rows])
    for (line, row), number in zip(rows, numbers, strict=True):
        if number < 0.0:
            raise InputError(
                f"{path}, line {line}: {name}: expected a number of at least 0 (got {_cell(row, deviation.number)})"
            )
    if deviation.relative:
        numbers = 0.01 * numbers * np.abs(told)
    else:
        numbers = numbers * (column.factor if deviation.factor is None else deviation.factor)
    if not numbers.any():
        raise InputError(f"{path}: {name}: is 0 in every row; expected a number above 0")
    return np.maximum(numbers, numbers[numbers > 0.0].min()) * slopes


def _loaded(curve: Curve) -> Curve:
    """Return the rows by size; of a loop those that load, and those that load first if loading again takes less."""
    words = ("deflate", "inflate") if curve.test == "inflation" else ("unload", "load")
    loads, first = rising(curve.sizes)
    taken, remarks = np.ones(len(loads), bool), list(curve.remarks)
    for kept, left_out, what, than in (
        (loads, ~loads, words[0], f"those that {words[1]}"),
        (first, loads & ~first, f"{words[1]} again", f"those that {words[1]} for the first time"),
    ):
        if min(kept.sum(), left_out.sum()) < LEAST_ROWS:
            continue
        drop = drop_of(curve.sizes, curve.loads, kept, left_out)
        if abs(drop) > APART:
            remarks.append(
                f"{left_out.sum()} of {len(loads)} rows {what}, with {_plural(curve.load_name)} "
                f"{100.0 * abs(drop):.2g}% {'lower' if drop > 0.0 else 'higher'} than {than}: only {than} are fitted, "
                "and material.softening may give the others"
            )
            taken &= kept
    order = np.flatnonzero(taken)[np.argsort(curve.sizes[taken], kind="stable")]
    deviations = [None if each is None else each[order] for each in (curve.size_deviations, curve.load_deviations)]
    return replace(
        curve,
        sizes=curve.sizes[order],
        loads=curve.loads[order],
        size_deviations=deviations[0],
        load_deviations=deviations[1],
        remarks=tuple(remarks),
    )


def _plural(name: str) -> str:
    return f"{name}es" if name.endswith("s") else f"{name}s"


def _rows(path: Path) -> Lines:
    """Return the rows that are not empty, with the numbers of their lines; some programs separate by ; or tabs.

    Raises:
        InputError: the file cannot be read.
    """
    data = regular_content(path, LARGEST_TABLE)
    try:
        text = data.decode("utf-16" if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("cp1252", "replace")  # of spreadsheets on Windows
    lines = text.splitlines()
    last = next((line for line in reversed(lines) if re.search(f"[{SEPARATORS}]", line)), "")
    separator = next((each for each in SEPARATORS if each in last), ",")
    if separator != ",":
        lines = [line.replace(",", ".") for line in lines]  # where decimals have commas
    try:
        rows = enumerate(csv.reader(lines, delimiter=separator), start=1)
        return [(line, row) for line, row in rows if any(map(str.strip, row))]
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read as a .csv file: {error}") from None


def _numbers(path: Path, rows: Lines, column: Column) -> Values:
    """Return a column in SI units."""
    return column.factor * np.array([_number(path, line, column.quantity, row, column.number) for line, row in rows])


def _number(path: Path, line: int, name: str, row: Sequence[str], column: int) -> float:
    """Return the number in a column of a row.

    Raises:
        InputError: there is none, or one that cannot be.
    """
    text = _cell(row, column)
    if not text:
        raise InputError(f"{path}, line {line}: {name}: is missing; expected a number in column {column + 1}")
    number = float(text) if _is_number(text) else np.nan
    if not np.isfinite(number):
        raise InputError(f"{path}, line {line}: {name}: expected a number (got {text})")
    return number


def _cell(row: Sequence[str], column: int) -> str:
    return row[column].strip() if column < len(row) else ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True

"""Heads of measured tables: quantity and unit of each column."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from balloon_warp.errors import InputError
from balloon_warp.fitting.quantities import (
    ABSOLUTE,
    CASED,
    DEVIATION,
    EXPECTED,
    FORMS,
    NOMINAL,
    OTHERS,
    PERCENT,
    PRESSURES,
    QUANTITIES,
    SILENT,
    Test,
    without_test,
)

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

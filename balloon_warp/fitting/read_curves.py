"""Files of measured curves: pressure over volume, or stress over stretch."""

import csv
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.files import regular_content
from balloon_warp.fitting.branches import APART, drop_of, rising
from balloon_warp.fitting.columns import Column, Deviation, Pair, pairs_of
from balloon_warp.fitting.measured_curve import Curve
from balloon_warp.fitting.quantities import TESTS, Test, without_test

Values = NDArray[np.float64]
Rows = list[tuple[int, list[str]]]
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
        parts: dict[Test | None, Rows] = {pair.test or said: rows}
        if labels is not None and pair.test is None:
            parts = _by_test(path, rows, labels)
        for test, own in parts.items():
            curve = _curve(path, pair._replace(test=test), own, alone=len(pairs) * len(parts) == 1)
            if curve.test in [other.test for other in curves]:
                raise InputError(f"{path}: has two {curve.test} tests; expected the name of each test in its head")
            curves.append(curve)
    return curves


def _head(rows: Rows) -> tuple[str, list[str]]:
    """Take the rows before the numbers, and return those of one cell, and the names of the columns with their units."""
    title = []
    while len(rows) > 1 and len(list(filter(str.strip, rows[0][1]))) == 1 and not any(map(_is_number, rows[1][1])):
        title += rows.pop(0)[1]
    head = [name.strip() for name in rows.pop(0)[1]]
    if rows and len(rows[0][1]) == len(head) and not any(map(_is_number, rows[0][1])) and all(rows[0][1]):
        head = [f"{name} [{unit.strip('[]() ')}]" for name, unit in zip(head, rows.pop(0)[1], strict=True)]
    return " ".join(title), head


def _by_test(path: Path, rows: Rows, column: int) -> dict[Test | None, Rows]:
    """Return the rows of each test.

    Raises:
        InputError: a row is of none.
    """
    parts: dict[Test | None, Rows] = {}
    for line, row in rows:
        text = row[column].strip() if column < len(row) else ""
        test = without_test(text)[1]
        if test is None:
            raise InputError(f"{path}, line {line}: test: expected one of {', '.join(TESTS)} (got {text or 'nothing'})")
        parts.setdefault(test, []).append((line, row))
    return parts


def _curve(path: Path, pair: Pair, rows: Rows, alone: bool) -> Curve:
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


def _require_sizes(path: Path, rows: Rows, column: Column, told: Values, sizes: Values) -> None:
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
    path: Path, rows: Rows, column: Column, deviation: Deviation | None, told: Values, slopes: Values
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


def _rows(path: Path) -> Rows:
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


def _numbers(path: Path, rows: Rows, column: Column) -> Values:
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

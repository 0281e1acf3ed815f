"""Files of measured curves of pressure over volume."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.fitting.branches import APART, drop_of, inflating
from balloon_warp.fitting.columns import Column, columns_of

Values = NDArray[np.float64]
LEAST_ROWS = 5
AIR = (8.0e4, 1.3)
"""Least pressure [Pa], and largest of the highest over the lowest, of a column that is the air's with little on top"""
SEPARATORS = ",;\t"


@dataclass(frozen=True)
class Curve:
    """A measured curve."""

    volumes: Values
    """Volumes [m^3], shape (n,)"""
    pressures: Values
    """Gauge pressures [Pa], shape (n,)"""
    remarks: tuple[str, ...] = ()
    """Sentences on what was taken of the file"""


def read_curve(path: Path) -> Curve:
    """Read a .csv file of volumes and gauge pressures: the columns of these names, in their units.

    Without a head they are the first two columns, in m^3 and Pa. Of rows that inflate and then deflate with less
    pressure, those that inflate are taken.

    Raises:
        InputError: it cannot be read, its head is not understood, or it has too few rows, or a wrong number.
    """
    rows = _rows(path)
    columns = {"volume": Column(0, 1.0), "pressure": Column(1, 1.0)}
    if rows and not any(map(_is_number, rows[0][1])):
        head = [name.strip() for name in rows.pop(0)[1]]
        if rows and len(rows[0][1]) == len(head) and not any(map(_is_number, rows[0][1])) and all(rows[0][1]):
            head = [f"{name} [{unit.strip('[]() ')}]" for name, unit in zip(head, rows.pop(0)[1], strict=True)]
        columns = columns_of(path, head)
    if len(rows) < LEAST_ROWS:
        raise InputError(f"{path}: expected at least {LEAST_ROWS} rows of a volume and a pressure (got {len(rows)})")
    volumes, pressures = (
        factor * np.array([_number(path, line, name, row, column) for line, row in rows])
        for name, (column, factor) in columns.items()
    )
    if np.ptp(volumes) == 0.0:
        raise InputError(
            f"{path}: volume: is {volumes[0]:g} in every row; expected the volumes of a balloon that grows"
        )
    if pressures.max() <= 0.0:
        raise InputError(f"{path}: pressure: expected gauge pressures above 0 (got {pressures.max():g} at most)")
    if pressures.min() > AIR[0] and pressures.max() < AIR[1] * pressures.min():
        raise InputError(
            f"{path}: pressure: {pressures.min():g} to {pressures.max():g} Pa look absolute; expected gauge pressures, "
            "without that of the air"
        )
    return _loaded(volumes, pressures)


def _loaded(volumes: Values, pressures: Values) -> Curve:
    """Return the rows by volume; of a loop those that inflate."""
    rising, remarks = inflating(volumes), ()
    if LEAST_ROWS <= rising.sum() <= len(rising) - LEAST_ROWS:
        drop = drop_of(volumes, pressures, rising)
        if abs(drop) > APART:
            remarks = (
                f"{(~rising).sum()} of {len(rising)} rows deflate, with pressures {100.0 * drop:.2g}% lower than "
                "inflation's: only those that inflate are fitted, and material.softening may give the others",
            )
            volumes, pressures = volumes[rising], pressures[rising]
    order = np.argsort(volumes)
    return Curve(volumes[order], pressures[order], remarks)


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return the rows that are not empty, with the numbers of their lines; some programs separate by ; or tabs.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        first = text.partition("\n")[0]
        separator = max(SEPARATORS, key=first.count)
        if separator == ";":
            text = text.replace(",", ".")  # where decimals have commas
        rows = enumerate(csv.reader(text.splitlines(), delimiter=separator), start=1)
        return [(line, row) for line, row in rows if any(map(str.strip, row))]
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected a .csv file of a curve") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as a .csv file: {error}") from None


def _number(path: Path, line: int, name: str, row: list[str], column: int) -> float:
    """Return the number in a column of a row.

    Raises:
        InputError: there is none, or one that cannot be.
    """
    text = row[column].strip() if column < len(row) else ""
    if not text:
        raise InputError(f"{path}, line {line}: {name}: is missing; expected a volume [m^3] and a pressure [Pa]")
    number = float(text) if _is_number(text) else np.nan
    if not np.isfinite(number) or (name == "volume" and number <= 0.0):
        expected = "a number above 0" if name == "volume" else "a number"
        raise InputError(f"{path}, line {line}: {name}: expected {expected} (got {text})")
    return number


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True

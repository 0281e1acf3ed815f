"""Files of measured curves of pressure over volume."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError

Values = NDArray[np.float64]
LEAST_ROWS = 5
UNITS = {"volume": ("m^3", "m3", "m³"), "pressure": ("pa",)}
"""Columns, and spellings of their units"""
SEPARATORS = ",;\t"


@dataclass(frozen=True)
class Curve:
    """A measured curve."""

    volumes: Values
    """Volumes [m^3], shape (n,)"""
    pressures: Values
    """Gauge pressures [Pa], shape (n,)"""


def read_curve(path: Path) -> Curve:
    """Read a .csv file of volumes [m^3] and pressures [Pa]: the first two columns, or those of these names.

    Raises:
        InputError: it cannot be read, or has too few rows, or a wrong number.
    """
    rows = _rows(path)
    columns = {"volume": 0, "pressure": 1}
    if rows and not any(map(_is_number, rows[0][1])):
        columns = _named(path, [name.strip().lower() for name in rows.pop(0)[1]]) or columns
    if len(rows) < LEAST_ROWS:
        raise InputError(f"{path}: expected at least {LEAST_ROWS} rows of a volume and a pressure (got {len(rows)})")
    volumes, pressures = (
        np.array([_number(path, line, name, row, column) for line, row in rows]) for name, column in columns.items()
    )
    if np.ptp(volumes) == 0.0:
        raise InputError(
            f"{path}: volume: is {volumes[0]:g} in every row; expected the volumes of a balloon that grows"
        )
    if pressures.max() <= 0.0:
        raise InputError(f"{path}: pressure: expected gauge pressures above 0 (got {pressures.max():g} at most)")
    order = np.argsort(volumes)
    return Curve(volumes[order], pressures[order])


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


def _named(path: Path, head: list[str]) -> dict[str, int] | None:
    """Return the columns by a head that names them.

    Raises:
        InputError: they are in other units.
    """
    words = [name.split()[0] if name else "" for name in head]
    for word, name in zip(words, head, strict=True):
        unit = name.partition("[")[2].rstrip("] ")
        if unit and word in UNITS and unit not in UNITS[word]:
            raise InputError(f"{path}: {word}: expected in {UNITS[word][0].replace('pa', 'Pa')} (got {unit})")
    return {word: words.index(word) for word in UNITS} if set(UNITS) <= set(words) else None


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

"""A batch's summary: a row for each world, as .npz and .csv of the same columns."""

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.outputs.npz import write_npz
from balloon_warp.outputs.table import TableWriter

WORLDS_NAMES = ("worlds.npz", "worlds.csv")
BLOCK = 4096
"""Number of worlds whose rows are formatted together: more would only fill the memory"""
WELL, BLEW_UP = "finished", "blew up"
"""Ending of a world, where nothing else is known of it"""
EXTREMES = {"end": "at the end", "min": "minimum over good frames", "max": "maximum over good frames"}
"""Columns of each measure, by the suffixes of their names"""


def write_worlds(
    npz: Path, text: Path, table: TableWriter, endings: Mapping[int, str], further: Mapping[str, NDArray]
) -> None:
    """Write the two files.

    Args:
        table: with all its frames.
        endings: the known endings of worlds that did not blow up.
        further: the last columns, shape (world_count,) each.
    """
    columns = {**dict(_columns(table, endings)), **further}
    write_npz(npz, columns.items())
    with text.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for begin in range(0, table.world_count, BLOCK):
            block = slice(begin, begin + BLOCK)
            writer.writerows(zip(*(_texts(column[block]) for column in columns.values()), strict=True))


def worlds_columns(varied: list[str], measures: list[str]) -> list[str]:
    """Return the names of the columns, in order."""
    return ["world", *varied, "health", "ending", "last_frame", *(f"{m}_{end}" for m in measures for end in EXTREMES)]


def _columns(table: TableWriter, endings: Mapping[int, str]) -> Iterator[tuple[str, NDArray]]:
    """Return names and values, shape (world_count,); of a world that blew up the last good frame is the end."""
    worlds, good = np.arange(table.world_count, dtype=np.int32), table.health != 0
    health = table.health[-1]
    words = [endings.get(world, WELL) if well else BLEW_UP for world, well in enumerate(health.tolist())]
    values = table.values[-1], table.values.min(axis=0), table.values.max(axis=0)
    measured = (each[number] for number in range(len(table.measures)) for each in values)
    first = [worlds, *table.varied.values(), health, np.array(words), good.sum(axis=0, dtype=np.int32) - 1]
    yield from zip(worlds_columns(list(table.varied), table.measures), [*first, *measured], strict=True)


def _texts(values: NDArray) -> list[str]:
    """Format numbers so that they read back: nine digits of a float32, repr of a float64."""
    if values.dtype == np.float32:
        return [f"{value:.9g}" for value in values.tolist()]
    return [str(value) for value in values.tolist()]

"""Meaning and unit of the columns of a batch's tables, for the manifest."""

from collections.abc import Iterable, Sequence
from typing import Any, cast

from balloon_warp.kernels.laws import LAWS, Law
from balloon_warp.model.law_tables import with_law_tables
from balloon_warp.model.parameters import places_of
from balloon_warp.model.rows import KEYFRAME_VALUES, rows_of
from balloon_warp.model.vary import ALTITUDE
from balloon_warp.outputs.worlds_table import EXTREMES
from balloon_warp.scene import Scene
from balloon_warp.scene.nesting import table_in
from balloon_warp.scene.schema.field_help import meaning_of
from balloon_warp.sweep.contacts import Pair, describe_pairs
from balloon_warp.sweep.groups import SHA256
from balloon_warp.sweep.recorder import columns_of

OF_ROWS = {
    "world": ("1", "number of the world, from 0"),
    "frame": ("1", "number of the frame; 0 is the start"),
    "time": ("s", "simulated time since the start"),
    "health": (
        "1",
        "1 for a good frame; 0 from the frame in which the world blew up, whose rows repeat the last good one; 2 for a "
        "world restarted with shorter steps",
    ),
    "ending": (
        "",
        "finished or blew up; for a world of the stage also the fate of a balloon that ended badly, such as falling or "
        "collapsed",
    ),
    "last_frame": ("1", "number of the last good frame"),
}
"""Unit and meaning of the columns that every table has"""
MEASURED = {
    "volume": ("m^3", "volume enclosed by all balloons"),
    "area": ("m^2", "area of all balloons"),
    "pressure": (
        "Pa",
        "gauge pressure, the mean of all balloons weighted by area; of normal forces, their sum over the area",
    ),
    "center_height": ("m", "height of the balloons' center along the up axis"),
    "largest_stretch": (
        "1",
        "largest length of a spring over its rest length; of rubber or film, the larger principal stretch",
    ),
    "kinetic_energy": ("J", "kinetic energy of all balloons"),
    "in_box": ("1", "number of balloons whose center is in the box"),
    "burst": ("1", "number of balloons that have burst"),
    "moles": ("mol", "amount of gas in all balloons"),
    "mean_stretch": ("1", "square root of the area over that at the start"),
    "thrust": ("N", "thrust of the jets of all necks"),
}
"""Unit and meaning of measured columns"""
KEYFRAMED_UNITS = {"k_normal": "100 N", "pressure": "Pa", "pump": "mol/s"}


def describe_columns(
    scene: Scene, varied: Iterable[str], laws: Sequence[Law] = (), pairs: Sequence[Pair] = ()
) -> dict[str, dict[str, str]]:
    """Describe unit and meaning of each column of `table` and of `worlds`, by name.

    The unit of numbers without one is "1", and that of words is empty.

    Args:
        varied: the paths of values that differ.
        laws: your own.
        pairs: that pressed each other.
    """
    told = dict(OF_ROWS) | {path: (unit, _meaning(path)) for path, unit in units_of(scene, varied, laws).items()}
    for name in columns_of(scene):
        unit, meaning = MEASURED.get(name, ("m", "height of its center along the up axis"))
        told[name] = unit, meaning
        told |= {f"{name}_{end}": (unit, f"{meaning}; {when}") for end, when in EXTREMES.items()}
    told |= describe_pairs(pairs)
    return {name: {"unit": unit, "meaning": meaning} for name, (unit, meaning) in told.items()}


def units_of(scene: Scene, paths: Iterable[str], laws: Sequence[Law]) -> dict[str, str]:
    """Return the units of varied values, by path: "1" of those without one, and nothing of words."""
    rows = rows_of((*LAWS, *laws))
    places, units = places_of(with_law_tables(scene, rows), rows), {row.name: row.unit for row in rows}
    found = {}
    for path in paths:
        name = places[path][0][0] if path in places else ""
        if path == ALTITUDE:
            found[path] = "m"
        elif name == KEYFRAME_VALUES.name:
            found[path] = next(unit for field, unit in KEYFRAMED_UNITS.items() if f".{field}" in path)
        else:
            found[path] = "" if path.endswith((".mesh", SHA256)) else units.get(name, "1")
    return found


def _meaning(path: str) -> str:
    """Return the schema's meaning of a field, or of the end of its path."""
    if path.endswith(SHA256):
        return f"SHA-256 of the file that {path.removesuffix(SHA256)} names, or of a mesh's arrays; in worlds"
    said, table = "", cast("Any", Scene)
    for name in (name for name in path.split(".") if not name.isdecimal()):
        if table is None or name not in table.model_fields:
            return ""  # of a law of one's own
        said, table = meaning_of(table, name), table_in(table.model_fields[name].annotation)
    return said

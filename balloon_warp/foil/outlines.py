"""Polygons with holes that closed lines enclose."""

from collections.abc import Sequence
from importlib import import_module
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import MissingExtraError

FillRule = Literal["nonzero", "evenodd"]
CRUMB = 1e-6
"""Area over that of all polygons below which a polygon is dropped"""


def from_extra(module: str) -> Any:
    """Return a module of a package that foil balloons need.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise MissingExtraError(f"foil balloons need {package}: pip install 'balloon-warp[foil]'") from None


def enclosed(loops: Sequence[NDArray[np.float64]], rule: FillRule = "nonzero") -> list[Any]:
    """Return the polygons of Shapely's that closed lines enclose together, which may run and cross in any way.

    Args:
        loops: points of each, shape (count, 2).
        rule: inside are points that lines wind around, or, "evenodd", wind around an odd number of times.
    """
    shapely = from_extra("shapely")
    loops = [loop for loop in loops if len(np.unique(loop, axis=0)) > 2]
    if not loops:
        return []
    crossed = shapely.union_all([shapely.linearrings(loop) for loop in loops])
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(crossed)))
    within = shapely.get_coordinates(shapely.point_on_surface(faces))
    turns = np.sum([_turns_around(loop, within) for loop in loops], axis=0)
    return united(faces[turns != 0 if rule == "nonzero" else turns % 2 == 1])


def united(polygons: Sequence[Any] | NDArray[Any]) -> list[Any]:
    """Return the polygons with touching ones merged, without crumbs, from left to right."""
    shapely = from_extra("shapely")
    parts = shapely.get_parts(shapely.union_all(polygons))
    areas = shapely.area(parts)
    kept = parts[areas > CRUMB * areas.sum()]
    return kept[np.lexsort(shapely.bounds(kept).T[[1, 0]])].tolist()


def _turns_around(loop: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the winding number of a closed line around each place, counterclockwise, shape (place_count,)."""
    spokes = (loop - places[:, None]) @ [1.0, 1.0j]
    angles = np.angle(np.roll(spokes, -1, axis=1) * spokes.conj())
    return np.round(angles.sum(axis=1) / (2.0 * np.pi)).astype(np.int64)

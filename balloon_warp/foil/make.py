"""Foil balloons of letters and drawings."""

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from balloon_warp.arguments import checked
from balloon_warp.errors import InputError
from balloon_warp.foil.outlines import from_extra
from balloon_warp.foil.sew import sewn
from balloon_warp.foil.sheet import Sheet, sheet_of
from balloon_warp.mesh.polygon_mesh import PolygonMesh

HEIGHT = 0.35
"""Height [m]"""
EDGES = 32
"""Number of edges in the height, where no edge is given"""
MOST_QUADS = 1_000_000
FINEST = 4
"""Largest number of halvings of an edge, until no part is too narrow for it"""


@checked
def foil_mesh(
    source: str | Path, height: float = HEIGHT, edge: float | None = None, font: str | None = None
) -> PolygonMesh:
    """Make the mesh of a foil balloon that is not inflated yet: two flat sheets of even quads, sewn at the rim.

    Each letter, or part of a drawing, is a component of its own; `foil_parts` has them apart. It stands in the plane of
    x and y, on y = 0, about x = 0.

    Args:
        source: Line of text; or the path of a drawing, an `.svg` file.
        height: Height of the whole [m].
        edge: Approximate edge length [m]; a 32nd of the height, and less where it is narrow, if not given.
        font: Font of text: a file, or a family of the machine's; DejaVu Sans Bold if not given.

    Raises:
        InputError: nothing is drawn, or it cannot be read, or is too narrow for the edge.
        MissingExtraError: a package of the extra `foil` is not installed.
    """
    return sewn(*_sheets(source, height, edge, font))


@checked
def foil_parts(
    source: str | Path, height: float = HEIGHT, edge: float | None = None, font: str | None = None
) -> list[PolygonMesh]:
    """Make a foil mesh for each letter or part of a drawing, as `foil_mesh`.

    They come from left to right, each in its place, so that each can be a balloon of its own.
    """
    sheets, size, name = _sheets(source, height, edge, font)
    return [sewn([sheet], size, f"{name} {number}") for number, sheet in enumerate(sheets, start=1)]


def joined(meshes: Sequence[PolygonMesh], name: str) -> PolygonMesh:
    """Return the parts as one mesh of several components."""
    firsts = np.cumsum([0, *(mesh.vertex_count for mesh in meshes)])[:-1]
    numbers = [mesh.face_vertex_indices + first for mesh, first in zip(meshes, firsts.tolist(), strict=True)]
    return PolygonMesh(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.face_vertex_counts for mesh in meshes]),
        np.concatenate(numbers).astype(np.int32),
        name,
    )


def _sheets(source: str | Path, height: float, edge: float | None, font: str | None) -> tuple[list[Sheet], float, str]:
    """Make the sheets, and say about how long their edges are [m], and a name."""
    for name, value in (("height", height), ("edge", edge)):
        if value is not None and not (isfinite(value) and value > 0.0):
            raise InputError(f"{name}: must be a number greater than 0 (got {value})")
    is_drawing = Path(source).suffix.lower() == ".svg"
    if is_drawing:
        from balloon_warp.foil.drawing import outlines_of_drawing

        outlines, name = outlines_of_drawing(Path(source)), Path(source).stem
    else:
        from balloon_warp.foil.letters import outlines_of_text

        outlines, name = outlines_of_text(str(source), font), str(source)
    outlines = _placed(outlines, height)
    size = edge or height / EDGES
    count = 2.0 * sum(outline.area for outline in outlines) / size**2
    if count > MOST_QUADS:
        raise InputError(
            f"edge: {size:g} m makes {count:.2g} quads; expected at most {MOST_QUADS:,}, with longer edges"
        )
    parts = enumerate(outlines, start=1)
    sheets = [_sheet(outline, size, edge is not None, f"{name}, part {part}") for part, outline in parts]
    return sheets, size, name


def _placed(outlines: list[Any], height: float) -> list[Any]:
    """Return the outlines at the given height, standing on y = 0, about x = 0."""
    shapely = from_extra("shapely")
    left, low, right, high = shapely.total_bounds(outlines)
    scale, origin = height / (high - low), (0.5 * (left + right), low)
    return [shapely.transform(outline, lambda places: (places - origin) * scale) for outline in outlines]


def _sheet(outline: Any, edge: float, as_asked: bool, what: str) -> Sheet:
    """Make a sheet of such edges; of shorter ones if it is too narrow, unless they are asked for."""
    for halvings in range(FINEST + 1):
        finer = edge * 0.5**halvings
        if sheet := sheet_of(outline, finer):
            if halvings and as_asked:
                raise InputError(f"edge: {what} is too narrow for {edge:g} m; expected {finer:g} or less")
            return sheet
    raise InputError(f"{what} is too narrow for even quads; expected a bolder shape, or blunter corners")

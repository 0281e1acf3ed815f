"""The squares of a grid that lie well within an outline, and the loops around them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.components import component_labels

MARGIN = 0.5
"""Least distance of the kept squares from the outline [squares]; at most one more, so that a square fits between"""
AROUND = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
"""Corners of a square, counterclockwise"""


@dataclass(frozen=True)
class Squares:
    """Squares that hang together by their edges, as a mesh of quads."""

    points: NDArray[np.float64]
    """Points, shape (vertex_count, 2)"""
    quads: NDArray[np.int64]
    """Quads, counterclockwise, shape (quad_count, 4)"""
    loops: list[NDArray[np.int64]]
    """Vertices along each border, with the squares on the left"""


def squares_within(outline: Any, edge: float, shift: tuple[float, float]) -> Squares | None:
    """Return the squares of a grid within a polygon of Shapely's; None where there are none.

    Args:
        edge: of a square.
        shift: of the grid, in squares, from where its middle is the outline's.
    """
    lower, upper = np.reshape(outline.bounds, (2, 2))
    count = np.ceil((upper - lower) / edge).astype(int) + 2
    first = 0.5 * (lower + upper) - 0.5 * count * edge + edge * np.array(shift)
    kept = _largest_part(_without_pinches(_kept(outline, first, count, edge)))
    if not kept.any():
        return None
    corners = np.argwhere(kept)[:, None] + AROUND
    numbers = corners @ [count[1] + 1, 1]
    used, quads = np.unique(numbers, return_inverse=True)
    points = first + edge * np.stack(np.divmod(used, count[1] + 1), axis=1)
    quads = quads.reshape(-1, 4)
    return Squares(points, quads, border_loops(quads))


def _kept(outline: Any, first: NDArray[np.float64], count: NDArray[np.int64], edge: float) -> NDArray[np.bool_]:
    """Return a mask of the grid's squares that lie within the outline by the margin, shape of `count`."""
    import shapely

    within = outline.buffer(-MARGIN * edge)
    shapely.prepare(within)
    lower = first + edge * np.argwhere(np.ones(count, dtype=bool))
    boxes = shapely.box(*lower.T, *(lower + edge).T)
    return np.asarray(shapely.contains_properly(within, boxes)).reshape(count)


def _without_pinches(kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask without one of each two squares that touch at a corner alone, until there are none."""
    kept = np.pad(kept, 1)
    while True:
        here, right, above, across = kept[:-1, :-1], kept[1:, :-1], kept[:-1, 1:], kept[1:, 1:]
        rising = here & across & ~right & ~above
        falling = right & above & ~here & ~across
        if not (rising | falling).any():
            return kept[1:-1, 1:-1]
        kept[:-1, :-1] &= ~rising
        kept[:-1, 1:] &= ~falling


def _largest_part(kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the squares alone that hang together with most others, by edges."""
    number = np.arange(kept.size).reshape(kept.shape)
    beside, above = kept[1:] & kept[:-1], kept[:, 1:] & kept[:, :-1]
    first = np.concatenate([number[1:][beside], number[:, 1:][above]])
    second = np.concatenate([number[:-1][beside], number[:, :-1][above]])
    labels = component_labels(kept.size, first, second).reshape(kept.shape)
    return kept & (labels == np.bincount(labels[kept], minlength=1).argmax())


def border_loops(quads: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return the vertices along each border of counterclockwise quads, with the quads on the left.

    No vertex is in two.
    """
    begin, end = quads.ravel(), np.roll(quads, -1, axis=1).ravel()
    inner = {(b, a) for a, b in zip(begin.tolist(), end.tolist(), strict=True)}
    following = {a: b for a, b in zip(begin.tolist(), end.tolist(), strict=True) if (a, b) not in inner}
    loops = []
    while following:
        start, vertex = following.popitem()
        loop = [start]
        while vertex != start:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop))
    return loops

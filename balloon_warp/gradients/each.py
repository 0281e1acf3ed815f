"""Derivatives by values of each spring, face and vertex: from those of a model's springs and triangles to arrays."""

from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.model import Model, ModelPlan
from balloon_warp.model.shape import BalloonShape
from balloon_warp.springs.membrane import build_membrane

Values = NDArray[np.float64]
OF_SPRINGS = ("rest_lengths", "spring_constants")
KNOWN = (*OF_SPRINGS, "thicknesses", "rest_points")
"""Names of values of each spring, each face, and each vertex of a shape at rest"""


def require_each(plan: ModelPlan, names: Sequence[str]) -> None:
    """Make sure that a scene has the springs, membranes or rest points by whose values is derived.

    Raises:
        InputError: it has not.
    """
    if isinstance(names, str) or not names:
        raise InputError(f"each: expected a list of some of {', '.join(KNOWN)} (got {names!r})")
    for name in names:
        if name not in KNOWN:
            raise InputError(f"each: expected some of {', '.join(KNOWN)} (got {name!r})")
        if name in OF_SPRINGS and not any(shape.springs.count for shape in plan.shapes):
            raise InputError(f"each: {name}: the scene has no springs")
        if name == "thicknesses" and not any(shape.membrane.count for shape in plan.shapes):
            raise InputError(f"each: {name}: the scene has no rubber or film, which has a thickness")
        for shape in plan.shapes if name == "rest_points" else ():
            if not _rests_by_points(shape):
                raise InputError(
                    f"each: {name}: springs of {shape.name} have lengths at rest of their own; expected rest_lengths"
                )


def by_each(
    plan: ModelPlan, model: Model, found: tuple[Values, Values], names: Sequence[str]
) -> dict[str, list[Values]]:
    """Return derivatives by name, an array for each balloon, worlds first.

    Args:
        found: bars of springs and triangles, see `EachBackward.found`.
    """
    of_springs = _by_balloon(found[0], [shape.springs.count for shape in plan.shapes])
    of_triangles = _by_balloon(found[1], [shape.membrane.count for shape in plan.shapes])
    thickness = np.asarray(model.parameters["thickness"].numpy(), dtype=np.float64)
    makers: dict[str, Callable[[int, BalloonShape], Values]] = {
        "rest_lengths": lambda number, shape: of_springs[number][..., 0],
        "spring_constants": lambda number, shape: of_springs[number][..., 1],
        "thicknesses": lambda number, shape: _by_thicknesses(shape, of_triangles[number], thickness[:, number]),
        "rest_points": lambda number, shape: (
            _by_points_of_springs(shape, of_springs[number][..., 0]) + _by_points_of_film(shape, of_triangles[number])
        ),
    }
    return {name: [makers[name](*each) for each in enumerate(plan.shapes)] for name in names}


def _by_balloon(array: Values, counts: Sequence[int]) -> list[Values]:
    return [array[:, begin:end] for begin, end in pairwise(accumulate(counts, initial=0))]


def _rests_by_points(shape: BalloonShape) -> bool:
    """Return whether springs are at rest as long as the vertices of the shape at rest are apart."""
    springs, resting = shape.springs, shape.resting.points
    return not springs.count or np.allclose(springs.resting_at(resting).rest_lengths, springs.rest_lengths, rtol=1e-9)


def _by_thicknesses(shape: BalloonShape, bars: Values, thickness: Values) -> Values:
    """Return derivatives by the thickness of each face, shape (W, face_count), of those by the areas of triangles."""
    if not shape.membrane.count:
        return np.zeros((len(bars), shape.mesh.face_count))
    areas = build_membrane(shape.resting).areas  # without weights, which are part of a thickness
    return _gathered(bars[..., 3] * areas / thickness[:, None], shape.membrane.faces, shape.mesh.face_count)


def _by_points_of_springs(shape: BalloonShape, bars: Values) -> Values:
    """Return derivatives by the shape at rest, shape (W, n, 3), of those by rest lengths."""
    ends, points = shape.springs.pairs, shape.resting.points
    apart = points[ends[:, 1]] - points[ends[:, 0]]
    lengths = np.linalg.norm(apart, axis=1, keepdims=True)
    along = bars[..., None] * np.divide(apart, lengths, out=np.zeros_like(apart), where=lengths > 0.0)
    count = shape.resting.vertex_count
    return _gathered(along, ends[:, 1], count) - _gathered(along, ends[:, 0], count)


def _by_points_of_film(shape: BalloonShape, bars: Values) -> Values:
    """Return derivatives by the shape at rest, shape (W, n, 3), of those by each triangle's metric C and area A.

    C = (E^T E)^-1 for edges E as columns, and A is half the root of det E^T E. So with the bars' symmetric matrix B,
    E's bar is -2 E C B C + A bar(A) E C.
    """
    count = shape.resting.vertex_count
    if not shape.membrane.count:
        return np.zeros((len(bars), count, 3))
    rests, edges = shape.membrane.rests, shape.membrane.edges
    squares, halves = np.array([[0, 1], [1, 2]]), np.array([[1.0, 0.5], [0.5, 1.0]])
    metric, by_metric = rests[:, squares], bars[..., squares] * halves
    inner = -2.0 * metric @ by_metric @ metric + (bars[..., 3] * rests[:, 3])[..., None, None] * metric
    by_edges = inner @ edges * (1.0 - shape.membrane.cut)  # symmetric matrices times rows of edges
    corners = build_membrane(shape.resting).corners  # of panels, before they are sewn
    by_corners = (-by_edges.sum(axis=2), by_edges[..., 0, :], by_edges[..., 1, :])
    return sum(
        (_gathered(part, corners[:, column], count) for column, part in enumerate(by_corners)),
        start=np.zeros((len(bars), count, 3)),
    )


def _gathered(values: Values, places: NDArray[np.integer], count: int) -> Values:
    """Return the sums of values at each place, shape (W, count, ...), of values of shape (W, m, ...)."""
    totals = np.zeros((count, len(values), *values.shape[2:]))
    np.add.at(totals, places, values.swapaxes(0, 1))
    return totals.swapaxes(0, 1)

"""Chain rule from a path of a scene to the numbers that kernels read: how fast each grows with the path's value.

Derived parameters of a plan, such as a mass from a density or an amount of gas from a pressure, are smooth and in
double precision. So differences of two plans give their derivatives.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.gradients.obstacles import is_of_motion, slopes_of_motion
from balloon_warp.gradients.spans import Slopes, slopes_of_change, slopes_of_spans
from balloon_warp.model import ModelPlan, Vary
from balloon_warp.model.parameters import is_numbered, parameters_at, places_of
from balloon_warp.model.plan import settled_parameters
from balloon_warp.model.rows import rows_of
from balloon_warp.model.vary import vary_parameters
from balloon_warp.scene.overrides import override_scene

REACH = 1e-4
"""Half of the difference, over the value, or over 1 where that is 0: its error is a hundred millionth"""


@dataclass(frozen=True)
class Chain:
    """Hold the slopes of a plan's parameters by the value at one path."""

    path: str
    spans: tuple[Slopes, ...]
    """Slopes by parameter name, shape (world_count, ...) as in the plan, between changes; none where it is 0"""

    @property
    def slopes(self) -> Slopes:
        """Slopes at the start."""
        return self.spans[0]


def chains_of(plan: ModelPlan, paths: Sequence[str], vary: Vary) -> list[Chain]:
    """Return the slopes by each path.

    Raises:
        InputError: a path is not there, cannot be derived by, or is of several values.
    """
    if isinstance(paths, str) or not paths:
        raise InputError(f"of: expected a list of paths, such as balloon.inflation.amount (got {str(paths)!r})")
    return [Chain(path, _spans(plan, path, vary)) for path in dict.fromkeys(paths)]


def _spans(plan: ModelPlan, path: str, vary: Vary) -> tuple[Slopes, ...]:
    if path.startswith("change."):
        return slopes_of_change(plan, path)
    if is_of_motion(path):
        return slopes_of_spans(plan, slopes_of_motion(plan, path))
    return slopes_of_spans(plan, _slopes(plan, path, vary))


def _slopes(plan: ModelPlan, path: str, vary: Vary) -> Slopes:
    value = value_in_worlds(plan, path, vary)
    reach = REACH * np.where(value == 0.0, 1.0, np.abs(value))
    sides = {}
    for sign in (1.0, -1.0, 2.0):
        try:
            sides[sign] = settled_parameters(plan, {**vary, path: value + sign * reach})
        except InputError:
            if sign == 1.0:
                raise
        if len(sides) == 2:
            break
    if len(sides) < 2:
        raise InputError(f"{path}: cannot be derived by, since its value can neither grow nor fall")
    here = settled_parameters(plan, {**vary, path: value})
    slopes = {}
    for name, more in sides[1.0].items():
        if -1.0 in sides:
            change = more - sides[-1.0][name]
            slope = change / 2.0
        else:  # at a bound
            change = more - here[name]
            slope = 2.0 * change - (sides[2.0][name] - here[name]) / 2.0
        if np.isfinite(change).all() and change.any():
            each = np.broadcast_to(slope, (plan.world_count, *slope.shape[1:]))
            slopes[name] = each / reach.reshape(-1, *([1] * (each.ndim - 1)))
    return slopes


def value_in_worlds(plan: ModelPlan, path: str, vary: Vary) -> NDArray[np.float64]:
    """Return the value at a path in each world, shape (world_count,).

    Raises:
        InputError: the path leads to no number, to several, or to one that the scene leaves open.
    """
    rows = rows_of(plan.laws)
    said = vary_parameters(parameters_at(plan.scene, rows, 0), plan.scene, rows, plan.world_count, vary)
    places = places_of(plan.scene, rows)
    if path not in places:
        _refuse(plan, path)
    columns = []
    for name, index in places[path]:
        values = np.broadcast_to(said[name], (plan.world_count, *said[name].shape[1:]))[(slice(None), *index)]
        columns += list(values.reshape(plan.world_count, -1).T)
    if any((column != columns[0]).any() and not np.isnan(column).all() for column in columns):
        listed = ", ".join(f"{column[0]:g}" for column in columns[:4])
        one = "one of them" if is_numbered(path) else f"the path of one of them, such as {_numbered(path)}"
        raise InputError(f"{path}: stands for several values, {listed}; expected {one}")
    if np.isnan(columns[0]).any():
        raise InputError(f"{path}: the scene leaves it open; expected a value there, or in `vary`")
    return columns[0]


def _refuse(plan: ModelPlan, path: str) -> NoReturn:
    """Raise the error of a path that leads to no parameter."""
    try:
        override_scene(plan.scene, [(path, 1.0)])
    except InputError as mistake:
        if "unknown" in str(mistake) or "there is no" in str(mistake):
            raise
    raise InputError(f"{path}: cannot be derived by; expected the path of a number, such as balloon.mass")


def _numbered(path: str) -> str:
    table, _, field = path.partition(".")
    return f"{table}.0.{field}"


def product(slopes: NDArray[np.float64], bars: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum over all numbers of a parameter of slope times bar, shape (world_count,)."""
    return np.array([float(np.dot(a.ravel(), b.ravel())) for a, b in zip(slopes, bars, strict=True)])


def names_in(chains: Sequence[Chain]) -> Mapping[str, Any]:
    """Return the names of all parameters that change."""
    return dict.fromkeys(name for chain in chains for slopes in chain.spans for name in slopes)

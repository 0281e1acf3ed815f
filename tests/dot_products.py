"""The adjoint identity u . (J w) = (u J) . w of the end of a run by its start, with J w by differences in float64."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import balloon_warp as bw
from balloon_warp.trajectories import Trajectories

Parts = list[np.ndarray]
"""An array for each balloon"""
Ends = Callable[[dict[str, float], tuple[Any, Any]], tuple[Parts, Parts, Mapping[str, np.ndarray]]]
"""Function from values, and from shifts of all places and velocities at the start, to places, velocities and more at
the end, in double precision"""
H = 1e-6


def require_adjoint(of: bw.Scene, ends: Ends, values: Mapping[str, float], device: str) -> None:
    """Check the identity for random u and w, to 1e-5 of what the largest of places, velocities and values adds: sums
    over all of them, whose rounding in float32 is a few 1e-7 each.

    Args:
        values: by which is derived, too, besides all places and velocities.
    """
    back, ahead, largest = _both_sides(of, ends, values, device)
    assert abs(back - ahead) < 1e-5 * largest


def _both_sides(of: bw.Scene, ends: Ends, values: Mapping[str, float], device: str) -> tuple[float, float, float]:
    """Return (u J) . w by a gradient, u . (J w) by differences, and the largest part of the former."""
    rng = np.random.default_rng(11)
    told = ends({}, (0.0, 0.0))
    sizes = [len(part) for part in told[0]]
    shifts = [scale * rng.normal(size=(sum(sizes), 3)) for scale in (0.05, 1.0)]
    ahead = {path: 0.1 * (abs(value) or 1.0) * rng.normal() for path, value in values.items()}
    weights = [[rng.normal(size=part.shape) for part in parts] for parts in told[:2]]
    beside = {name: rng.normal(size=track.shape) for name, track in told[2].items()}
    found = bw.gradient(of, of=list(values), loss=_weighted(weights, beside), device=device)
    parts = [(np.concatenate(found.by_points) * shifts[0]).sum()]
    parts += [(np.concatenate(found.by_velocities) * shifts[1]).sum()]
    parts += [found.gradients[path][0] * step for path, step in ahead.items()]
    both = []
    for sign in (1.0, -1.0):
        moved = {path: value + sign * H * ahead[path] for path, value in values.items()}
        points, velocities, more = ends(moved, (sign * H * shifts[0], sign * H * shifts[1]))
        pairs = [*zip(weights[0], points, strict=True), *zip(weights[1], velocities, strict=True)]
        pairs += [(weight, more[name]) for name, weight in beside.items()]
        both.append(sum((weight * end).sum() for weight, end in pairs))
    return sum(parts), (both[0] - both[1]) / (2.0 * H), max(map(abs, parts))


def _weighted(weights: Sequence[Parts], beside: Mapping[str, np.ndarray]) -> Any:
    def loss(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
        value, slopes = 0.0, {}
        for name, own in zip(("points", "velocities"), weights, strict=True):
            tracks = getattr(moved, name)
            slopes[name] = [np.zeros(track.shape) for track in tracks]
            for slope, weight, track in zip(slopes[name], own, tracks, strict=True):
                slope[-1] = weight
                value += (weight * track[-1]).sum()
        for name, weight in beside.items():
            track = getattr(moved, name)
            slopes[name] = np.zeros(track.shape)
            slopes[name][-1] = weight
            value += (weight * track[-1]).sum()
        return value, slopes

    return loss

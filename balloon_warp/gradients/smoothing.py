"""Gradients averaged over worlds that differ by a little: where motion is chaotic, that of one path says little."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.gradients.chain import value_in_worlds
from balloon_warp.gradients.derive import Asked, Gradient
from balloon_warp.model.plan import ModelPlan

Values = NDArray[np.float64]


def sampled(plan: ModelPlan, asked: Asked, smooth: Mapping[str, float], samples: int) -> Asked:
    """Return the request for `samples` worlds in place of each, whose values scatter around its own.

    Values are normally distributed: quantiles of equal weight, in another order by each path (Latin hypercube).

    Args:
        smooth: standard deviations by paths.

    Raises:
        InputError: a deviation is not positive, there are too few samples, or a path is not that of a number.
    """
    if samples < 2:
        raise InputError(f"samples: expected at least 2 (got {samples})")
    vary = {path: np.repeat(np.asarray(values, dtype=np.float64), samples) for path, values in asked.vary.items()}
    for path, (deviation, column) in zip(smooth, _columns(smooth, samples), strict=True):
        if not (np.isfinite(deviation) and deviation > 0.0):
            raise InputError(f"smooth: {path}: expected a standard deviation above 0 (got {deviation:g})")
        values = value_in_worlds(plan, path, asked.vary)
        vary[path] = np.repeat(values, samples) + deviation * np.tile(column, asked.world_count)
    return asked._replace(world_count=asked.world_count * samples, vary=vary)


def averaged(found: Gradient, smooth: Mapping[str, float], samples: int) -> Gradient:
    """Return the means over the samples of each world, and the slopes of the loss over them.

    The trajectories stay those of all samples.
    """
    losses = found.loss.reshape(-1, samples)
    slopes = {}
    for path, (deviation, column) in zip(smooth, _columns(smooth, samples), strict=True):
        slopes[path] = losses @ column / (deviation * (column @ column))
    gradients = {path: values.reshape(-1, samples) for path, values in found.gradients.items()}

    def means(arrays: list[Values]) -> list[Values]:
        each = [array.reshape(-1, samples, *array.shape[1:]).mean(axis=1) for array in arrays]
        return [array[0] for array in each] if len(losses) == 1 else each

    return replace(
        found,
        loss=losses.mean(axis=1),
        gradients={path: values.mean(axis=1) for path, values in gradients.items()},
        by_points=means(found.by_points),
        by_velocities=means(found.by_velocities),
        by_each={name: means(arrays) for name, arrays in found.by_each.items()},
        errors={path: values.std(axis=1, ddof=1) / samples**0.5 for path, values in gradients.items()},
        slopes=slopes,
    )


def _columns(smooth: Mapping[str, float], samples: int) -> list[tuple[float, Values]]:
    """Return each path's deviation, and the offsets of its samples in that unit, shape (samples,)."""
    from scipy.special import ndtri

    quantiles, order = np.array(ndtri((np.arange(samples) + 0.5) / samples)), np.random.default_rng(0)
    return [(deviation, quantiles[order.permutation(samples)]) for deviation in smooth.values()]

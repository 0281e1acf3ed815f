"""Common losses, for `gradient` and `fit`: how far a balloon is from a place, a height or a volume.

`of_torch` and `of_jax` make one of a function of PyTorch or JAX.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.batch.trajectories import Trajectories
from balloon_warp.errors import InputError
from balloon_warp.lab.gradients.derive import Loss
from balloon_warp.lab.gradients.frameworks import of_jax as of_jax
from balloon_warp.lab.gradients.frameworks import of_kernel
from balloon_warp.lab.gradients.frameworks import of_torch as of_torch

Values = NDArray[np.float64]


def distance(target: ArrayLike, *, balloon: int = 0, frame: int | None = -1) -> Loss:
    """Return the loss that is a balloon's mean squared distance from a target [m^2].

    Args:
        target: a place [m], shape (3,), for the mean of the balloon's particles; or one for each particle, shape
            (particle_count, 3).
        frame: whose places count; all, when None.
    """
    to = np.asarray(target, dtype=np.float64)
    if to.ndim not in (1, 2) or to.shape[-1] != 3 or not np.isfinite(to).all():
        raise InputError(f"distance: target: expected a place, three numbers, or one a particle (got shape {to.shape})")

    def loss(moved: Trajectories) -> tuple[Values, dict[str, Any]]:
        track = _track(moved, balloon, "distance")
        seen, count = _chosen(track, frame), track.shape[-2]
        if to.ndim == 2 and len(to) != count:
            raise InputError(f"distance: target: expected {count} places, one a particle (got {len(to)})")
        off = (seen.mean(axis=-2, keepdims=True) if to.ndim == 1 else seen) - to
        slopes = np.zeros(track.shape)
        _chosen(slopes, frame)[...] = 2.0 * off / (count * seen.shape[-3])
        return (off**2).sum(axis=-1).mean(axis=(-1, -2)), _by_points(moved, balloon, slopes)

    return loss


def height(target: float, *, balloon: int = 0, frame: int | None = -1) -> Loss:
    """Return the loss that is the squared distance of a balloon's mean height from a target [m^2].

    Args:
        target: height along the scene's up axis [m].
        frame: whose height counts; all, when None.
    """

    def loss(moved: Trajectories) -> tuple[Values, dict[str, Any]]:
        track, up = _track(moved, balloon, "height"), np.array(moved.scene.up)
        seen = _chosen(track, frame)
        off = (seen @ up).mean(axis=-1) - target
        slopes = np.zeros(track.shape)
        _chosen(slopes, frame)[...] = (2.0 * off / (track.shape[-2] * off.shape[-1]))[..., None, None] * up
        return (off**2).mean(axis=-1), _by_points(moved, balloon, slopes)

    return loss


def volume(target: float, *, balloon: int = 0, frame: int | None = -1) -> Loss:
    """Return the loss that is the squared difference of a balloon's volume from a target [m^6].

    Args:
        target: volume [m^3].
        frame: whose volume counts; all, when None.
    """
    return _of_numbers("volumes", target, balloon, frame)


def pressure(target: float, *, balloon: int = 0, frame: int | None = -1) -> Loss:
    """Return the loss that is the squared difference of a balloon's pressure from a target [Pa^2].

    Args:
        target: gauge pressure [Pa].
        frame: whose pressure counts; all, when None.
    """
    return _of_numbers("pressures", target, balloon, frame)


def together(losses: Sequence[Loss], weights: Sequence[float] | None = None) -> Loss:
    """Return the loss that is a weighted sum of losses.

    Args:
        weights: of each; 1, when missing.
    """
    parts = [1.0] * len(losses) if weights is None else list(weights)
    if len(parts) != len(losses) or not losses:
        raise InputError(f"together: expected a weight for each of {len(losses)} losses (got {len(parts)})")

    def loss(moved: Trajectories) -> tuple[Values, dict[str, Any]]:
        total, slopes = np.zeros(()), {}
        for each, weight in zip(losses, parts, strict=True):
            value, found = (of_kernel(each) if isinstance(each, wp.Kernel) else each)(moved)
            total = total + weight * np.asarray(value, dtype=np.float64)
            for name, arrays in found.items():
                slopes[name] = _plus(slopes.get(name), arrays, weight)
        return total, slopes

    return loss


def _of_numbers(name: str, target: float, balloon: int, frame: int | None) -> Loss:
    def loss(moved: Trajectories) -> tuple[Values, dict[str, Any]]:
        track = np.asarray(getattr(moved, name), dtype=np.float64)
        off = track[..., balloon] - target if frame is None else track[..., frame, balloon][..., None] - target
        slopes = np.zeros(track.shape)
        if frame is None:
            slopes[..., balloon] = 2.0 * off / off.shape[-1]
        else:
            slopes[..., frame, balloon] = 2.0 * off[..., 0]
        return (off**2).mean(axis=-1), {name: slopes}

    return loss


def _track(moved: Trajectories, balloon: int, name: str) -> Values:
    if not 0 <= balloon < len(moved.points):
        raise InputError(f"{name}: balloon: expected a number below {len(moved.points)} (got {balloon})")
    return moved.points[balloon].astype(np.float64)


def _chosen(track: Values, frame: int | None) -> Values:
    """Return a view of the frames that count, worlds first, if there are several."""
    count = track.shape[-3]
    if frame is None:
        return track
    if not -count <= frame < count:
        raise InputError(f"frame: expected a number from {-count} to {count - 1} (got {frame})")
    return track[..., frame % count : frame % count + 1, :, :]


def _by_points(moved: Trajectories, balloon: int, slopes: Values) -> dict[str, Any]:
    others = [np.zeros(track.shape) for track in moved.points[:balloon]]
    return {"points": [*others, slopes]}


def _plus(before: Any, more: Any, weight: float) -> Any:
    """Return derivatives plus others times a weight: arrays, or lists of them by balloon."""
    if isinstance(more, list | tuple):
        begun = list(before or [])
        for place, array in enumerate(more):
            scaled = weight * np.asarray(array, dtype=np.float64)
            if place < len(begun):
                begun[place] = begun[place] + scaled
            else:
                begun.append(scaled)
        return begun
    scaled = weight * np.asarray(more, dtype=np.float64)
    return scaled if before is None else before + scaled

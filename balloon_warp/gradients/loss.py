"""Check the value and the derivatives that a loss returns for trajectories: a number a world, and arrays."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.gradients.frameworks import of_kernel
from balloon_warp.model.shape import BalloonShape
from balloon_warp.statics.volume import Volume
from balloon_warp.trajectories import Trajectories

Loss = Callable[[Trajectories], tuple[Any, Mapping[str, Any]]] | wp.Kernel
"""Function from trajectories to a number for each world, and a dictionary of its derivatives: by `points` and
`velocities`, a list of arrays by balloon, and by `volumes`, `pressures`, `sphere_positions` and `sphere_velocities`,
each of the shape that it has there. Or a kernel of Warp, see `frameworks.of_kernel`"""
KNOWN = ("points", "velocities", "volumes", "pressures", "sphere_positions", "sphere_velocities")


class Told(NamedTuple):
    """Hold a loss and its derivatives, worlds first."""

    loss: NDArray[np.float64]
    points: NDArray[np.float64]
    """Shape (world_count, frame_count, particle_count, 3)"""
    velocities: NDArray[np.float64]
    pressures: NDArray[np.float64]
    """Shape (world_count, frame_count, balloon_count)"""
    sphere_positions: NDArray[np.float64]
    """Shape (world_count, frame_count, sphere_count, 3)"""
    sphere_velocities: NDArray[np.float64]

    @property
    def depends(self) -> bool:
        """Return whether the loss depends on anything."""
        return any(array.any() for array in self[1:])


def told_by(loss: Loss, moved: Trajectories, shapes: Sequence[BalloonShape], world_count: int) -> Told:
    """Evaluate a loss.

    Raises:
        InputError: its result is not a number for each world, and a dictionary of derivatives.
    """
    told = (of_kernel(loss) if isinstance(loss, wp.Kernel) else loss)(moved)
    if not (isinstance(told, tuple) and len(told) == 2 and isinstance(told[1], Mapping)):
        raise InputError(
            "loss: expected two things, a number for each world and a dictionary of derivatives such as "
            f'{{"points": [...]}} (got {type(told).__name__})'
        )
    value, slopes = np.asarray(told[0], dtype=np.float64), told[1]
    if value.shape not in ((world_count,), () if world_count == 1 else (world_count,)):
        raise InputError(f"loss: expected a number for each of {world_count} worlds (got shape {value.shape})")
    if not np.isfinite(value).all():
        raise InputError(f"loss: is not finite in world {int(np.argmin(np.isfinite(value.reshape(-1))))}")
    for name in slopes:
        if name not in KNOWN:
            raise InputError(f"loss: has no derivatives by {name}; what it can have is {', '.join(KNOWN)}")
    particles = [_of_balloons(slopes, name, getattr(moved, name)) for name in ("points", "velocities")]
    by_points, by_velocities = (_worlds_first(each, world_count, 4) for each in particles)
    by_volumes, by_pressures, *by_spheres = (
        _worlds_first(_one(slopes, name, getattr(moved, name).shape), world_count, dimensions)
        if name in slopes
        else np.zeros((*by_points.shape[:2], *getattr(moved, name).shape[2 - dimensions :]))
        for name, dimensions in (("volumes", 3), ("pressures", 3), ("sphere_positions", 4), ("sphere_velocities", 4))
    )
    _add_volumes(by_points, by_volumes, moved, shapes)
    return Told(value.reshape(world_count), by_points, by_velocities, by_pressures, *by_spheres)


def _one(slopes: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return derivatives as numbers of a shape."""
    try:
        array = np.asarray(slopes[name], dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"loss: its derivatives by {name} must be numbers of shape {shape}") from None
    if array.shape != shape:
        raise InputError(f"loss: its derivatives by {name} must have the shape {shape} (got {array.shape})")
    if not np.isfinite(array).all():
        raise InputError(f"loss: its derivatives by {name} are not finite")
    return array


def _of_balloons(slopes: Mapping[str, Any], name: str, tracks: Sequence[NDArray]) -> NDArray[np.float64]:
    """Return derivatives by all particles, of a list by balloon; those of balloons that it lacks are 0."""
    if name not in slopes:
        return np.concatenate([np.zeros(track.shape) for track in tracks], axis=-2)
    given = slopes[name]
    if not isinstance(given, list | tuple) or len(given) > len(tracks):
        raise InputError(f"loss: its derivatives by {name} must be a list of {len(tracks)}, an array for each balloon")
    arrays = [_one({name: each}, name, track.shape) for each, track in zip(given, tracks, strict=False)]
    arrays += [np.zeros(track.shape) for track in tracks[len(arrays) :]]
    return np.concatenate(arrays, axis=-2)


def _worlds_first(array: NDArray[Any], world_count: int, dimensions: int) -> NDArray[Any]:
    return array if array.ndim == dimensions else array.reshape(world_count, *array.shape)


def _add_volumes(
    by_points: NDArray[np.float64],
    by_volumes: NDArray[np.float64],
    moved: Trajectories,
    shapes: Sequence[BalloonShape],
) -> None:
    """Add the contribution of volumes to derivatives by places, through the volumes' slopes."""
    begin = 0
    for number, shape in enumerate(shapes):
        end = begin + shape.mesh.vertex_count
        track = _worlds_first(moved.points[number], len(by_points), 4)
        volume = Volume(shape.mesh)
        for world, frame in zip(*np.nonzero(by_volumes[:, :, number]), strict=True):
            slopes = volume.slopes(track[world, frame].astype(np.float64))
            by_points[world, frame, begin:end] += by_volumes[world, frame, number] * slopes
        begin = end

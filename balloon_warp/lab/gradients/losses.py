"""Losses, for `gradient` and `fit`: how far a balloon is from a place, a height or a volume.

`of_torch` and `of_jax` make one of a function of PyTorch or JAX, `of_kernel` of a kernel of Warp; these derive them.
"""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.batch.trajectories import Trajectories
from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.system.warp_threads import lock_of

Values = NDArray[np.float64]
Loss = Callable[[Trajectories], tuple[Any, Mapping[str, Any]]] | wp.Kernel
"""Function from trajectories to a number for each world, and a dictionary of its derivatives: by `points` and
`velocities`, a list of arrays by balloon, and by `volumes`, `pressures`, `sphere_positions` and `sphere_velocities`,
each of the shape that it has there. Or a kernel of Warp, see `of_kernel`"""


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


OF_LOSS = "loss"
"""Name of a kernel's array of results"""
VECTORS = ("points", "velocities", "sphere_positions", "sphere_velocities")
"""Arrays of vectors"""


class Seen(NamedTuple):
    """Trajectories as a loss of a framework sees them: its arrays, with several worlds worlds first."""

    points: Any
    """Places of each balloon's particles [m], a list of arrays of shape (frame_count, particle_count, 3)"""
    velocities: Any
    """[m/s], likewise"""
    volumes: Any
    """Volumes of balloons [m^3], shape (frame_count, balloon_count)"""
    pressures: Any
    """Gauge pressures [Pa], of that shape"""
    sphere_positions: Any
    """Places of spheres [m], shape (frame_count, sphere_count, 3)"""
    sphere_velocities: Any
    """[m/s], of that shape"""


LossDerivatives = tuple[Any, Mapping[str, Any]]
"""Number for each world, and its derivatives by the arrays that were used"""


def of_torch(function: Callable[[Seen], Any]) -> Callable[[Trajectories], LossDerivatives]:
    """Return the loss that a function of PyTorch is: of tensors, to a number for each world, derived by autograd.

    Raises:
        MissingExtraError: PyTorch is not installed.
    """
    try:
        torch: Any = import_module("torch")
    except ImportError:
        raise MissingExtraError("of_torch needs PyTorch: pip install 'balloon-warp[torch]'") from None

    def loss(moved: Trajectories) -> LossDerivatives:
        leaves = _each(moved, lambda array: torch.tensor(array, requires_grad=True))
        value = torch.as_tensor(function(leaves))
        if value.requires_grad:
            value.sum().backward()
        slopes = _mapped(leaves, lambda leaf: np.zeros(leaf.shape) if leaf.grad is None else leaf.grad.numpy())
        return value.detach().numpy(), slopes._asdict()

    return loss


def of_jax(function: Callable[[Seen], Any]) -> Callable[[Trajectories], LossDerivatives]:
    """Return the loss that a function of JAX is: of its arrays, to a number for each world, derived by `jax.vjp`.

    Raises:
        MissingExtraError: JAX is not installed.
    """
    try:
        jax: Any = import_module("jax")
    except ImportError:
        raise MissingExtraError("of_jax needs JAX: pip install 'balloon-warp[jax]'") from None

    def loss(moved: Trajectories) -> LossDerivatives:
        value, back = jax.vjp(lambda seen: jax.numpy.asarray(function(seen)), _each(moved, jax.numpy.asarray))
        (slopes,) = back(jax.numpy.ones_like(value))
        return np.asarray(value), _mapped(slopes, np.asarray)._asdict()

    return loss


def of_kernel(kernel: wp.Kernel) -> Callable[[Trajectories], LossDerivatives]:
    """Return the loss that a kernel of Warp adds up, derived by its adjoint, on the CPU, where trajectories are.

    Its arguments name its inputs: `points` and `velocities`, of all particles of all balloons, `volumes`,
    `pressures`, `sphere_positions` and `sphere_velocities`, arrays of the shape (world_count, frame_count, count); and
    `loss`, an array of shape (world_count,), to which it adds. A thread has an item of the first.

    Raises:
        InputError: it names something else, or has no adjoint.
    """
    types = {each.label: each.type for each in kernel.adj.args}
    names = [name for name in types if name != OF_LOSS]
    strange = [name for name in names if name not in Seen._fields or getattr(types[name], "ndim", 0) != 3]
    if strange or not names or OF_LOSS not in types:
        raise InputError(
            f"loss: the kernel {kernel.key} takes {', '.join(types) or 'nothing'}; expected {OF_LOSS}, an array, and "
            f"arrays of three dimensions among {', '.join(Seen._fields)}"
        )
    if not {**kernel.module.options, **kernel.options}.get("enable_backward", True):
        raise InputError(f"loss: the kernel {kernel.key} has no adjoint; expected one with enable_backward=True")

    def loss(moved: Trajectories) -> LossDerivatives:
        with lock_of(wp.get_device("cpu")):
            worlds = len(moved.worlds)
            arrays: dict[str, Any] = {
                name: wp.array(_joined(moved, name), dtype=types[name].dtype, device="cpu", requires_grad=True)
                for name in names
            }
            found = wp.zeros(worlds, dtype=types[OF_LOSS].dtype, device="cpu", requires_grad=True)
            with wp.Tape() as tape:
                inputs = [found if name == OF_LOSS else arrays[name] for name in types]
                wp.launch(kernel, arrays[names[0]].shape, inputs, device="cpu")
            tape.backward(grads={found: wp.ones_like(found, requires_grad=False)})
            slopes = {name: array.grad.numpy() for name, array in arrays.items()}
            return found.numpy(), {name: _split(moved, name, array) for name, array in slopes.items()}

    return loss


def _each(moved: Trajectories, made: Callable[[NDArray], Any]) -> Seen:
    """Return trajectories in arrays of a framework."""
    return _mapped(Seen(*(getattr(moved, name) for name in Seen._fields)), made)


def _mapped(seen: Seen, made: Callable[[Any], Any]) -> Seen:
    """Apply a function to each array."""
    return Seen(*([made(one) for one in each] if isinstance(each, list) else made(each) for each in seen))


def _joined(moved: Trajectories, name: str) -> NDArray:
    """Return an array of trajectories with all balloons, worlds first."""
    value: Any = getattr(moved, name)
    axis = -2 if name in VECTORS else -1
    array = np.concatenate(value, axis=axis) if isinstance(value, list) else value
    return array if array.ndim == (4 if name in VECTORS else 3) else array[None]


def _split(moved: Trajectories, name: str, slopes: NDArray) -> Any:
    """Return derivatives in the shapes that trajectories have."""
    value: Any = getattr(moved, name)
    if not isinstance(value, list):
        return slopes.reshape(value.shape)
    ends = np.cumsum([each.shape[-2] for each in value])[:-1]
    parts: Sequence[NDArray] = np.split(slopes, ends, axis=-2)
    return [part.reshape(each.shape) for part, each in zip(parts, value, strict=True)]

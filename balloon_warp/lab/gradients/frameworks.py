"""Losses as functions of PyTorch or JAX, or as kernels of Warp, which derive them themselves."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.batch.trajectories import Trajectories
from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.system.warp_threads import lock_of

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

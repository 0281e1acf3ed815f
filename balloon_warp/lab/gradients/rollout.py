"""A scene as a function of PyTorch: values in, frames out, derived by autograd, a policy within the loop or not."""

from collections.abc import Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from balloon_warp.errors import MissingExtraError
from balloon_warp.kernels.laws import Law
from balloon_warp.lab.gradients.steps import Moving, Steps
from balloon_warp.scene import SceneLike
from balloon_warp.system.arguments import checked
from balloon_warp.system.shown import Shown

TYPES = (wp.vec3, wp.vec3, wp.vec2, wp.float32, wp.vec2d, *[wp.vec3] * 4, wp.vec4, wp.int8)
"""Contents of the arrays of `Moving`"""


class Begun(NamedTuple):
    """State at the beginning of a frame, as tensors, worlds first."""

    frame: int
    """Number of the frame"""
    points: Any
    """Places of all particles [m], shape (W, P, 3)"""
    velocities: Any
    """[m/s], shape (W, P, 3)"""
    loads: Any
    """Pressure at height 0 [Pa], and its rise with height [Pa/m], shape (W, B, 2)"""
    pressures: Any
    """Gauge pressures [Pa], shape (W, B)"""
    gas: Any
    """Amounts [mol] and free volumes [m^3] of gas, shape (W, B, 2)"""
    sphere_positions: Any
    """Places of spheres [m], shape (W, S, 3)"""
    sphere_velocities: Any
    """[m/s], shape (W, S, 3)"""
    sphere_spins: Any
    """[rad/s], shape (W, S, 3)"""
    sphere_forces: Any
    """Forces of particles on spheres that are still to act [N], shape (W, S, 3)"""
    holds: Any
    """Friction state of particles where balloons touch: slip [m] and overlap [m], shape (W, P, 4), or (W, 0, 4)"""
    deep: Any
    """1 of particles that may be deep in another balloon, shape (W, P), or (W, 0); nothing is derived by it"""


class Moved(NamedTuple):
    """Frames of a rollout, as tensors, worlds first."""

    points: Any
    """Places of all particles [m], shape (W, frames + 1, P, 3)"""
    velocities: Any
    """[m/s], shape (W, frames + 1, P, 3)"""
    pressures: Any
    """Gauge pressures [Pa], shape (W, frames + 1, B)"""
    sphere_positions: Any
    """Places of spheres [m], shape (W, frames + 1, S, 3)"""
    sphere_velocities: Any
    """[m/s], shape (W, frames + 1, S, 3)"""


class Rollout(Shown):
    """Simulate a scene as a function of PyTorch.

    `rollout(values)` gives all frames. For a policy in the loop, `rollout.start(values)` gives where the scene begins,
    and `rollout.step(begun, values)` a frame more, by values that may be others each time. Tensors share the memory of
    arrays of Warp. As with all of torch's graphs, `backward` goes once through each.

    Args:
        scene: Scene, name of a bundled one, scene file, or mesh, as a file or in memory.
        of: Dotted paths of the values, as for `gradient`.
        world_count: Number of worlds, copies of the scene side by side.
        device: Warp device; the GPU, or else the CPU, if not given.
        schedule: Schedule of frames that run backwards, as for `gradient`.
        laws: your own.

    Raises:
        MissingExtraError: PyTorch is not installed.
        InputError: The scene cannot be simulated or differentiated, or a path not.
    """

    @checked
    def __init__(
        self,
        scene: SceneLike,
        *,
        of: Sequence[str],
        world_count: int = 1,
        device: str | None = None,
        schedule: str = "auto",
        laws: Sequence[Law] = (),
    ):
        self._functions = _functions()
        self._steps = Steps(scene, of, world_count, device, schedule, laws)

    def start(self, values: Any) -> Begun:
        """Return where the scene begins with these values, a tensor of shape (world_count, path_count)."""
        return Begun(0, *self._functions[0].apply(self._steps, values))

    def step(self, begun: Begun, values: Any) -> Begun:
        """Simulate a frame, with these values from now on; those that count at the start alone have no effect.

        Raises:
            InputError: the values have another shape, or cannot be.
            BlowUpError: a world blew up.
        """
        return Begun(begun.frame + 1, *self._functions[1].apply(self._steps, begun.frame, values, *begun[1:]))

    def __call__(self, values: Any, frames: int | None = None) -> Moved:
        """Simulate the scene, and return all its frames.

        Args:
            values: a tensor of shape (world_count, path_count).
            frames: how many; as many as the scene says, when missing.
        """
        stack = import_module("torch").stack
        begun = self.start(values)
        seen = [begun]
        for _ in range(self._steps.plan.scene.frames if frames is None else frames):
            begun = self.step(begun, values)
            seen.append(begun)
        return Moved(*(stack([getattr(each, name) for each in seen], dim=1) for name in Moved._fields))


def _functions() -> tuple[Any, Any]:
    """Return the functions of autograd: of the start, and of a frame.

    Raises:
        MissingExtraError: PyTorch is not installed.
    """
    try:
        torch: Any = import_module("torch")
        once_differentiable: Any = import_module("torch.autograd.function").once_differentiable
    except ImportError:
        raise MissingExtraError("Rollout needs PyTorch: pip install 'balloon-warp[torch]'") from None

    def arrays(tensors: Sequence[Any]) -> Moving:
        # of an empty one, torch takes any strides for contiguous, and Warp does not
        dense = (tensor.detach() if tensor.numel() else tensor.new_zeros(tensor.shape) for tensor in tensors)
        each = (tensor.contiguous() for tensor in dense)
        return Moving(*(wp.from_torch(tensor, dtype=dtype) for tensor, dtype in zip(each, TYPES, strict=True)))

    def tensors(moving: Moving) -> tuple[Any, ...]:
        return tuple(wp.to_torch(array) for array in moving)

    def handed_out(ctx: Any, moving: Moving) -> tuple[Any, ...]:
        each = Moving(*tensors(moving))
        ctx.mark_non_differentiable(each.deep)
        return each

    def numbers(values: Any) -> np.ndarray:
        return values.detach().cpu().double().numpy()

    class Start(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, steps: Steps, values: Any) -> tuple[Any, ...]:
            ctx.steps = steps
            ctx.save_for_backward(values)
            return handed_out(ctx, steps.start(numbers(values)))

        @staticmethod
        @once_differentiable
        def backward(ctx: Any, *bars: Any) -> Any:
            (values,) = ctx.saved_tensors
            found = ctx.steps.turn_start_back(numbers(values), arrays(bars))
            return None, torch.from_numpy(found).to(values)

    class Step(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, steps: Steps, frame: int, values: Any, *moving: Any) -> tuple[Any, ...]:
            ctx.steps, ctx.frame = steps, frame
            ctx.save_for_backward(values, *moving)
            return handed_out(ctx, steps.advance(arrays(moving), frame, numbers(values)))

        @staticmethod
        @once_differentiable
        def backward(ctx: Any, *bars: Any) -> Any:
            values, *moving = ctx.saved_tensors
            by_begin, found = ctx.steps.turn_back(arrays(moving), ctx.frame, numbers(values), arrays(bars))
            return None, None, torch.from_numpy(found).to(values), *tensors(by_begin)

    return Start, Step

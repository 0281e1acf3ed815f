"""The values of a scene that explain measured data."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, overload

from balloon_warp.arguments import checked
from balloon_warp.errors import InputError
from balloon_warp.fitting.bounds import checked_bounds, first_places
from balloon_warp.fitting.by_data import Request, least_squares
from balloon_warp.fitting.by_loss import Optimum, least_loss
from balloon_warp.fitting.result import Fit
from balloon_warp.gradients.derive import Asked, Gradient
from balloon_warp.gradients.gradient import derived
from balloon_warp.gradients.loss import Loss
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Vary
from balloon_warp.scene import SceneLike
from balloon_warp.scene.load import scene_of
from balloon_warp.trajectories import simulate

ROUNDS = 24


@overload
def fit(
    scene: SceneLike, data: str | Path | Mapping[str, Any], *, free: Mapping[str, tuple[float, float]],
    starts: int = ..., rounds: int = ..., seed: int = ..., progress: str | Path | None = ..., resume: bool = ...,
    device: str | None = ..., schedule: str = ..., laws: Sequence[Law] = ..., on_stage: Callable[[str], None] = ...,
) -> Fit: ...  # fmt: skip


@overload
def fit(
    scene: SceneLike, *, of: Mapping[str, tuple[float, float]], loss: Loss,
    starts: int = ..., rounds: int = ..., seed: int = ..., device: str | None = ..., schedule: str = ...,
    laws: Sequence[Law] = ..., on_stage: Callable[[str], None] = ...,
) -> Optimum: ...  # fmt: skip


@checked
def fit(
    scene: SceneLike,
    data: str | Path | Mapping[str, Any] | None = None,
    *,
    free: Mapping[str, tuple[float, float]] | None = None,
    of: Mapping[str, tuple[float, float]] | None = None,
    loss: Loss | None = None,
    starts: int = 8,
    rounds: int = ROUNDS,
    seed: int = 0,
    progress: str | Path | None = None,
    resume: bool = False,
    device: str | None = None,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
    on_stage: Callable[[str], None] = lambda stage: None,
) -> Fit | Optimum:
    """Find the values of a scene that explain measured data, or for which a loss is least, from many starts.

    Measured data are explained by least squares: all starts, and all their differences, are worlds of one batch. A loss
    goes down along its gradients (L-BFGS-B of SciPy): all starts are worlds of one batch.

    Args:
        scene: Scene that was measured, with all that is known of it.
        data: A .npz file or a mapping: `times` [s], and then `points` with their `particles`, `volumes` or
            `pressures`, of the first balloon; `noise`, `volume_noise` and `pressure_noise` are standard deviations.
            Hidden points are NaN.
        free: With data: unknown values, as dotted paths, and the lowest and highest value.
        of: With a loss: the values to be found, as dotted paths, and the lowest and highest value.
        loss: As for `gradient`; `losses` has common ones.
        starts: Number of starting points.
        rounds: Largest number of steps.
        seed: Seed of the starting points.
        progress: With data: a file that keeps how far the fit is, and goes when it is done.
        resume: Go on from that file, where the same fit was stopped.
        device: A Warp device; if missing, the GPU or else the CPU.
        schedule: As for `simulate`, or with a loss as for `gradient`.
        laws: User-defined laws, besides the built-in ones.
        on_stage: Called with a few words at each stage.

    Raises:
        InputError: The data, a path or a bound is wrong, no start can be simulated, or there is nothing to resume.
    """
    scene = scene_of(scene)
    for name, number in (("starts", starts), ("rounds", rounds)):
        if number < 1:
            raise InputError(f"{name}: must be at least 1 (got {number})")
    if (data is None) == (loss is None):
        raise InputError("fit: expected either measured data and `free`, or a `loss` and `of`")
    if resume and progress is None:
        raise InputError("resume: needs the `progress` file of an earlier fit")
    if loss is not None:
        if progress is not None:
            raise InputError("progress: only fits to measured data save it; expected none with a `loss`")
        places = first_places(starts, len(checked_bounds("of", of)), seed)

        def derive(of: Sequence[str], vary: Vary, world_count: int) -> Gradient:
            return derived(scene, (), Asked(of, loss, world_count, vary, device, schedule, laws))[0]

        return least_loss(derive, checked_bounds("of", of), places, rounds, on_stage)
    assert data is not None
    kept = None if progress is None else Path(progress)
    request = Request(checked_bounds("free", free), starts, rounds, seed, kept, resume)
    run = partial(simulate, device=device, schedule=schedule, laws=laws)
    return least_squares(run, scene, data, request, on_stage)

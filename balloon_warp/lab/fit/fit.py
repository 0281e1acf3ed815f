"""Fits: the values of a scene that explain measured data, or for which a loss is least."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from balloon_warp.batch.simulate import simulate
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.lab.fit.by_data import Fit, Request, least_squares
from balloon_warp.lab.fit.search import Bounds, checked_bounds, first_places, minima_together, slope_at, values_at
from balloon_warp.lab.gradients.derive import Asked, Gradient, Loss
from balloon_warp.lab.gradients.gradient import derived
from balloon_warp.model import Vary
from balloon_warp.scene import SceneLike
from balloon_warp.scene.load import scene_of
from balloon_warp.system.arguments import checked
from balloon_warp.system.shown import Shown, described

Values = NDArray[np.float64]
Derive = Callable[..., Gradient]
"""Function of `of`, `vary` and `world_count`"""


@described
@dataclass(frozen=True, repr=False)
class Optimum(Shown):
    """Values for which a loss is least."""

    values: dict[str, float]
    """Values by path"""
    loss: float
    """Loss at the values"""
    starts: Values
    """Loss that each start reached, ascending; infinite where it could not be simulated"""
    evaluations: int
    """Number of times that all worlds were simulated"""
    without_influence: tuple[str, ...] = ()
    """Paths by which the loss did not change at all, wherever it was asked; their values are those of the start"""

    def __repr__(self) -> str:
        listed = ", ".join(f"{path}={value:.6g}" for path, value in self.values.items())
        return f"Optimum(loss {self.loss:.6g}: {listed})"


def least_loss(derive: Derive, bounds: Bounds, first: Values, rounds: int, on_stage: Callable[[str], None]) -> Optimum:
    """Return the least loss that some start came to.

    Args:
        first: places of the starts between the bounds, from 0 to 1, shape (n, p).

    Raises:
        InputError: no start can be simulated, or no value changes the loss.
    """
    on_stage(f"simulating {len(first)} worlds a round")
    influence = np.zeros(len(bounds), dtype=bool)

    def ask(places: Values) -> tuple[Values, Values]:
        losses, slopes = _derived(derive, bounds, values_at(bounds, places))
        begins = not influence.any()
        influence[:] |= slopes.any(axis=0)
        if begins and np.isfinite(losses).any():
            _tell_idle(_idle(bounds, influence), bounds, on_stage)
        of_places = [
            [slope_at(low, high, place) for (low, high), place in zip(bounds.values(), row, strict=True)]
            for row in places
        ]
        return losses, slopes * np.array(of_places)

    def on_round(number: int, loss: float) -> None:
        on_stage(f"round {number}: loss {loss:.4g}")

    places, asked = minima_together(ask, first, rounds, on_round)
    losses, _ = ask(places)
    if not np.isfinite(losses).any():
        raise InputError("of: none of the starts can be simulated; expected narrower bounds")
    best = int(np.argmin(losses))
    values = values_at(bounds, places[best : best + 1])[0]
    found = dict(zip(bounds, values.tolist(), strict=True))
    return Optimum(found, float(losses[best]), np.sort(losses), asked + 1, _idle(bounds, influence))


def _idle(bounds: Bounds, influence: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return the paths without any influence so far."""
    return tuple(path for path, has in zip(bounds, influence, strict=True) if not has)


def _tell_idle(idle: Sequence[str], bounds: Bounds, on_stage: Callable[[str], None]) -> None:
    """Say which values do not change the loss at any start.

    Raises:
        InputError: none does.
    """
    if len(idle) == len(bounds):
        raise InputError(
            f"of: the loss depends on none of the values at any start: {', '.join(idle)}; expected a value that "
            "affects the loss"
        )
    if idle:
        on_stage(f"the loss does not depend on {', '.join(idle)} at any start")


def _derived(derive: Derive, bounds: Bounds, values: Values) -> tuple[Values, Values]:
    """Return losses and their derivatives of worlds; infinite and 0 of those that blow up."""
    try:
        return _of_worlds(derive, bounds, values)
    except BlowUpError:  # one world takes all with it: each by itself
        pass
    losses, slopes = np.full(len(values), np.inf), np.zeros(values.shape)
    for number in range(len(values)):
        try:
            one = _of_worlds(derive, bounds, values[number : number + 1])
            losses[number], slopes[number] = one[0][0], one[1][0]
        except BlowUpError:
            continue
    return losses, slopes


def _of_worlds(derive: Derive, bounds: Bounds, values: Values) -> tuple[Values, Values]:
    vary: dict[str, Any] = dict(zip(bounds, values.T, strict=True))
    found = derive(of=list(bounds), vary=vary, world_count=len(values))
    return found.loss, np.stack([found.gradients[path] for path in bounds], axis=1)


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

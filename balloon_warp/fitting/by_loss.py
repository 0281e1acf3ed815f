"""The values of a scene for which a loss is least, along its gradients from many starts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.fitting.bounds import Bounds, slope_at, values_at
from balloon_warp.fitting.together import minima_together
from balloon_warp.gradients.derive import Gradient
from balloon_warp.shown import Shown, described

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

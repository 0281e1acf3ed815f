"""Waiting until a simulation is at rest."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError

CALM_SECONDS = 0.1
"""Duration without fast motion that counts as rest, so that a turning point of an oscillation does not [s]"""
ROUNDED = 32.0
"""Largest speed that rounding causes, in units in the last place of the coordinates a substep: some 10 were measured.
With thousands of substeps a frame that is more than a balloon that is all but at rest has"""


class Stepping(Protocol):
    """Part of a simulator's interface that waiting for rest needs."""

    model: Any
    state: Any

    def step_unread(self) -> None:
        """Advance every world by one frame."""
        ...


def relax(simulator: Stepping, speed: float, most_seconds: float) -> None:
    """Step until no particle has been faster for a while.

    Args:
        speed: of a particle, from one frame to the next; within a frame it may tremble as much as rounding makes it.

    Raises:
        InputError: something still moves after so much simulated time.
    """
    if not speed > 0.0:
        raise InputError(f"speed: must be above 0 (got {speed})")
    rate = simulator.model.scene.frames_per_second
    calm, fastest, before = 0, np.inf, _points(simulator)
    for _ in range(int(np.ceil(most_seconds * rate))):
        simulator.step_unread()
        points = _points(simulator)
        trembles = _largest(np.asarray(simulator.state.velocities.numpy(), dtype=np.float64))
        fastest = rate * _largest(points - before)
        if trembles > _of_rounding(simulator, points):
            fastest = max(fastest, trembles)
        before = points
        calm = calm + 1 if fastest <= speed else 0
        if calm > CALM_SECONDS * rate:
            return
    raise InputError(
        f"relax: the fastest particle still moves at {fastest:.3g} m/s after {most_seconds:g} s; expected at most "
        f"{speed:g}; more damping or time may help"
    )


def _points(simulator: Stepping) -> NDArray[np.float64]:
    return np.asarray(simulator.state.points.numpy(), dtype=np.float64)


def _largest(vectors: NDArray[np.float64]) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1).max(initial=0.0)))


def _of_rounding(simulator: Stepping, points: NDArray[np.float64]) -> float:
    """Return the speed up to which particles may tremble by rounding [m/s]."""
    model = simulator.model
    place = float(np.spacing(np.float32(np.abs(points).max(initial=0.0))))
    return ROUNDED * place * model.substeps * model.scene.frames_per_second

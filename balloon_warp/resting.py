"""Waiting until a simulation is at rest."""

from typing import Any, Protocol

import numpy as np

from balloon_warp.errors import InputError

CALM_SECONDS = 0.1
"""Duration without fast motion that counts as rest, so that a turning point of an oscillation does not [s]"""


class Stepping(Protocol):
    """Part of a simulator's interface that waiting for rest needs."""

    model: Any
    state: Any

    def step_unread(self) -> None:
        """Advance every world by one frame."""
        ...


def relax(simulator: Stepping, speed: float, most_seconds: float) -> None:
    """Step until no particle has been faster for a while.

    Raises:
        InputError: something still moves after so much simulated time.
    """
    if not speed > 0.0:
        raise InputError(f"speed: must be above 0 (got {speed})")
    rate = simulator.model.scene.frames_per_second
    calm, fastest = 0, np.inf
    for _ in range(int(np.ceil(most_seconds * rate))):
        simulator.step_unread()
        squared = (np.asarray(simulator.state.velocities.numpy()) ** 2).sum(axis=-1)
        fastest = float(np.sqrt(squared.max(initial=0.0)))
        calm = calm + 1 if fastest <= speed else 0
        if calm > CALM_SECONDS * rate:
            return
    raise InputError(
        f"relax: the fastest particle moves by {fastest:.3g} m/s after {most_seconds:g} s; expected at most {speed:g}, "
        "which more damping or time may bring"
    )

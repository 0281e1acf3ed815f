"""Waiting until a simulation is at rest."""

from typing import Any, Protocol

import numpy as np

from balloon_warp.errors import InputError

CALM_SECONDS = 0.1
"""without anything fast, so that what swings is not taken for at rest where it turns"""


class Stepping(Protocol):
    """What of a simulator is waited for."""

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

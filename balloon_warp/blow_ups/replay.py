"""The last frame of a world that blew up, again, substep by substep."""

from dataclasses import dataclass

import numpy as np

from balloon_warp.kernels.measure.health import HEALTHY
from balloon_warp.model import Model, State, copy_of, overwrite
from balloon_warp.schedules.choose import Schedule
from balloon_warp.schedules.health import HealthCheck

FRAMES = 2
"""Number of frames that are replayed: rounding differs between schedules, and may delay the end a little"""


@dataclass(frozen=True)
class LastSubstep:
    """Last substep of a world, which is alone in its model: the one in which it went bad."""

    model: Model
    frame: int
    substep: int
    """Number of the substep in the frame, from 1"""
    before: State
    """State before the substep, all of it finite"""
    after: State
    first_bad: int
    """Lowest particle, or sphere, numbered after the particles, at a place that it cannot have; or `HEALTHY` if all are
    fine, and something else is not finite"""


def last_substep(model: Model, state: State, schedule: Schedule, frame: int) -> LastSubstep | None:
    """Simulate a world from the start of the frame in which it blew up, in place.

    The readable reference does it, which can be watched. None if it does not blow up there: its state was written to
    meanwhile.
    """
    from balloon_warp.schedules.launched import LaunchedSchedule  # the kernels of these load when first needed
    from balloon_warp.schedules.scatter import ScatterSchedule

    # The implicit solver can be watched itself, and takes steps at which the reference would not be stable.
    watched = schedule if isinstance(schedule, LaunchedSchedule) and schedule.watchable else ScatterSchedule(model)
    check, before = HealthCheck(model), copy_of(state)
    for number in range(frame, frame + FRAMES):
        for substep in watched.substeps(state):
            check.look(state)
            bad = int(state.first_bad.numpy()[0])
            if bad != HEALTHY or not _is_finite(state):
                return LastSubstep(model, number, substep + 1, before, state, bad)
            overwrite(before, state)
    return None


def _is_finite(state: State) -> bool:
    return all(np.isfinite(array.numpy()).all() for array in state.arrays.values())

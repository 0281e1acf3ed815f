"""The frame in which a world blew up, again, substep by substep, and the state before it."""

from dataclasses import dataclass, replace
from typing import Protocol, Self, TypeVar

import numpy as np
import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.tables import HEALTHY
from balloon_warp.model import Model, State, copy_of, overwrite
from balloon_warp.scene import Scene
from balloon_warp.schedules.choose import Schedule
from balloon_warp.schedules.frames import HealthCheck

POLICIES = ("freeze", "stop", "restart")
"""Policies: keep the last good frame; end everything; restart with half the step"""
MOST_HALVINGS = 4
"""Largest number of halvings of a step before giving up: 16 times the substeps"""


def check_policy(on_blowup: str) -> None:
    """Check the name of a policy.

    Raises:
        InputError: there is not.
    """
    if on_blowup not in POLICIES:
        raise InputError(f"on_blowup {on_blowup}: expected {', '.join(POLICIES)}")


def with_half_the_step(scene: Scene, substeps: int) -> Scene:
    """Return the scene with twice its substeps, now and wherever it changes them.

    Args:
        substeps: that it has at the start, in a frame.
    """
    changes = []
    for change in scene.change:
        later = change.set.get("substeps")
        doubled = {**change.set, "substeps": 2 * later} if isinstance(later, int) else change.set
        changes.append(change.model_copy(update={"set": doubled}))
    return scene.model_copy(update={"substeps": 2 * substeps, "change": changes})


class Advancing(Protocol):
    """Simulator of a model that is advanced again."""

    frame_number: int
    state: State

    def advance(self) -> None: ...

    def make_due_changes(self) -> None: ...


Again = TypeVar("Again", bound=Advancing)


@dataclass(frozen=True)
class Origin:
    """Model, and its state at the start of a frame, from which the same simulation follows, bit for bit."""

    model: Model
    """Model with the planned changes that are still to come"""
    schedule: str
    frame: int = 0
    state: State | None = None
    """State of the worlds; the scene's start, when missing"""

    def __post_init__(self) -> None:
        if self.model.ages is not None:  # which frames count
            object.__setattr__(self, "model", replace(self.model, ages=wp.clone(self.model.ages)))

    def fill(self, state: State) -> None:
        """Copy the origin into a state, unless it is the scene's start."""
        if self.state is not None:
            overwrite(state, self.state)

    def of_world(self, world: int) -> Self:
        """Return one world of the origin by itself."""
        if self.model.world_count == 1:
            return replace(self)
        state = self.state.of_world(world) if self.state else None
        return replace(self, model=self.model.of_world(world), state=state)

    def advance(self, again: Again, frame: int) -> Again:
        """Advance a simulator of this model from here to the beginning of a frame."""
        again.frame_number = self.frame
        self.fill(again.state)
        while again.frame_number < frame - 1:
            again.advance()
        again.make_due_changes()
        return again


KEPT_FRAMES = 512
"""Number of frames between two kept states of a single world, from which a blow-up can be replayed: a copy costs less
than five frames, and so less than a hundredth of all"""


class Origins:
    """The start of a simulation, and of a single world the last state that was kept."""

    def __init__(self, start: Origin):
        self._start = start
        self._kept: Origin | None = None

    @property
    def last(self) -> Origin:
        """The latest to begin again from."""
        return self._kept or self._start

    def is_due(self, model: Model, frame: int) -> bool:
        """Return whether a state is to be kept at the start of a frame."""
        kept = self._kept
        alone = model.world_count == 1 and (kept is None or frame >= kept.frame + KEPT_FRAMES)
        return alone or bool(model.reach)  # values on the device are those of the last frame alone

    def keep(self, here: Origin) -> None:
        """Keep a copy of the state that a simulation is in."""
        kept = self._kept.state if self._kept else None
        if here.state is not None and kept is not None:  # its arrays are there already
            overwrite(kept, here.state)
        else:
            kept = copy_of(here.state) if here.state else None
        self._kept = replace(here, state=kept)

    def forget(self) -> None:
        """Drop the kept states: later frames do not follow from them."""
        self._kept = None


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

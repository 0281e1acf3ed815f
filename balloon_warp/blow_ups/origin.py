"""Restart point of a simulation."""

from dataclasses import dataclass, replace
from typing import Protocol, Self, TypeVar

import warp as wp

from balloon_warp.model import Model, State, overwrite


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

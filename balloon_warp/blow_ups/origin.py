"""Restart point of a simulation."""

from dataclasses import dataclass, replace
from typing import Self

from balloon_warp.model import Model, State, overwrite


@dataclass(frozen=True)
class Origin:
    """A model, and a state that it is in at the start of a frame; the same simulation follows from it, bit for bit."""

    model: Model
    """Model with the planned changes that are still to come"""
    schedule: str
    frame: int = 0
    state: State | None = None
    """State of one world; the scene's start, when missing"""

    def fill(self, state: State) -> None:
        """Make a state what this one is, if it is not the scene's start."""
        if self.state is not None:
            overwrite(state, self.state)

    def of_world(self, world: int) -> Self:
        """Return one world by itself, as it is among the others."""
        return self if self.model.world_count == 1 else replace(self, model=self.model.of_world(world))

"""Where a simulation can be begun again from."""

from dataclasses import dataclass, replace
from typing import Self

import warp as wp

from balloon_warp.model import Model, State
from balloon_warp.model.parameters import scene_parameters


@dataclass(frozen=True)
class Origin:
    """A model, and a state that it is in at the start of a frame; the same simulation follows from it, bit for bit."""

    model: Model
    """whose turns are those that are still to come"""
    schedule: str
    frame: int = 0
    state: State | None = None
    """of one world; the scene's start, when missing"""

    def of_world(self, world: int) -> Self:
        """One world by itself, as it is among the others."""
        return self if self.model.world_count == 1 else replace(self, model=_one_world(self.model, world))


def _one_world(model: Model, world: int) -> Model:
    """A batch of a single world, with the parameters that one has."""
    names = scene_parameters(model.scene).keys() - {"initial_balloon_positions"} | {"initial_shifts", "initial_loads"}
    rows = {
        name: wp.clone(array[world : world + 1])
        for name in names
        if (array := getattr(model, name)).size and array.shape[0] > 1
    }
    return replace(model, world_count=1, **rows)

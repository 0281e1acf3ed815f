"""The changes that a scene has planned, while a model is simulated."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.model.following import follow_changes
from balloon_warp.model.model import Model
from balloon_warp.model.timeline import DueChange


class PlannedChanges:
    """The changes that are still to come, in order."""

    def __init__(self, changes: Iterable[DueChange]):
        self._ahead = deque(changes)

    def __iter__(self) -> Iterator[DueChange]:
        return iter(self._ahead)

    def are_due(self, frame: int) -> bool:
        """Return whether a change is due at the start of a frame."""
        return bool(self._ahead) and self._ahead[0].frame <= frame

    def due(self, frame: int) -> Iterator[DueChange]:
        """Take the changes that are due at the start of a frame, one after the other."""
        while self.are_due(frame):
            yield self._ahead.popleft()

    def clear(self) -> None:
        """Drop all planned changes."""
        self._ahead.clear()


def changed_parameters(change: DueChange, model: Model) -> dict[str, NDArray]:
    """Find a model's parameters that change, and those that follow from them, with their rows from then on."""
    now = {name: array.numpy().astype(np.float64) for name, array in model.parameters.items()}
    then = now | {name: now[name].copy() for name in change.values}
    for name in change.values:
        change.apply(name, then[name])
    follow_changes(change.scene, model.shapes, now, then)
    return {name: rows for name, rows in then.items() if rows is not now[name]}


def with_changed_methods(change: DueChange, model: Model) -> Model:
    """Return a model with the methods that change."""
    methods = {name: getattr(change.scene, name) for name in change.methods}
    asked = methods.get("substeps", "auto")
    substeps = model.substeps if asked == "auto" else asked
    return replace(model, scene=model.scene.model_copy(update=methods), substeps=substeps)

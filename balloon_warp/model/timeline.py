"""Timeline of the parameters that change during a simulation."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Parameter
from balloon_warp.model.law_tables import with_law_tables
from balloon_warp.model.parameters import parameters_at
from balloon_warp.model.rows import KEYFRAME_VALUES
from balloon_warp.model.vary import METHODS, require_changeable
from balloon_warp.scene import Scene
from balloon_warp.scene.timeline import scenes_over_time


@dataclass(frozen=True)
class DueChange:
    """A frame at whose start parameters change, alike in all worlds."""

    frame: int
    scene: Scene
    """Scene from then on"""
    values: dict[str, tuple[NDArray[np.bool_], NDArray[np.float64]]]
    """Changed entries of a world and their new values, by the parameters' names"""
    methods: frozenset[str]
    """Changed fields among `METHODS`"""

    def apply(self, name: str, rows: NDArray) -> None:
        """Change a parameter's rows, shape (W, ...), in place."""
        which, values = self.values[name]
        rows[:, which] = values[which]


def due_changes(scene: Scene, rows: Sequence[Parameter]) -> Iterator[DueChange]:
    """Find the changes that a scene plans, in order.

    Raises:
        InputError: names the change, and the path or field that is wrong.
    """
    for number, change in enumerate(scene.change):
        try:
            require_changeable(scene, rows, change.set)
            if automatic := [path for path, value in change.set.items() if value == "auto" and path != "substeps"]:
                raise InputError(f'{automatic[0]}: must be a number or keyframes (got "auto")')
        except InputError as mistake:
            raise InputError(f"change.{number}.set: {mistake}") from None
    before, scene_before = parameters_at(scene, rows, 0), scene
    for frame, now in scenes_over_time(scene):
        with_law_tables(now, rows)
        _require_same_times(scene, now)
        after = parameters_at(now, rows, frame)
        keyframes = before[KEYFRAME_VALUES.name].shape[2] - after[KEYFRAME_VALUES.name].shape[2]
        padding = [(0, 0), (0, 0), (0, keyframes)]
        after[KEYFRAME_VALUES.name] = np.pad(after[KEYFRAME_VALUES.name], padding, mode="edge")
        values = {
            name: (different, array[0])
            for name, array in after.items()
            if (different := (array[0] != before[name][0]) & ~np.isnan(array[0])).any()
        }
        methods = frozenset(name for name in METHODS if getattr(now, name) != getattr(scene_before, name))
        yield DueChange(frame, now, values, methods)
        before, scene_before = after, now


def _require_same_times(scene: Scene, now: Scene) -> None:
    """Make sure that keyframes come when they do at the start: only their values change.

    Raises:
        InputError: names the balloon whose keyframes have other times.
    """
    for number, (first, then) in enumerate(zip(scene.balloon, now.balloon, strict=True)):
        told, found = ([time for time, _ in balloon.inflation.keyframes] for balloon in (first, then))
        if then.inflation.has_keyframes and found != told:
            expected = f"keyframes at {told} s" if first.inflation.has_keyframes else "keyframes from the start on"
            raise InputError(
                f"change: balloon.{number}.inflation.{then.inflation.keyframed}: must be a number, or {expected} "
                f"(got keyframes at {found} s)"
            )

"""Planned changes of a scene where each world has a time of its own: they write controls, on the device."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.frames.starting import begin_ages, count_ages, follow_plan
from balloon_warp.launching import launch
from balloon_warp.model import Model
from balloon_warp.model.parameters import places_of
from balloon_warp.model.rows import rows_of
from balloon_warp.model.vary import METHODS
from balloon_warp.scene import Scene
from balloon_warp.scene.timeline import frame_at
from balloon_warp.steering.controls import Controls

Begun = Mapping[str, NDArray]
"""Parameters that are planned to change, by name, as they were when the simulation began"""


class Turn(NamedTuple):
    """Values that one number of a control takes."""

    path: str
    axis: int
    frames: wp.array
    """Frames of a world at whose start it changes, in order"""
    values: wp.array
    """Values from then on"""


def begun_of(model: Model) -> Begun:
    """Copy what is planned to change, as a simulation begins."""
    names = dict.fromkeys(name for change in model.due_changes for name in change.values)
    return {name: np.array(model.parameters[name].numpy()) for name in names}


class Timetable:
    """The changes that a scene plans, each in the frame of a world's own time.

    Args:
        controls: in which what changes is opened, where it is not open yet.
        begun: parameters at the start.
        frame: how many frames all worlds have had.

    Raises:
        InputError: something that is planned cannot be written on the device.
    """

    def __init__(self, model: Model, controls: Controls, begun: Begun, frame: int):
        self._controls, self._device = controls, model.device
        self._turns: list[Turn] = []
        self.ages = wp.full(model.world_count, frame, dtype=wp.int32, device=model.device)
        """Number of frames since each world began"""
        for path, planned in _planned(model.scene).items():
            first = _first_values(model, path, begun)
            told = [first, *(value for _, value in planned)]
            try:
                if path not in controls:
                    controls.open_planned(path, first, float(np.min(told)), float(np.max(told)))
            except InputError as mistake:
                raise InputError(f"reset: some worlds cannot begin anew by themselves: change: {mistake}") from None
            frames = wp.array([at for at, _ in planned], dtype=wp.int32, device=model.device)
            for axis in range(len(first)):
                values = wp.array([value[axis] for _, value in planned], dtype=wp.float32, device=model.device)
                self._turns.append(Turn(path, axis, frames, values))

    def write(self) -> None:
        """Write what is planned for the frame that each world begins, and count that frame."""
        count, device = self.ages.shape[0], self._device
        for turn in self._turns:
            target = self._controls.column(turn.path, turn.axis)
            launch(follow_plan, count, [self.ages, turn.frames, turn.values], [target], device=device)
        launch(count_ages, count, [], [self.ages], device=device)

    def restart(self, mask: wp.array) -> None:
        """Let the time of worlds begin anew."""
        launch(begin_ages, self.ages.shape[0], [mask], [self.ages], device=self._device)


def _planned(scene: Scene) -> dict[str, list[tuple[int, NDArray[np.float64]]]]:
    """Return the frames of each path's changes, and its values from then on, shape (1,) or (3,).

    Raises:
        InputError: a change is of a method, or of more than a number or a vector.
    """
    planned: dict[str, dict[int, NDArray[np.float64]]] = {}
    for number, path, frame, value in _changes(scene):
        where = f"reset: some worlds cannot begin anew by themselves: change.{number}.set: {path}"
        if path in METHODS:
            raise InputError(f"{where}: changes in all worlds at once")
        numbers = [value] if isinstance(value, int | float) else value
        if not isinstance(numbers, list | tuple) or not all(isinstance(each, int | float) for each in numbers):
            raise InputError(f"{where}: must be a number or three (got {str(value)[:60]})")
        planned.setdefault(path, {})[frame] = np.array(numbers, dtype=np.float64)
    return {path: sorted(turns.items(), key=lambda turn: turn[0]) for path, turns in planned.items()}


def _changes(scene: Scene) -> Iterator[tuple[int, str, int, Any]]:
    for number, change in enumerate(scene.change):
        for path, value in change.set.items():
            yield number, path, frame_at(scene, change.time), value


def _first_values(model: Model, path: str, begun: Begun) -> NDArray[np.float64]:
    """Return the value of a path as the simulation began, alike in all worlds, shape (1,) or (3,)."""
    places = places_of(model.scene, rows_of(model.laws))
    firsts = [places[each][0] for each in (path, *(f"{path}.{axis}" for axis in range(3))) if each in places]
    rows = {name: begun[name] if name in begun else model.parameters[name].numpy() for name, _ in firsts}
    return np.array([np.ravel(rows[name][(0, *index)])[0] for name, index in firsts], dtype=np.float64)

"""Time of each world by itself: planned changes write controls, on the device, and keyframes and obstacles follow."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.membrane import NEVER
from balloon_warp.kernels.steering import begin_ages, follow_plan, let_appear
from balloon_warp.launching import launch
from balloon_warp.model import Model
from balloon_warp.model.parameters import places_of, rows_of, scene_parameters
from balloon_warp.model.vary import METHODS
from balloon_warp.scene import Scene
from balloon_warp.scene.timeline import frame_at, is_there
from balloon_warp.steering.controls import Controls, columns_of

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


class Appearance(NamedTuple):
    """Sizes that a thing takes, one that appears later or ends."""

    name: str
    """Parameter that is 0 while it is not there"""
    number: int
    frames: wp.array
    """Frames of a world at whose start it changes, in order"""
    sizes: wp.array
    """Values from then on"""
    first: float
    """Value as a world begins"""


def begun_of(model: Model) -> Begun:
    """Copy the parameters that planned changes set, as a simulation begins."""
    names = dict.fromkeys(name for change in model.due_changes for name in change.values)
    return {name: np.array(model.parameters[name].numpy()) for name in names}


def _appearances(model: Model, begun: Begun) -> Iterator[Appearance]:
    """Find the spheres and strings that appear later or end."""
    scene, device = model.scene, model.device
    said = scene_parameters(scene, rows_of(model.laws))
    for name, things in (("sphere_radius", scene.sphere), ("string_stiffness", scene.string)):
        for number, thing in enumerate(things):
            frames = sorted({frame_at(scene, time) for time in (thing.start, thing.end) if time})
            if frames:
                sizes = [said[name][0, number] * is_there(scene, thing, frame) for frame in frames]
                yield Appearance(
                    name,
                    number,
                    wp.array(frames, dtype=wp.int32, device=device),
                    wp.array(sizes, dtype=wp.float32, device=device),
                    float(begun[name][0, number]),
                )


def has_times(model: Model) -> bool:
    """Return whether a scene has things with times: changes, keyframes, moving obstacles, things that appear or end."""
    moves = any(np.ptp(np.asarray(each.numpy()), axis=0).any() for each in (model.obstacle_motion, model.anchor_motion))
    keyed = any(balloon.inflation.has_keyframes for balloon in model.scene.balloon)
    return bool(model.due_changes or keyed or moves)


def require_timeless(model: Model) -> None:
    """Make sure that nothing in a scene depends on the clock of all worlds.

    Raises:
        InputError: something does.
    """
    scene = model.scene
    ties = any(string.start > 0.0 or string.end is not None for string in scene.string)
    necks = [balloon.neck for balloon in scene.balloon if balloon.neck]
    fills = (model.parameters[f"fill_{name}"].numpy() for name in ("breaths", "litres", "moles"))
    blown_in = sum(float(np.sum(fill)) for fill in fills)
    reasons = {
        'strings that appear or end, and solver = "projective"': ties and scene.solver == "projective",
        "a neck that opens or closes": any(neck.opens > 0.0 or neck.closes is not None for neck in necks),
        "gas that is blown in for a time": blown_in > 0.0,
        "a needle_time": any(balloon.material.needle_time < NEVER for balloon in scene.balloon),
    }
    if reason := next((name for name, depends in reasons.items() if depends), None):
        raise InputError(f"reset: some worlds cannot begin anew where the scene has {reason}: the clock is that of all")


class Timetable:
    """The changes that a scene plans, each in the frame of a world's own time.

    Args:
        controls: in which changed paths are opened, where they are not open yet.
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

        self._appearances = list(_appearances(model, begun))
        self._nobody = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)

    def write(self, model: Model) -> None:
        """Write the values planned for the frame that each world begins."""
        self._appear(model, self._nobody)
        count, device = self.ages.shape[0], self._device
        for turn in self._turns:
            target = self._controls.column(turn.path, turn.axis)
            launch(follow_plan, count, [self.ages, turn.frames, turn.values], [target], device=device)

    def restart(self, mask: wp.array, model: Model) -> None:
        """Let the time of worlds begin anew."""
        launch(begin_ages, self.ages.shape[0], [mask], [self.ages], device=self._device)
        self._appear(model, mask)

    def settle(self, model: Model) -> None:
        """Let things appear and end, after the time of worlds has been set."""
        self._appear(model, wp.ones_like(self._nobody))

    def _appear(self, model: Model, mask: wp.array) -> None:
        for each in self._appearances:
            (target,) = columns_of(model.parameters[each.name], (each.number,))
            inputs = [mask, self.ages, each.frames, each.sizes, each.first]
            launch(let_appear, self.ages.shape[0], inputs, [target], device=self._device)


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

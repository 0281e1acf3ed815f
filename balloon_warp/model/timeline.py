"""Timeline of the parameters that change, and selection of the laws and phases that act."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.features import Kept
from balloon_warp.kernels.laws import Law, Parameter
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.substep import asking_phases
from balloon_warp.model.parameters import KEYFRAME_VALUES, parameters_at, with_law_tables
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


class Parametrized(Protocol):
    """A model, or the plan of one."""

    @property
    def scene(self) -> Scene: ...

    @property
    def laws(self) -> tuple[Law, ...]: ...

    @property
    def parameters(self) -> Mapping[str, Any]: ...

    @property
    def due_changes(self) -> Sequence[DueChange]: ...

    @property
    def reach(self) -> Mapping[str, Sequence[NDArray[np.float32]]]: ...


def acting_laws(model: Parametrized) -> tuple[Law, ...]:
    """Return the laws that act in any world at any time: the scene has them, and their parameters are not neutral."""
    return tuple(law for law in model.laws if _acts(law, model))


def acting_phases(model: Parametrized) -> tuple[Phase, ...]:
    """Return the phases of the step that act in any world at any time, of those that ask for it as laws do."""
    return tuple(phase for phase in asking_phases() if _acts(phase, model))


def all_that_act(model: Parametrized) -> tuple[Law | Phase, ...]:
    """Return the laws and phases that act."""
    return (*acting_laws(model), *acting_phases(model))


def kept_values(model: Parametrized) -> tuple[Kept, ...]:
    """Return the values that items keep from substep to substep."""
    return tuple(kept for phase in acting_phases(model) for kept in phase.kept)


def _acts(each: Law | Phase, model: Parametrized) -> bool:
    """Return whether a scene has a law or phase, with parameters that are not always neutral."""
    return (each.wants is None or each.wants(model.scene)) and not _rests(each, model)


def _rests(each: Law | Phase, model: Parametrized) -> bool:
    return bool(each.neutral) and all(
        (values == np.float32(neutral)).all()
        for name, neutral in each.neutral.items()
        for values in values_over_time(model, name)
    )


def values_over_time(model: Parametrized, name: str) -> Iterator[NDArray[np.float32]]:
    """Iterate over a parameter's values in all worlds: at the start, after each change, and at a control's bounds."""
    rows = model.parameters[name]
    yield np.asarray(rows.numpy() if isinstance(rows, wp.array) else rows, dtype=np.float32)
    for change in model.due_changes:
        if name in change.values:
            yield np.asarray(change.values[name][1], dtype=np.float32)
    yield from model.reach.get(name, ())

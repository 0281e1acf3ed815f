"""Spans: the frames between changes that a scene plans, in each of which parameters stay as they are."""

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Parameter
from balloon_warp.model import Model, ModelPlan
from balloon_warp.model.friction import FRICTION, SAID
from balloon_warp.model.parameters import Place, places_of
from balloon_warp.model.rows import rows_of
from balloon_warp.scene.schema.scene import Change
from balloon_warp.scene.timeline import frame_at

Slopes = dict[str, NDArray[np.float64]]
"""Slopes of parameters by a value, by their names, shape (world_count, ...) as they are there"""
OF_CHANGE = re.compile(r"change\.(\d+)\.set\.(.+)")
"""Path of a value that a change sets"""


def first_frames(plan: ModelPlan) -> list[int]:
    """Return the frames with which spans begin."""
    return [0, *(change.frame for change in plan.due_changes if change.frame < plan.scene.frames)]


class KeptParameters:
    """Keep parameters that change, as they are in each span.

    Args:
        model: whose parameters change while it is simulated.
    """

    def __init__(self, plan: ModelPlan, model: Model):
        self._model, self._begins = model, first_frames(plan)
        names = {name for change in plan.due_changes for name in change.values}
        self._names = names | ({FRICTION} if not names.isdisjoint(SAID) else set())
        self._kept: list[dict[str, NDArray]] = []

    def note(self, frame: int) -> None:
        """Keep the values of a simulated frame that begins a span."""
        for _ in range(self._begins.count(frame)):
            self._kept.append({name: self._model.parameters[name].numpy().copy() for name in self._names})

    def span_of(self, frame: int) -> int:
        """Return the span of a frame."""
        return max(sum(begin <= frame for begin in self._begins) - 1, 0)

    def of_span(self, span: int) -> dict[str, NDArray]:
        """Return the parameters of a span that change at any time, by their names."""
        return self._kept[span]

    def bring_back(self, span: int) -> None:
        """Set parameters to their values in a span."""
        for name, values in self._kept[span].items():
            self._model.parameters[name].assign(values)


def slopes_of_spans(plan: ModelPlan, slopes: Slopes) -> tuple[Slopes, ...]:
    """Return the slopes in each span by a value that counts from the start, until changes set another one."""
    spans = [slopes]
    for frame in first_frames(plan)[1:]:
        spans.append(_without(spans[-1], _written(plan, frame, -1)))
    return tuple(spans)


def slopes_of_change(plan: ModelPlan, path: str) -> tuple[Slopes, ...]:
    """Return the slopes in each span by a value that a change sets, until others set another one.

    Raises:
        InputError: there is no such change, or it sets no number there.
    """
    number, inner = _parts_of(plan, path)
    at = frame_at(plan.scene, plan.scene.change[number].time)
    begins, spans = first_frames(plan), list[Slopes]()
    slopes: Slopes = {}
    for span, frame in enumerate(begins):
        if span and frame == at:
            slopes = {
                name: np.repeat(mask[None].astype(np.float64), plan.world_count, axis=0)
                for name, mask in _masks(plan, [inner]).items()
            }
            slopes = _without(slopes, _written(plan, frame, number))
        elif span:
            slopes = _without(slopes, _written(plan, frame, -1))
        spans.append(slopes)
    return tuple(spans)


def _parts_of(plan: ModelPlan, path: str) -> tuple[int, str]:
    """Return the number of a change, and the path that it sets.

    Raises:
        InputError: there is no such change, or it sets no number there.
    """
    told, changes = OF_CHANGE.fullmatch(path), plan.scene.change
    if not told or int(told[1]) >= len(changes):
        raise InputError(f"{path}: the scene has {len(changes)} changes; expected change.NUMBER.set.PATH, from 0")
    number, inner = int(told[1]), told[2]
    value = changes[number].set.get(inner)
    if value is None:
        vector, _, axis = inner.rpartition(".")
        value = changes[number].set.get(vector)
        value = value[int(axis)] if isinstance(value, list | tuple) and axis.isdecimal() else value
    if isinstance(value, bool) or not isinstance(value, int | float):
        paths = ", ".join(changes[number].set)
        raise InputError(f"{path}: change {number} sets no number there; expected one of what it sets, {paths}")
    return number, inner


def _written(plan: ModelPlan, frame: int, after: int) -> dict[str, NDArray[np.bool_]]:
    """Return the entries of parameters that changes set at a frame, those of a number and before left out."""
    masks: dict[str, NDArray[np.bool_]] = {}
    if after < 0:
        (due,) = (change for change in plan.due_changes if change.frame == frame)
        masks = {name: which.copy() for name, (which, _) in due.values.items()}
    for name, mask in _masks(plan, list(_paths_set(plan.scene.change, plan, frame, after))).items():
        masks[name] = masks[name] | mask if name in masks else mask
    return masks


def _paths_set(changes: Sequence[Change], plan: ModelPlan, frame: int, after: int) -> Iterator[str]:
    """Yield the paths that changes set at a frame, those of a number and before left out."""
    for number, change in enumerate(changes):
        if number > after and frame_at(plan.scene, change.time) == frame:
            yield from change.set


def _masks(plan: ModelPlan, paths: Sequence[str]) -> dict[str, NDArray[np.bool_]]:
    """Return the entries of parameters at paths, or in the tables or vectors there."""
    rows: Sequence[Parameter] = rows_of(plan.laws)
    places: Mapping[str, list[Place]] = places_of(plan.scene, rows)
    masks: dict[str, NDArray[np.bool_]] = {}
    for path in paths:
        for known, found in places.items():
            for name, index in found if known == path or known.startswith(f"{path}.") else ():
                if name in plan.parameters:
                    masks.setdefault(name, np.zeros(plan.parameters[name].shape[1:], dtype=bool))[index] = True
    return masks


def _without(slopes: Slopes, written: Mapping[str, NDArray[np.bool_]]) -> Slopes:
    """Return slopes without those of entries that have been written."""
    left = {name: np.where(written[name], 0.0, array) if name in written else array for name, array in slopes.items()}
    return {name: array for name, array in left.items() if array.any()}

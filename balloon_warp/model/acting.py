"""Selection of the laws and phases that act in a scene."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.features import Kept
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.substep import asking_phases
from balloon_warp.model.timeline import DueChange
from balloon_warp.scene import Scene


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

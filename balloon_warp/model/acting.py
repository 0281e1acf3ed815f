"""Selection of the laws that act in a scene."""

from collections.abc import Iterator

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Law
from balloon_warp.model.model import Model
from balloon_warp.model.plan import ModelPlan


def acting_laws(model: Model | ModelPlan) -> tuple[Law, ...]:
    """Return the laws that act in any world at any time: the scene has them, and their parameters are not neutral."""
    return tuple(law for law in model.laws if (law.wants is None or law.wants(model.scene)) and not _rests(law, model))


def _rests(law: Law, model: Model | ModelPlan) -> bool:
    """Return whether a law's parameters are always neutral."""
    return bool(law.neutral) and all(
        (values == np.float32(neutral)).all()
        for name, neutral in law.neutral.items()
        for values in values_over_time(model, name)
    )


def values_over_time(model: Model | ModelPlan, name: str) -> Iterator[NDArray[np.float32]]:
    """Iterate over a parameter's values in all worlds, at the start and after each change."""
    rows = model.parameters[name]
    yield np.asarray(rows.numpy() if isinstance(rows, wp.array) else rows, dtype=np.float32)
    for change in model.due_changes:
        if name in change.values:
            yield np.asarray(change.values[name][1], dtype=np.float32)

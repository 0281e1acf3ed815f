"""Which parameters of a running model a plan changes."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.model import Model
from balloon_warp.model.plan import ModelPlan


def what_differs(plan: ModelPlan, model: Model) -> dict[str, NDArray]:
    """The parameters of the plan that are others than those of the model; where things start does not count."""
    differing = {}
    for name, rows in plan.parameters.items():
        if not name.startswith("initial_"):
            running = model.parameters[name].numpy()
            if not np.array_equal(rows.astype(running.dtype).reshape(running.shape), running):
                differing[name] = rows
    return differing

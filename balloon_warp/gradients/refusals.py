"""What gradients refuse, in a sentence each."""

from collections.abc import Sequence

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.gradients.chain import Chain
from balloon_warp.mesh.topology import inconsistent_edges, is_closed, mesh_edges
from balloon_warp.model import Model, ModelPlan
from balloon_warp.schedules.backward import gradient_step, kernels_of
from balloon_warp.schedules.traits import model_traits

FOUND = ("keyframe_values", "initial_gas_amounts", "initial_free_volumes")
"""Parameters, besides those of laws and of the start, by which is derived"""


def require_differentiable(plan: ModelPlan) -> None:
    """Make sure that a scene is one that gradients know, as far as the scene tells.

    Raises:
        InputError: names what it has.
    """
    scene = plan.scene
    if scene.solver == "projective":
        raise InputError('gradients: `projective` has no adjoint; expected solver = "symplectic_euler"')
    if scene.touches:
        raise InputError("gradients: balloons that touch have no adjoint yet; expected touch = false")
    if plan.due_changes:
        raise InputError("gradients: values that change on the way, by `[[change]]`, have no adjoint yet")


def require_paths(plan: ModelPlan, model: Model, chains: Sequence[Chain]) -> None:
    """Make sure that all phases of a scene run backwards, and lead to what is derived by.

    Raises:
        InputError: names the phase, or the path.
    """
    traits = model_traits(model)
    kernels_of(gradient_step(model, traits), ())
    if traits.measures_areas:
        for shape in plan.shapes:
            edges = mesh_edges(shape.mesh)
            if not is_closed(edges) or len(inconsistent_edges(edges)):
                raise InputError(f"gradients: {shape.name}: a pressure on an open mesh has no adjoint yet")
    laws = {row.name for row in model.columns.rows}
    for chain in chains:
        if not chain.slopes:
            raise InputError(f"{chain.path}: no path leads from it to the loss: nothing follows from its value")
        for name, slopes in chain.slopes.items():
            if name in model.parameters and name not in laws and name not in FOUND and not name.startswith("initial_"):
                raise InputError(f"{chain.path}: cannot be derived by yet, for it acts by `{name}`")
            if name == "gamma" and (np.asarray(plan.parameters["gamma"]) == 1.0).any():
                raise InputError(f"{chain.path}: cannot be derived by at 1, where the law is another one")
            if not np.isfinite(slopes).all():
                raise InputError(f"{chain.path}: cannot be derived by, its slope is not finite")

"""Refuse what cannot be differentiated, in a sentence each."""

from collections.abc import Sequence

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.gradients.chain import Chain
from balloon_warp.kernels.laws.softening import PARAMETERS as SOFTENING
from balloon_warp.kernels.laws.tearing import PARAMETERS as TEARING
from balloon_warp.mesh.topology import inconsistent_edges, is_closed, mesh_edges
from balloon_warp.model import Model, ModelPlan
from balloon_warp.schedules.backward import gradient_step, kernels_of
from balloon_warp.schedules.traits import model_traits

FOUND = ("keyframe_values", "initial_gas_amounts", "initial_free_volumes")
"""Parameters, besides those of laws and of the start, by which is derived"""


UNREAD = frozenset(row.name for row in (*SOFTENING, *TEARING))
"""Parameters that only phases without an adjoint read, so that they do nothing in what is derived"""


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
            known = name in laws or name in FOUND or name in UNREAD or name.startswith("initial_")
            if name in model.parameters and not known:
                raise InputError(f"{chain.path}: cannot be derived by yet, for it acts by `{name}`")
            if name == "gamma" and (np.asarray(plan.parameters["gamma"]) == 1.0).any():
                raise InputError(f"{chain.path}: cannot be derived by at 1, where the law is another one")
            if not np.isfinite(slopes).all():
                raise InputError(f"{chain.path}: cannot be derived by, its slope is not finite")

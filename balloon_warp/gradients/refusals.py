"""Refuse features that cannot be differentiated, in a sentence each."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.device import pick_device
from balloon_warp.errors import InputError
from balloon_warp.gradients.bars import ON_GROUND
from balloon_warp.gradients.chain import Chain
from balloon_warp.gradients.obstacles import KEYFRAMES
from balloon_warp.kernels.adjoints.sphere_bars import COLUMNS as OF_SPHERES
from balloon_warp.kernels.adjoints.sphere_log import EVENTS_OF_A_SPHERE
from balloon_warp.kernels.laws.softening import PARAMETERS as SOFTENING
from balloon_warp.kernels.laws.tearing import PARAMETERS as TEARING
from balloon_warp.mesh.topology import inconsistent_edges, is_closed, mesh_edges
from balloon_warp.model import Model, ModelPlan
from balloon_warp.model.friction import FRICTION, SAID
from balloon_warp.model.memory import usable_memory
from balloon_warp.model.small_spheres import round_ridges
from balloon_warp.model.touch import STIFFNESSES
from balloon_warp.model.vary import METHODS
from balloon_warp.schedules.backward_fixtures import POSITION
from balloon_warp.schedules.backward_launched import gradient_step, kernels_of
from balloon_warp.schedules.backward_spheres import OF_OBSTACLES as RESTITUTION
from balloon_warp.schedules.backward_strings import ANCHOR, OF_STRINGS
from balloon_warp.schedules.backward_tubes import CONDUCTANCE
from balloon_warp.schedules.features import model_features

FOUND = (CONDUCTANCE, RESTITUTION, "keyframe_values", "initial_gas_amounts", "initial_free_volumes")
"""Parameters, besides those of laws and of the start, by which is derived"""
OF_OBSTACLES = (POSITION, KEYFRAMES)
"""Parameters of obstacles by which is derived where particles alone meet these"""
FRICTIONS = (FRICTION, "obstacle_friction", "sphere_friction")
"""Friction of pairs, and the parameters that it follows from"""
RESTITUTIONS = ("sphere_restitution", RESTITUTION)
"""Restitution of spheres, and of obstacles with them"""
BYTES_OF_A_FRAME = 72
"""Memory of the host for a particle: place and velocity, and a loss's derivatives by place, as given and checked"""
UNREAD = frozenset(row.name for row in (*SOFTENING, *TEARING))
"""Parameters that only phases without an adjoint read, so that they have no effect on derivatives"""


def require_differentiable(plan: ModelPlan) -> None:
    """Make sure that a scene is one that gradients know, as far as the scene tells.

    Raises:
        InputError: names the feature that they do not know.
    """
    scene = plan.scene
    if scene.solver == "projective":
        raise InputError('gradients: `projective` has no adjoint; expected solver = "symplectic_euler"')
    for number, change in enumerate(scene.change):
        for path in change.set:
            if path in METHODS or path.endswith(".gamma"):
                raise InputError(f"gradients: change.{number}.set: {path}: has no adjoint if it changes on the way")


def require_paths(plan: ModelPlan, model: Model, chains: Sequence[Chain]) -> None:
    """Make sure that all phases of a scene run backwards, and lead to the values to derive by.

    Raises:
        InputError: names the phase, or the path.
    """
    features = model_features(model)
    kernels_of(gradient_step(model, features), ())
    if features.measures_areas:
        for shape in plan.shapes:
            edges = mesh_edges(shape.mesh)
            if not is_closed(edges) or len(inconsistent_edges(edges)):
                raise InputError(f"gradients: {shape.name}: a pressure on an open mesh has no adjoint yet")
    laws = {row.name for row in model.columns.rows}
    for chain in chains:
        if not any(chain.spans):
            raise InputError(f"{chain.path}: no path leads from it to the loss: nothing follows from its value")
        for name, slopes in (each for span in chain.spans for each in span.items()):
            known = name in laws or name in (*FOUND, *OF_SPHERES) or name in UNREAD or name.startswith("initial_")
            known = known or (name == FRICTION and _is_of_balloons(plan, slopes)) or name == STIFFNESSES
            known = (
                known
                or (name in OF_STRINGS and not (name == ANCHOR and _carried(plan)))
                or (name in OF_OBSTACLES and _only_particles_meet(plan))
            )
            known = known or (name in FRICTIONS and _frictions_are_known(plan, model))
            known = known and not (name in RESTITUTIONS and plan.scene.body)
            changes = name in (FRICTION, *SAID) and _friction_changes(plan)
            if changes or (name in (*model.parameters, KEYFRAMES) and not known):
                raise InputError(f"{chain.path}: cannot be derived by yet, for it acts by `{name}`")
            if name == "gamma" and (np.asarray(plan.parameters["gamma"]) == 1.0).any():
                raise InputError(f"{chain.path}: cannot be derived by at 1, where the law is another one")
            if not np.isfinite(slopes).all():
                raise InputError(f"{chain.path}: cannot be derived by, its slope is not finite")


def _is_of_balloons(plan: ModelPlan, slopes: NDArray[np.float64]) -> bool:
    """Return whether all coefficients that grow are those of balloons, with each other or the ground."""
    balloons = np.arange(slopes.shape[1])[-len(plan.shapes) :]
    known = [ON_GROUND, *balloons]
    others = slopes.copy()
    others[:, np.array(known)[:, None], known] = 0.0
    return not others.any()


def _only_particles_meet(plan: ModelPlan) -> bool:
    """Return whether particles alone meet obstacles: nothing else that does, or hangs on them, is derived by them."""
    return not (plan.scene.sphere or plan.scene.body or plan.ridges or _carried(plan))


def _carried(plan: ModelPlan) -> bool:
    """Return whether an obstacle carries the anchor of a string."""
    return any(string.obstacle is not None for string in plan.scene.string)


def _frictions_are_known(plan: ModelPlan, model: Model) -> bool:
    """Return whether all that rubs is derived by how it does: not so are bodies, and faces on ridges or as on these."""
    return not (plan.scene.body or plan.ridges or any(round_ridges(model)))


def _friction_changes(plan: ModelPlan) -> bool:
    """Return whether some friction changes on the way."""
    return any(not set(SAID).isdisjoint(change.values) for change in plan.due_changes)


def require_room_for_bounces(worlds: NDArray[np.intp]) -> None:
    """Check that spheres have not met too much.

    Raises:
        InputError: names the first of the worlds in which they have.
    """
    if len(worlds):
        raise InputError(
            f"gradients: the spheres of world {worlds[0]} meet each other, obstacles or the ground more than "
            f"{EVENTS_OF_A_SPHERE} times each in a substep; expected them less crowded"
        )


def bytes_of_tracks(plan: ModelPlan, every: int) -> int:
    """Return the memory of the host for the trajectories that a loss sees, and for its derivatives by them."""
    return BYTES_OF_A_FRAME * plan.particle_count * plan.world_count * (plan.scene.frames // every)


def require_room_for_frames(plan: ModelPlan, every: int, checkpoints: int | None) -> None:
    """Check that the host has room for the trajectories, and for a loss's derivatives by them.

    Raises:
        InputError: it has not; the message says how many frames or worlds it has room for. Or the interval of the
            frames that a loss sees is none, or the number of frames from which others are simulated again.
    """
    frames, worlds = plan.scene.frames, plan.world_count
    if not 1 <= every <= frames:
        raise InputError(f"every: must be a whole number from 1 to {frames}, the frames of the scene (got {every!r})")
    if checkpoints is not None and checkpoints < 1:
        raise InputError(f"checkpoints: must be at least 1 (got {checkpoints!r})")
    needed, usable = bytes_of_tracks(plan, every), usable_memory(pick_device("cpu"))
    if needed > usable:
        seen = frames // every
        raise InputError(
            f"gradients: {seen} frames of {worlds} worlds do not fit: trajectories and derivatives by them need "
            f"{needed / 2**30:.2f} GiB, and the host has {usable / 2**30:.2f} GiB to spare, enough for "
            f"{usable * seen // needed} frames, or {usable * worlds // needed} worlds; expected fewer, or a loss of "
            f"fewer frames, such as every={frames}"
        )

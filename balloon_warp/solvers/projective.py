"""The `projective` solver: backward Euler by local and global steps (Liu et al. 2013), stable at any step."""

from typing import Any

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.hooke import HOOKE
from balloon_warp.kernels.solvers.projective import (
    apply_increments,
    ending_kernel,
    foreseeing_kernel,
    local_step_kernel,
)
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.launched import LaunchedSchedule, Moving
from balloon_warp.schedules.tables import world_state
from balloon_warp.schedules.traits import model_traits
from balloon_warp.solvers.dense_inverse import DenseInverse
from balloon_warp.solvers.sparse_factor import SparseFactor
from balloon_warp.solvers.step_matrices import FACTORIZED, StepMatrices


class ProjectiveSolver(LaunchedSchedule):
    """Advances a state by whole frames, in place. Bit-reproducible.

    Springs, strings and damping are implicit; gravity, helium, other laws on particles and inflation are those at a
    substep's start, and contacts follow at its end, as in the schedules.

    Raises:
        InputError: the model has physics that it lacks, or a balloon is too large for a GPU, see `DenseInverse`.
    """

    name = "projective"

    def __init__(self, model: Model, global_step: type[SparseFactor] | type[DenseInverse] | None = None):
        if beyond := _beyond(model_traits(model)):
            raise InputError(f'solver: "projective" does not simulate {beyond}; expected another solver')
        super().__init__(model)
        self._global_step = (global_step or _global_step(model))(model, StepMatrices(model))

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the factors are made of."""
        return FACTORIZED

    @staticmethod
    def allot(model: Model, traits: Traits, room: Room) -> tuple[Any, ...]:
        """Five vectors of each particle: displacements without springs, displacements, points tried, residuals, and
        increments of displacements."""
        return tuple(room.array((model.world_count, model.particle_count), wp.vec3) for _ in range(5))

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        return super().world_bytes(model) + _global_step(model).world_bytes(model, StepMatrices(model))

    def advance_substep(self, state: State, time_in_frame: float, now: Moving) -> Moving:
        """Local and global steps in turn."""
        free, displacements, trials, residuals, increments = self.vectors
        t, worlds, working, launch = self.tables, world_state(state), self.pieces.working, self.pieces.over_particles
        launch(foreseeing_kernel(self.traits), t, time_in_frame, worlds, working, free, displacements, trials)
        for _ in range(self.model.scene.solver_iterations):
            launch(local_step_kernel(self.traits), t, free, displacements, trials, residuals)
            self._global_step.solve(residuals, increments)
            launch(apply_increments, state.points, increments, displacements, trials)
        launch(ending_kernel(self.traits), t, time_in_frame, displacements, worlds, working)
        return now


def _beyond(traits: Traits) -> str | None:
    """What it does not simulate, in words, or None."""
    if traits.touches:
        return "balloons that touch"
    if traits.membranes:
        return f"{traits.membranes[0].name.replace('_', '-')} material"
    if traits.bodies:
        return "free rigid bodies"
    if traits.small_spheres:
        return "spheres that touch faces"
    if traits.pressures:
        return "pressure or gas"
    if traits.corrected:
        return "position correction"
    for law in traits.laws:
        implicit = law is HOOKE or law.kind == "string"
        if not implicit and law.kind != "particle":
            return law.name.replace("_", " ")
    for given, words in (("water_load", "water"), ("area_vector", "drag in air")):
        if traits.needs("particle", given):
            return words
    return None


def _global_step(model: Model) -> type[SparseFactor] | type[DenseInverse]:
    return SparseFactor if model.device.is_cpu else DenseInverse

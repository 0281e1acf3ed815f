"""The `projective` solver: backward Euler by local and global steps (Liu et al. 2013), stable at any step."""

from collections.abc import Iterator
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
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.pieces import Pieces
from balloon_warp.schedules.tables import make_tables, world_state
from balloon_warp.schedules.traits import model_traits
from balloon_warp.solvers.dense_inverse import DenseInverse
from balloon_warp.solvers.sparse_factor import SparseFactor
from balloon_warp.solvers.step_matrices import FACTORIZED, StepMatrices


class ProjectiveSolver:
    """Advances a state by whole frames, in place. Bit-reproducible.

    Springs, strings and damping are implicit; gravity, helium, other laws on particles and inflation are those at a
    substep's start, and contacts follow at its end, as in the schedules.

    Raises:
        InputError: the model has physics that it lacks, or a balloon is too large for a GPU, see `DenseInverse`.
    """

    name = "projective"
    capturable = True
    depends_on = FACTORIZED

    def __init__(self, model: Model, global_step: type[SparseFactor] | type[DenseInverse] | None = None):
        self.model, self._traits = model, model_traits(model)
        if beyond := _beyond(self._traits):
            raise InputError(f'solver: "projective" does not simulate {beyond}; expected another solver')
        self._global_step = (global_step or _global_step(model))(model, StepMatrices(model))
        self._tables = make_tables(model, self._traits)
        room = Allocating(model.device)
        self._pieces = Pieces(model, self._traits, self._tables, room)
        self._free, self._displacements, self._trials, self._residuals, self._increments = _vectors(model, room)
        self._health = HealthCheck(model, self._tables)

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        room = Counting()
        Pieces.allot(model, model_traits(model), room)
        _vectors(model, room)
        return room.bytes // model.world_count + _global_step(model).world_bytes(model, StepMatrices(model))

    def advance_frame(self, state: State) -> None:
        """One frame: the inflation refreshed, then every substep."""
        for _ in self.substeps(state):
            pass

    def substeps(self, state: State) -> Iterator[int]:
        """One frame that pauses after each substep, with its number from 0."""
        pieces = self._pieces
        pieces.begin_frame(state)
        for substep in range(self.model.substeps):
            if substep == 0 or self._traits.fresh_normals:
                pieces.refresh(state.points)
            pieces.roll(state)
            self._advance_substep(state, substep * self.model.step_seconds)
            pieces.touch(state, state.points, state.velocities)
            yield substep
        pieces.end_frame(state)
        self._health.end_frame(state)

    def _advance_substep(self, state: State, time_in_frame: float) -> None:
        t, u, trials = self._tables, self._displacements, self._trials
        worlds, working, launch = world_state(state), self._pieces.working, self._pieces.over_particles
        launch(foreseeing_kernel(self._traits), t, time_in_frame, worlds, working, self._free, u, trials)
        for _ in range(self.model.scene.solver_iterations):
            launch(local_step_kernel(self._traits), t, self._free, u, trials, self._residuals)
            self._global_step.solve(self._residuals, self._increments)
            launch(apply_increments, state.points, self._increments, u, trials)
        launch(ending_kernel(self._traits), t, time_in_frame, u, worlds, working)


def _beyond(traits: Traits) -> str | None:
    """What it does not simulate, in words, or None."""
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


def _vectors(model: Model, room: Room) -> tuple[Any, ...]:
    """Five vectors of each particle."""
    return tuple(room.array((model.world_count, model.particle_count), wp.vec3) for _ in range(5))


def _global_step(model: Model) -> type[SparseFactor] | type[DenseInverse]:
    return SparseFactor if model.device.is_cpu else DenseInverse

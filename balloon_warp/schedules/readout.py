"""Readout of forces for display and output, whatever the schedule."""

from copy import copy
from typing import Any, Self

import warp as wp

from balloon_warp.kernels.measure.observed import law_measure, pull_kernel, spring_measure, string_measure
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.schedules.writer import cut
from balloon_warp.kernels.substep import READING, phases_of
from balloon_warp.model import Model, State
from balloon_warp.model.state import Allocating
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.launched import Launches
from balloon_warp.schedules.tables import make_tables, place_anchors, refresh_ramp, tables_of_world
from balloon_warp.system.warp_threads import launch

PULL, INFLATE = "pull", "inflate"
"""Phases that begin a launch of their own"""
SHOWN = ("force", "area_vector", "inflation_direction", "inflation", "net_force")
"""Values that are kept of the phases"""


class ForceReader:
    """Finds the forces of a state, which a schedule need not keep.

    Args:
        batch: of which the model is one world.
    """

    def __init__(self, model: Model, batch: Model | None = None):
        self.model = model
        self._features = model_features(batch or model)
        self._tables = make_tables(batch or model, self._features)
        self._tables.step_seconds = 0.0  # forces as they are now, not on average over a step
        if batch:
            self._tables = tables_of_world(model, self._tables)
        step = cut(phases_of(self._features, READING), self._features, GATHERED, apart=(PULL, INFLATE), shown=SHOWN)
        self._launches = Launches(model, step, self._tables, Allocating(model.device))

    def beside(self, model: Model) -> Self:
        """Return a reader of another world of the same batch, which shares its memory with this one."""
        other = copy(self)
        other.model, other._tables = model, tables_of_world(model, self._tables)
        other._launches = self._launches.beside(model, other._tables)
        return other

    def refresh(self, state: State) -> None:
        """Update values at the begin of a frame: the ramp of k_normal, inflation directions and area vectors."""
        refresh_ramp(self.model, state)
        place_anchors(self.model, self._tables, state)
        self._execute(state, *self._first)
        if self._features.measures_areas:
            self._execute(state, PULL)

    def inflation_forces(self, state: State, substep: int = 0) -> wp.array:
        """Return the inflation's force on each particle [N], shape (world_count, particle_count), vec3.

        `refresh` must be called before.
        """
        self._execute(state, INFLATE, substep=substep)
        return self._launches.values["inflation"]

    def net_forces(self, state: State) -> wp.array:
        """Return the net force on each particle at the start of a frame [N], shape (world_count, particle_count), vec3.

        `refresh` must be called before.
        """
        self._execute(state, PULL, INFLATE)
        return self._launches.values["net_force"]

    def spring_pulls(self, state: State, time: float) -> wp.array:
        """Return the tension of each spring, negative if it pushes [N], shape (world_count, spring_count)."""
        return self._measure(spring_measure(self._features), state, time, 1, self.model.spring_count)[:, 0]

    def string_pulls(self, state: State, time: float) -> wp.array:
        """Return the tension of each string [N], shape (world_count, string_count)."""
        return self._measure(string_measure(self._features), state, time, 1, self.model.string_count)[:, 0]

    def pulls_by_law(self, state: State, time: float) -> dict[str, wp.array]:
        """Return the force of each law on each particle [N], shape (world_count, particle_count).

        Laws on particles, hinges or faces, and those of membranes.
        """
        features, laws = self._features, [law for law in self._features.laws if law.kind not in ("spring", "string")]
        alone = {law.name: features._replace(laws=(law,), membranes=()) for law in laws}
        alone |= {"membrane": features._replace(laws=())} if features.membranes else {}
        if not alone:
            return {}
        measure = law_measure(tuple(alone.values()))
        pulls = self._measure(measure, state, time, len(alone), self.model.particle_count)
        return {name: pulls[:, number] for number, name in enumerate(alone)}

    def _measure(self, measure: Any, state: State, time: float, measured: int, count: int) -> Any:
        worlds, device = self.model.world_count, self.model.device
        pulls = wp.zeros((worlds, measured, count), dtype=float, device=device)
        inputs = [self._tables, time, state.points, state.velocities]
        launch(pull_kernel(measure), (worlds, count), inputs, [pulls], device=device)
        return pulls

    @property
    def _first(self) -> list[str]:
        """Phases with which pieces begin before any force is found."""
        return [
            piece.phases[0].name for piece in self._launches.step.pieces if piece.phases[0].name not in (PULL, INFLATE)
        ]

    def _execute(self, state: State, *phases: str, substep: int = 0) -> None:
        """Execute the pieces that begin with given phases."""
        self._launches.execute(state, substep, (state.points, state.velocities), phases)

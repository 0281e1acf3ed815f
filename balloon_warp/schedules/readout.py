"""Forces as they are shown and written, whatever the schedule."""

from copy import copy
from functools import cached_property
from typing import Any, Self

import warp as wp

from balloon_warp.kernels.measure.pulls import law_measure, pull_kernel, spring_measure, string_measure
from balloon_warp.kernels.schedules.aims import add_inflation_forces
from balloon_warp.kernels.schedules.launched_wear import wear_kernel
from balloon_warp.kernels.schedules.working import Working
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating
from balloon_warp.schedules.aims import AimRefresher
from balloon_warp.schedules.ramp import refresh_ramp
from balloon_warp.schedules.tables import make_tables, tables_of_world, world_state
from balloon_warp.schedules.tears import TearPieces
from balloon_warp.schedules.traits import model_traits


class ForceReader:
    """Finds the forces of a state, which a schedule need not keep.

    Args:
        batch: of which the model is one world.
    """

    def __init__(self, model: Model, batch: Model | None = None):
        self.model = model
        self._traits = model_traits(batch or model)
        self._tables = make_tables(batch or model, self._traits)
        self._tables.step_seconds = 0.0  # forces as they are now, not on average over a step
        if batch:
            self._tables = tables_of_world(model, self._tables)
        self._working = Working()
        room, shape = Allocating(model.device), (model.world_count, model.particle_count)
        for name in ("forces", "aims", "area_vectors"):
            setattr(self._working, name, room.array(shape, wp.vec3))

    def beside(self, model: Model) -> Self:
        """A reader of another world of the same batch, which shares its memory with this one."""
        other = copy(self)
        other.model, other._tables = model, tables_of_world(model, self._tables)
        return other

    def refresh(self, state: State) -> None:
        """What a frame begins with: its ramp, such as of k_normal, each particle's aim, and its area vector."""
        refresh_ramp(self.model, state)
        if self._traits.wears:
            inputs = [self._tables, state.points, state.peaks]
            shape = (self.model.world_count, self.model.triangle_count)
            launch(wear_kernel(self._traits, keeps=False), shape, inputs, device=self.model.device)
        if self._traits.bursts:
            TearPieces(self.model, self._tables).weigh(state, 0.0)
        if self._traits.aims:
            self._refresher.refresh(state.points, self._working.aims)
        if self._traits.measures_areas:
            self._sum_forces(state)

    def inflation_forces(self, state: State, time_in_frame: float = 0.0) -> wp.array:
        """On each particle [N], shape (world_count, particle_count), vec3, once it is refreshed."""
        self._working.forces.zero_()
        self._add_inflation(state, time_in_frame)
        return self._working.forces

    def net_forces(self, state: State) -> wp.array:
        """On each particle at the start of a frame [N], shape (world_count, particle_count), vec3, once it is
        refreshed."""
        self._sum_forces(state)
        self._add_inflation(state, 0.0)
        return self._working.forces

    def spring_pulls(self, state: State, time: float) -> wp.array:
        """With which each spring pulls, or if negative pushes [N], shape (world_count, spring_count)."""
        return self._measure(spring_measure(self._traits), state, time, 1, self.model.spring_count)[:, 0]

    def string_pulls(self, state: State, time: float) -> wp.array:
        """With which each string pulls [N], shape (world_count, string_count)."""
        return self._measure(string_measure(self._traits), state, time, 1, self.model.string_count)[:, 0]

    def pulls_by_law(self, state: State, time: float) -> dict[str, wp.array]:
        """Of each law on particles, hinges or faces, and of membranes, the force on each particle [N], shape
        (world_count, particle_count)."""
        traits, laws = self._traits, [law for law in self._traits.laws if law.kind not in ("spring", "string")]
        alone = {law.name: traits._replace(laws=(law,), membranes=()) for law in laws}
        alone |= {"membrane": traits._replace(laws=())} if traits.membranes else {}
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

    @cached_property
    def _refresher(self) -> AimRefresher:
        return AimRefresher(self.model, self._tables, Allocating(self.model.device))

    def _sum_forces(self, state: State) -> None:
        """All but the inflation's, and the area vectors."""
        # loads when first needed: it has much to load, and aims go without
        from balloon_warp.kernels.schedules.advance import advance_kernel, gathering_loops

        kernel = advance_kernel(self._traits, gathering_loops(self._traits), "forces")
        moving = state.points, state.velocities, world_state(state)
        self._launch(kernel, self._tables, 0.0, *moving, self._working, None, None, None)

    def _add_inflation(self, state: State, time_in_frame: float) -> None:
        self._launch(
            add_inflation_forces,
            *(self._tables.particles, self._tables.inflation_kind, self._tables.up),
            *(not self._traits.gas, time_in_frame),
            *(world_state(state), self._working.aims, self._working.area_vectors, self._working.forces),
        )

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        launch(kernel, self._working.forces.shape, inputs=list(arguments), device=self.model.device)

"""The `scatter` schedule: a thread a spring, string, hinge or face, with atomic adds into one force array, and then a
thread a particle.

The readable reference that every other schedule is tested against.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.schedules.advance import summed_loops
from balloon_warp.kernels.schedules.scatter import add_area_vectors, force_kernel
from balloon_warp.kernels.traits import Traits
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.launched import ExplicitSchedule, Moving


class ScatterSchedule(ExplicitSchedule):
    """Advances a state by whole frames, in place."""

    name = "scatter"
    fast_math = False

    def __init__(self, model: Model):
        super().__init__(model)
        self.forces, self._free_velocities = self.vectors
        """of springs, strings, hinges and faces on each particle [N], shape (world_count, particle_count), vec3; and
        what velocity its forces give it, where it then has to wait for others"""
        self.pieces.working.forces = self.forces

    @staticmethod
    def allot(model: Model, traits: Traits, room: Room) -> tuple[Any, ...]:
        """Forces, and velocities where pressures come in between, or forces depend on neighbors' points, of which none
        may have moved."""
        shape = (model.world_count, model.particle_count)
        return room.array(shape, wp.vec3), room.array(shape, wp.vec3) if traits.gas or traits.in_water else None

    def loops(self) -> Any:
        """What `sum_forces` has added up."""
        return summed_loops(self.traits)

    def advance_substep(self, state: State, time_in_frame: float, now: Moving) -> Moving:
        """Forces, then particles, in the same place."""
        self.sum_forces(state, time_in_frame)
        self.step_particles(state, time_in_frame, now, now, self._free_velocities)
        return now

    def sum_forces(self, state: State, time_in_frame: float = 0.0) -> None:
        """Fill `forces`, and area vectors where they are needed."""
        t, traits, model = self.tables, self.traits, self.model
        self.forces.zero_()
        count = model.spring_count + model.string_count + t.hinges.ends.shape[0] + t.membranes.corners.shape[0]
        count += model.face_count if traits.has("face") else 0
        moving = state.points, state.velocities
        self._over(count, force_kernel(traits), t, state.frame, time_in_frame, *moving, self.forces)
        if traits.measures_areas:
            area_vectors = self.pieces.working.area_vectors
            area_vectors.zero_()
            self._over(model.face_count, add_area_vectors, t, state.points, area_vectors)

    def _over(self, count: int, kernel: Any, *arguments: Any) -> None:
        model = self.model
        launch(kernel, (model.world_count, count), inputs=list(arguments), device=model.device)

"""The `scatter` schedule: a thread a spring, string, hinge or face, with atomic adds into one force array, and then a
thread a particle.

The readable reference that every other schedule is tested against.
"""

from collections.abc import Mapping
from typing import Any

import warp as wp

from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.looks import SUMMED
from balloon_warp.kernels.schedules.scatter import add_area_vectors, force_kernel
from balloon_warp.kernels.substep import STEP
from balloon_warp.kernels.traits import Traits
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.launched import LaunchedSchedule
from balloon_warp.schedules.launches import Moving, Own

ADD_FORCES = Phase("add_forces", "launches", lambda traits, look: None)
"""what springs, strings, hinges and faces do, before particles `pull`"""
PLACE = next(place for place, phase in enumerate(STEP) if phase.name == "pull")


class ScatterSchedule(LaunchedSchedule):
    """Advances a state by whole frames, in place."""

    name = "scatter"
    look = SUMMED
    phases = (*STEP[:PLACE], ADD_FORCES, *STEP[PLACE:])

    def __init__(self, model: Model):
        super().__init__(model)
        self.forces, self._area_vectors = self.vectors
        """of springs, strings, hinges and faces on each particle [N], shape (world_count, particle_count), vec3; and
        area vectors"""
        working = self.launches.working
        working.forces, working.area_vectors = self.forces, self._area_vectors

    @staticmethod
    def allot(model: Model, traits: Traits, room: Room) -> tuple[Any, ...]:
        """Forces, and area vectors where they are needed."""
        worlds, particles = model.world_count, model.particle_count
        areas = (worlds, particles if traits.measures_areas else 0)
        return room.array((worlds, particles), wp.vec3), room.array(areas, wp.vec3)

    def own(self) -> Mapping[str, Own]:
        """What it does itself of a step, by the names of phases."""
        return {**super().own(), "add_forces": self._add_forces}

    def _add_forces(self, state: State, substep: int, time_in_frame: float, now: Moving) -> None:
        self.sum_forces(state, time_in_frame)

    def sum_forces(self, state: State, time_in_frame: float = 0.0) -> None:
        """Fill `forces`, and area vectors where they are needed."""
        t, traits, model = self.tables, self.traits, self.model
        self.forces.zero_()
        count = model.spring_count + model.string_count + t.hinges.ends.shape[0] + t.membranes.corners.shape[0]
        count += model.face_count if traits.has("face") else 0
        moving = state.points, state.velocities
        self._over(count, force_kernel(traits), t, state.frame, time_in_frame, *moving, self.forces)
        if traits.measures_areas:
            self._area_vectors.zero_()
            self._over(model.face_count, add_area_vectors, t, state.points, self._area_vectors)

    def _over(self, count: int, kernel: Any, *arguments: Any) -> None:
        model = self.model
        launch(kernel, (model.world_count, count), inputs=list(arguments), device=model.device)

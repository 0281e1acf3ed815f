"""Schedule `scatter`: a thread a spring, string, hinge or face, with atomic adds, and then a thread a particle.

The readable reference that every other schedule is tested against.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.schedules.launched import SUMMED
from balloon_warp.kernels.substep import SCATTERED
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.launched import LaunchedSchedule


class ScatterSchedule(LaunchedSchedule):
    """Advances a state by whole frames, in place."""

    name = "scatter"
    look = SUMMED
    instead = SCATTERED

    def __init__(self, model: Model):
        super().__init__(model)
        self.forces, area_vectors = self.vectors
        """Forces of springs, strings, hinges and faces on each particle [N], shape (world_count, particle_count),
        vec3"""
        self.launches.working.forces, self.launches.working.area_vectors = self.forces, area_vectors

    @classmethod
    def allot(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Return the forces, and area vectors where they are needed."""
        worlds, particles = model.world_count, model.particle_count
        areas = (worlds, particles if features.measures_areas else 0)
        return room.array((worlds, particles), wp.vec3), room.array(areas, wp.vec3)

    def sum_forces(self, state: State) -> None:
        """Add up `forces` of a state, once."""
        self.launches.execute(state, 0, (state.points, state.velocities), ["add_forces"])

"""The `scatter` schedule: a thread a spring, a face or a particle, with atomic adds into one force array.

The readable reference that every other schedule is tested against.
"""

from collections.abc import Iterator
from typing import Any

import warp as wp

from balloon_warp.kernels.schedules.scatter import (
    add_area_vectors,
    face_kernel,
    hinge_kernel,
    particle_kernel,
    spring_kernel,
    string_kernel,
)
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.pieces import Pieces
from balloon_warp.schedules.tables import make_tables
from balloon_warp.schedules.traits import model_traits


class ScatterSchedule:
    """Advances a state by whole frames, in place."""

    name = "scatter"
    capturable = True
    depends_on: frozenset[str] = frozenset()

    def __init__(self, model: Model):
        self.model, self._traits = model, model_traits(model)
        self._tables = make_tables(model, self._traits)
        room = Allocating(model.device)
        self._pieces = Pieces(model, self._traits, self._tables, room)
        self.forces, self._new_velocities = _vectors(model, room)
        """on each particle but the inflation [N], shape (world_count, particle_count), vec3; and what they make of its
        velocity"""
        self._health = HealthCheck(model, self._tables)

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        room = Counting()
        Pieces.allot(model, model_traits(model), room)
        _vectors(model, room)
        return room.bytes // model.world_count

    def advance_frame(self, state: State) -> None:
        """One frame."""
        for _ in self.substeps(state):
            pass

    def substeps(self, state: State) -> Iterator[int]:
        """One frame that pauses after each substep, with its number from 0."""
        pieces, model = self._pieces, self.model
        pieces.begin_frame(state)
        for substep in range(model.substeps):
            time = substep * model.step_seconds
            if substep == 0 or self._traits.fresh_normals:
                pieces.refresh(state.points)
            pieces.roll(state)
            pieces.flow(state, time)
            self.sum_forces(state, time)
            pieces.swell(state, time, state.points, self._new_velocities)
            pieces.push(state, time, (state.points, state.velocities), (state.points, self._new_velocities))
            wp.copy(state.velocities, self._new_velocities)
            pieces.correct(state, state.points, state.velocities)
            pieces.touch(state, state.points, state.velocities)
            yield substep
        pieces.end_frame(state)
        self._health.end_frame(state)

    def sum_forces(self, state: State, time_in_frame: float = 0.0) -> None:
        """Fill `forces` with all but the inflation."""
        t, traits, working = self._tables, self._traits, self._pieces.working
        now = t, state.frame, time_in_frame
        moving = state.points, state.velocities
        self.forces.zero_()
        self._launch(spring_kernel(traits), self.model.spring_count, *now, *moving, self.forces)
        if traits.has("string"):
            self._launch(string_kernel(traits), self.model.string_count, *now, *moving, self.forces)
        if traits.has("hinge"):
            self._launch(hinge_kernel(traits), t.hinges.ends.shape[0], t, state.points, self.forces)
        if traits.has("face"):
            self._launch(face_kernel(traits), self.model.face_count, *now, *moving, self.forces)
        if traits.measures_areas:
            working.area_vectors.zero_()
            self._launch(add_area_vectors, self.model.face_count, t, state.points, working.area_vectors)
        own = *now, *moving, working, self.forces, self._new_velocities
        self._launch(particle_kernel(traits), self.model.particle_count, *own)

    def _launch(self, kernel: Any, count: int, *arguments: Any) -> None:
        model = self.model
        wp.launch(kernel, (model.world_count, count), inputs=list(arguments), device=model.device)


def _vectors(model: Model, room: Room) -> tuple[Any, Any]:
    """Forces on particles [N], and velocities."""
    shape = (model.world_count, model.particle_count)
    return room.array(shape, wp.vec3), room.array(shape, wp.vec3)

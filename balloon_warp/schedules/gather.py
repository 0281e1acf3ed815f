"""The `gather` schedule: a thread a particle, which sums the forces of its own springs. Bit-reproducible.

For one large balloon: two buffers of points, one kernel a substep, one more for the spheres where there are any and
another where they exchange momentum, and three with gas.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.schedules.gather import advance_kernel, pull_kernel
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.pieces import Pieces
from balloon_warp.schedules.tables import make_tables, world_state
from balloon_warp.schedules.traits import model_traits


class GatherSchedule:
    """Advances a state by whole frames, in place."""

    name = "gather"
    capturable = True
    depends_on: frozenset[str] = frozenset()

    def __init__(self, model: Model):
        self.model, self._traits = model, model_traits(model)
        self._tables = make_tables(model, self._traits)
        room = Allocating(model.device)
        self._pieces = Pieces(model, self._traits, self._tables, room)
        self._other_points, self._other_velocities = _buffers(model, self._traits.keeps_velocities, room)
        self._health = HealthCheck(model, self._tables)

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        room, traits = Counting(), model_traits(model)
        Pieces.allot(model, traits, room)
        _buffers(model, traits.keeps_velocities, room)
        return room.bytes // model.world_count

    def advance_frame(self, state: State) -> None:
        """One frame."""
        pieces, model = self._pieces, self.model
        old = state.points, state.velocities
        new = self._other_points, self._other_velocities or state.velocities
        pieces.begin_frame(state)
        for substep in range(model.substeps):
            time = substep * model.step_seconds
            if substep == 0 or self._traits.fresh_normals:
                pieces.refresh(old[0])
            pieces.roll(state)
            if self._traits.gas:
                pieces.flow(state, time)
                self._pull(state, time, old, new[1])
                pieces.swell(state, time, old[0], new[1])
                pieces.push(state, time, old, new)
            else:
                self._pull_push_and_move(state, time, old, new)
            pieces.correct(state, *new)
            pieces.touch(state, *new)
            old, new = new, old
        for array, kept in zip(old, (state.points, state.velocities), strict=True):
            if array is not kept:
                wp.copy(kept, array)
        pieces.end_frame(state)
        self._health.end_frame(state)

    def _pull(self, state: State, time: float, old: tuple[wp.array, wp.array], new_velocities: wp.array) -> None:
        """All forces but the inflation."""
        self._pieces.over_particles(
            pull_kernel(self._traits),
            *(self._tables, time, *old, world_state(state), self._pieces.working, new_velocities),
        )

    def _pull_push_and_move(
        self, state: State, time: float, old: tuple[wp.array, wp.array], new: tuple[wp.array, wp.array]
    ) -> None:
        """The same, and the inflation, the movement and obstacles, in one kernel."""
        self._pieces.over_particles(
            advance_kernel(self._traits),
            *(self._tables, time, *old, world_state(state), self._pieces.working, *new),
        )


def _buffers(model: Model, velocities: bool, room: Room) -> tuple[Any, Any]:
    """Second places, and second velocities where they are needed."""
    shape = (model.world_count, model.particle_count)
    return room.array(shape, wp.vec3), room.array(shape, wp.vec3) if velocities else None

"""The `gather` schedule: a thread a particle, which sums the forces of its own springs. Bit-reproducible.

For one large balloon: two buffers of points, one kernel a substep, one more for the spheres where there are any and
another where they exchange momentum, and three or four with gas. On a GPU one launch for all substeps of a frame, where
particles need of each other no more than where they are, see `patches`.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.schedules.advance import gathering_loops
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.later import near_solids_array, puts_off
from balloon_warp.schedules.launched import ExplicitSchedule, Moving
from balloon_warp.schedules.patches import PatchLaunch, cut_into_patches


class GatherSchedule(ExplicitSchedule):
    """Advances a state by whole frames, in place."""

    name = "gather"
    watchable = False
    fast_math = True

    def __init__(self, model: Model):
        super().__init__(model)
        patches = cut_into_patches(model, self.traits)
        self._patches = PatchLaunch(model, self.traits, self.tables, patches, self.vectors[2]) if patches else None
        self.puts_off = puts_off(model, self.traits)
        self.pieces.working.near_solids = self.vectors[3]

    @staticmethod
    def allot(model: Model, traits: Traits, room: Room) -> tuple[Any, ...]:
        """Second places, and second velocities where they are needed; or what patches keep. And who is put off."""
        later = near_solids_array(model, traits, room)
        if patches := cut_into_patches(model, traits):
            return None, None, PatchLaunch.arrays(model, traits, patches, room), later
        shape = (model.world_count, model.particle_count)
        velocities = room.array(shape, wp.vec3) if traits.keeps_velocities else None
        return room.array(shape, wp.vec3), velocities, None, later

    def loops(self) -> Any:
        """Over its springs, strings, hinges and faces."""
        return gathering_loops(self.traits)

    def advance_frame(self, state: State) -> None:
        """One frame."""
        if self._patches is None:
            super().advance_frame(state)
            return
        self.pieces.begin_frame(state)
        if not self.traits.fresh_normals:
            self.pieces.refresh(state.points)
        self._patches.advance(state, self.pieces.working.aims)
        self.pieces.end_frame(state)
        self._health.end_frame(state)

    def advance_substep(self, state: State, time_in_frame: float, now: Moving) -> Moving:
        """From one buffer to the other."""
        points, velocities, _, _ = self.vectors
        other = (points, velocities or state.velocities) if now[0] is state.points else (state.points, state.velocities)
        self.step_particles(state, time_in_frame, now, other, other[1] if self.traits.gas else None)
        return other

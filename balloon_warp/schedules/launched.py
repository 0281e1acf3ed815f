"""What schedules share that launch a kernel for each piece of a substep: `gather`, `scatter`, and the projective
solver."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any, ClassVar

import warp as wp

from balloon_warp.kernels.schedules.advance import advance_kernel
from balloon_warp.kernels.schedules.launched_later import PARTICLES_OF_BLOCK, end_later_kernel
from balloon_warp.kernels.traits import Traits
from balloon_warp.launching import launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Allocating, Counting, Room
from balloon_warp.schedules.fixtures import look_arrays
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.later import FEW_THREADS
from balloon_warp.schedules.pieces import Pieces
from balloon_warp.schedules.tables import make_tables, world_state
from balloon_warp.schedules.traits import choosing_parameters, model_traits

Moving = tuple[wp.array, wp.array]
"""points and velocities, shape (world_count, particle_count), vec3"""


class LaunchedSchedule(ABC):
    """Advances a state by whole frames, in place, piece by piece."""

    name: ClassVar[str]
    capturable = True
    watchable: ClassVar[bool] = True
    """whether each substep ends in the state"""
    fast_math: ClassVar[bool] = False
    """whether divisions and roots are a GPU's own, good to the last bits but two"""

    def __init__(self, model: Model):
        self.model, self.traits = model, model_traits(model)
        self.tables = make_tables(model, self.traits)
        room = Allocating(model.device)
        self.pieces = Pieces(model, self.traits, self.tables, room, self.fast_math)
        self.vectors = self.allot(model, self.traits, room)
        """its own memory"""
        self._health = HealthCheck(model, self.tables)

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the kernels are chosen by."""
        return choosing_parameters(self.traits)

    @property
    def crowded(self) -> int:
        """How often a triangle that a particle may touch had no place in its list since it was made, in all worlds."""
        return int(self.pieces.working.crowded.numpy().sum())

    @staticmethod
    @abstractmethod
    def allot(model: Model, traits: Traits, room: Room) -> tuple[Any, ...]:
        """Ask for its own memory, beside what the pieces share."""

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        room, traits = Counting(), model_traits(model)
        Pieces.allot(model, traits, room)
        cls.allot(model, traits, room)
        look_arrays(model, room)
        return room.bytes // model.world_count

    @abstractmethod
    def advance_substep(self, state: State, time_in_frame: float, now: Moving) -> Moving:
        """Where particles are then; spheres have moved, and normal forces have their aims."""

    def advance_frame(self, state: State) -> None:
        """One frame."""
        for _ in self.substeps(state):
            pass

    def substeps(self, state: State) -> Iterator[int]:
        """One frame that pauses after each substep, with its number from 0."""
        pieces, kept = self.pieces, (state.points, state.velocities)
        now = kept
        pieces.begin_frame(state)
        for substep in range(self.model.substeps):
            time_in_frame = substep * self.model.step_seconds
            if substep == 0 or self.traits.fresh_normals:
                pieces.refresh(now[0])
            pieces.roll(state, time_in_frame)
            pieces.tumble(state, time_in_frame)
            pieces.press(state, substep, *now)
            pieces.wear(state, time_in_frame, now[0])
            now = self.advance_substep(state, time_in_frame, now)
            pieces.touch(state, time_in_frame, *now)
            yield substep
        for source, target in zip(now, kept, strict=True):
            if source is not target:
                wp.copy(target, source)
        pieces.end_frame(state)
        self._health.end_frame(state)


class ExplicitSchedule(LaunchedSchedule):
    """One whose particles advance by `advance_kernel`."""

    puts_off = False
    """whether some end their substep in a launch of their own, see `kernels.schedules.later`"""

    @abstractmethod
    def loops(self) -> Any:
        """What a particle goes through for its forces."""

    def step_particles(
        self, state: State, time_in_frame: float, old: Moving, new: Moving, free_velocities: wp.array | None
    ) -> None:
        """From the old to the new; given an array for free velocities, all particles get those before any goes on."""
        if free_velocities is None:
            self._launch(state, time_in_frame, old, None, new)
        else:
            self.pieces.pump(state, time_in_frame)
            self._launch(state, time_in_frame, old, free_velocities, None)
            self.pieces.swell(state, time_in_frame, old, free_velocities)
            self._launch(state, time_in_frame, old, free_velocities, new)
        if self.puts_off:
            self._end_later(state, time_in_frame, old[0], new)
        self.pieces.correct(state, time_in_frame, *new)

    def _launch(
        self, state: State, time_in_frame: float, old: Moving, free_velocities: wp.array | None, new: Moving | None
    ) -> None:
        """A thread a particle: a whole substep, or as far as its free velocity, or, with both, from there on."""
        pulls = free_velocities is None or new is None
        loops, until = self.loops() if pulls else None, "end" if new else "free velocities"
        later = new is not None and self.puts_off
        self.pieces.over_particles(
            advance_kernel(self.traits, loops, until, self.fast_math and pulls, later),
            *(self.tables, time_in_frame, *old, world_state(state), self.pieces.working),
            *(free_velocities, *(new or (None, None))),
        )

    def _end_later(self, state: State, time_in_frame: float, old_points: wp.array, new: Moving) -> None:
        """Particles that were put off end the substep."""
        m = self.model
        launch_tiled(
            end_later_kernel(self.traits, self.fast_math),
            dim=[-(-m.world_count * m.particle_count // int(PARTICLES_OF_BLOCK))],
            inputs=[self.tables, time_in_frame, world_state(state), self.pieces.working, old_points, *new],
            block_dim=FEW_THREADS if m.device.is_cuda else 1,
            device=m.device,
        )

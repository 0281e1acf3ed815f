"""Schedules `gather`, a thread a particle, and `scatter`, a thread a spring or face, with launches for a CPU.

The `gather` schedule: a thread a particle, which sums the forces of its own springs. Bit-reproducible.

For one large balloon: two buffers of points, one kernel a substep, one more for the spheres where there are any and
another where they exchange momentum, and three or four with gas. On a GPU one launch for all substeps of a frame, where
particles need of each other no more than where they are, see `patches`.

Schedule `scatter`: a thread a spring, string, hinge or face, with atomic adds, and then a thread a particle.

The readable reference that every other schedule is tested against.

Launches of `gather` for a CPU, in which the forces of eight particles are found side by side.

For busy worlds, and for models of which no world is ever free.
"""

from collections.abc import Mapping
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import Solids
from balloon_warp.kernels.phase import STATE
from balloon_warp.kernels.schedules.lanes import ACCESS, pulling_arguments, pulling_kernel, pulling_source
from balloon_warp.kernels.schedules.lanes_layouts import OCTETS
from balloon_warp.kernels.schedules.launched import GATHERED, SUMMED, source_of
from balloon_warp.kernels.schedules.writer import Step, cut
from balloon_warp.kernels.substep import PULLED, SCATTERED, SHARED_PULL, phases_of
from balloon_warp.model import Model, State
from balloon_warp.model.state import Room
from balloon_warp.schedules.contact_lists import has_many
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.lane_tables import allocate_lanes, make_lane_tables
from balloon_warp.schedules.launched import LaunchedSchedule, Moving, Own
from balloon_warp.schedules.patches import PatchLaunch, cut_into_patches, first_phases
from balloon_warp.schedules.tables import Worlds, kept_arguments
from balloon_warp.system.warp_threads import begin_loading, launch


class GatherSchedule(LaunchedSchedule):
    """Advances a state by whole frames, in place."""

    name = "gather"
    watchable = False
    fast_math = True
    access = GATHERED

    def __init__(self, model: Model, features: Features | None = None, working: Any | None = None):
        """Advance all worlds, or those that the features are for.

        Args:
            working: the memory beside the state, where others judge worlds there; they may have more features.
        """
        super().__init__(model, features)
        self.launches.working = working = working or self.launches.working
        patches = cut_into_patches(model, self.features)
        self._patches = None
        if patches:
            self._patches = PatchLaunch(model, self.features, self.tables, patches, self.vectors[0], working)

    @classmethod
    def step_of(cls, model: Model, features: Features) -> Step:
        """Return the phases of the model, in pieces.

        Resting contact has a launch of its own: of many particles on a GPU those without contact neither wait for
        others, nor take as many registers.
        """
        apart = ("leave",) if features.may_touch_obstacles and has_many(model) else ()
        if cut_into_patches(model, features):
            return cut(first_phases(features), features, cls.access, shown=("inflation_direction",))
        return cut(phases_of(features), features, cls.access, apart=apart)

    @classmethod
    def allocate(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Allocate the memory of patches."""
        patches = cut_into_patches(model, features)
        return (PatchLaunch.arrays(model, features, patches, room),) if patches else ()

    def begin_loading(self) -> None:
        """Compile the kernels of a substep ahead."""
        self.launches.begin_loading()

    def advance_frame(self, state: State) -> None:
        """Advance all worlds by a frame."""
        if self._patches is None:
            super().advance_frame(state)
            return
        self.framing.begin(state)
        self.advance_patches(state)
        self.framing.end(state)

    def advance_patches(self, state: State) -> None:
        """Run the substeps of a frame in patches."""
        assert self._patches
        if self.launches.step.pieces:
            self.launches.substep(state, 0, (state.points, state.velocities))
        self._patches.advance(state, self.launches.values.get("inflation_direction"))


class ScatterSchedule(LaunchedSchedule):
    """Advances a state by whole frames, in place."""

    name = "scatter"
    access = SUMMED
    instead = SCATTERED

    def __init__(self, model: Model):
        super().__init__(model)
        self.forces, area_vectors = self.vectors
        """Forces of springs, strings, hinges and faces on each particle [N], shape (world_count, particle_count),
        vec3"""
        self.launches.working.forces, self.launches.working.area_vectors = self.forces, area_vectors

    @classmethod
    def allocate(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Return the forces, and area vectors where they are needed."""
        worlds, particles = model.world_count, model.particle_count
        areas = (worlds, particles if features.measures_areas else 0)
        return room.array((worlds, particles), wp.vec3), room.array(areas, wp.vec3)

    def sum_forces(self, state: State) -> None:
        """Add up `forces` of a state, once."""
        self.launches.execute(state, 0, (state.points, state.velocities), ["add_forces"])


PULL = "pull"
"""Phase that a kernel of octets executes"""


class PullingOctets(GatherSchedule):
    """Advances a state by whole frames, in place; the phase `pull` is a launch of its own, of octets."""

    name = "octets"

    def __init__(self, model: Model, features: Features | None = None):
        super().__init__(model, features)
        self._states = Worlds()
        self._pulling = _pulling_step(self.launches.step)
        self._kernel = pulling_kernel(self._pulling)
        (memory,) = self.vectors
        t = make_lane_tables(model, self.features, OCTETS, self.tables)
        for struct, arrays in ((t, memory.of_tables), (solids := Solids(), memory.solids)):
            for name, array in arrays.items():
                setattr(struct, name, array)
        self._has: dict[str, Any] = {"t": t, "tables": self.tables, "solids": solids, **memory.of_kernel}

    @classmethod
    def step_of(cls, model: Model, features: Features) -> Step:
        """Return the phases of the model, in pieces: `pull` by itself."""
        phases = phases_of(features, instead=PULLED)
        names = [phase.name for phase in phases if not phase.light]
        after = names[names.index(PULL) + 1]
        return cut(phases, features, cls.access, apart=(PULL, after))

    @classmethod
    def allocate(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Allocate the memory of octets."""
        return (allocate_lanes(model, _pulling_step(cls.step_of(model, features)), OCTETS, room),)

    @classmethod
    def source_of(cls, model: Model) -> str:
        """Return the source of the kernels that a model gets."""
        step = cls.step_of(model, model_features(model))
        return source_of(step, {PULL: pulling_source(_pulling_step(step))})

    def own(self) -> Mapping[str, Own]:
        """Return the phases that the schedule executes itself, by name."""
        return {**super().own(), PULL: self._pull}

    def begin_loading(self) -> None:
        """Compile the kernels of a substep ahead."""
        begin_loading(self._kernel, self.model.device)
        self.launches.begin_loading()

    def _pull(self, state: State, substep: int, now: Moving) -> None:
        """Find the forces on all particles."""
        places = {f"from_{view}": array for view, array in zip(STATE.values(), now, strict=True)}
        found = {f"to_{value}": self.launches.values[value] for value in self._pulling.pieces[-1].leaves}
        has = {
            **self._has, **places, **found, **kept_arguments(state), "clock": self.launches.clock, "substep": substep,
            "state": self._states.of(state), "working": self.launches.working,
        }  # fmt: skip
        inputs = [has[name] for name in pulling_arguments(self._pulling)]
        launch(self._kernel, self.model.world_count, inputs, device=self.model.device)


def _pulling_step(step: Step) -> Step:
    """Return the phases of an octet, in pieces, that compute the outputs of a step's `pull`."""
    (leaves,) = (piece.leaves for piece in step.pieces if piece.phases[0].name == PULL)
    features = step.features
    phases = [phase for phase in SHARED_PULL if phase.is_active(features)]
    return cut(phases, features, ACCESS[OCTETS], sums_along=True, apart=(PULL,), shown=leaves)

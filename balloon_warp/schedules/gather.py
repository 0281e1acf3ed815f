"""The `gather` schedule: a thread a particle, which sums the forces of its own springs. Bit-reproducible.

For one large balloon: two buffers of points, one kernel a substep, one more for the spheres where there are any and
another where they exchange momentum, and three or four with gas. On a GPU one launch for all substeps of a frame, where
particles need of each other no more than where they are, see `patches`.
"""

from typing import Any

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.schedules.writer import Step, cut
from balloon_warp.kernels.substep import phases_of
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.contact_lists import has_many
from balloon_warp.schedules.launched import LaunchedSchedule
from balloon_warp.schedules.patches import PatchLaunch, cut_into_patches, first_phases


class GatherSchedule(LaunchedSchedule):
    """Advances a state by whole frames, in place."""

    name = "gather"
    watchable = False
    fast_math = True
    look = GATHERED

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
        apart = ("leave",) if features.stands_on_fixtures and has_many(model) else ()
        if cut_into_patches(model, features):
            return cut(first_phases(features), features, cls.look, shown=("inflation_direction",))
        return cut(phases_of(features), features, cls.look, apart=apart)

    @classmethod
    def allot(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
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

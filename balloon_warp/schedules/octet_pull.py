"""Launches of `gather` for a CPU, in which the forces of eight particles are found side by side.

For busy worlds, and for models of which no world is ever free.
"""

from collections.abc import Mapping
from typing import Any

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.contact import Solids
from balloon_warp.kernels.phase import STATE
from balloon_warp.kernels.schedules.lanes import LOOKS, pulling_arguments, pulling_kernel, pulling_source
from balloon_warp.kernels.schedules.lanes_layouts import OCTETS
from balloon_warp.kernels.schedules.launched import source_of
from balloon_warp.kernels.schedules.writer import Step, cut
from balloon_warp.kernels.substep import PULLED, SHARED_PULL, phases_of
from balloon_warp.launching import begin_loading, launch
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.lane_tables import allot_lanes, make_lane_tables
from balloon_warp.schedules.launched import Moving, Own
from balloon_warp.schedules.tables import Worlds, kept_arguments

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
        return cut(phases, features, cls.look, apart=(PULL, after))

    @classmethod
    def allot(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Allocate the memory of octets."""
        return (allot_lanes(model, _pulling_step(cls.step_of(model, features)), OCTETS, room),)

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
    phases = [phase for phase in SHARED_PULL if phase.acts(features)]
    return cut(phases, features, LOOKS[OCTETS], sums_along=True, apart=(PULL,), shown=leaves)

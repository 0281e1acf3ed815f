"""The way back through all frames: from derivatives by frames to those by parameters and by the start.

Places and velocities with which a frame begins are those of the trajectories, which stay on the host. So a device keeps
little of each frame, and there may be many.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.gradients.bars import by_keyframes, by_start, taken_numbers
from balloon_warp.gradients.by_launches import ByLaunches
from balloon_warp.gradients.loss import Told
from balloon_warp.gradients.refusals import require_room_for_bounces
from balloon_warp.gradients.spans import KeptParameters
from balloon_warp.model import Model, ModelPlan, State
from balloon_warp.schedules.backward import BackwardFrames
from balloon_warp.warp_lock import lock_of

Values = NDArray[np.float64]
ON_HOST = ("points", "velocities")
"""Parts of a frame's beginning that the trajectories have"""


class WayBack:
    """Note what frames begin with, and run them backwards.

    Args:
        tracks: what is recorded of all frames, see `trajectories.empty_tracks`.
        beside: what launches find besides.
    """

    def __init__(
        self, plan: ModelPlan, model: Model, backward: BackwardFrames, tracks: Mapping[str, NDArray], beside: ByLaunches
    ):
        self._plan, self._model, self._backward, self._tracks = plan, model, backward, tracks
        self._beside = beside
        self._begins: list[dict[str, Any]] = []
        self._parameters = KeptParameters(plan, model)
        kinds = {balloon.inflation.kind for balloon in plan.scene.balloon}
        self._given = "gas" not in kinds

    def note_beginning(self, state: State) -> None:
        """Keep what a frame begins with, as far as the trajectories do not have it."""
        with lock_of(self._model.device):
            self._begins.append(self._backward.checkpoint(state, but=ON_HOST))

    def note_parameters(self, frame: int) -> None:
        """Keep parameters that change, once a frame has been simulated."""
        self._parameters.note(frame)

    def back(self, told: Told, on_frame: Callable[[int], None]) -> list[dict[str, Values]]:
        """Return derivatives by all parameters of the model in each span, and by the start in the first, worlds first.

        A span is that between two changes of the scene.
        """
        keyed = np.zeros((self._model.world_count, *self._model.keyframe_times.shape))
        bars: list[dict[str, Values]] = []
        span = self._parameters.span_of(len(self._begins) - 1)
        for number in range(len(self._begins), 0, -1):
            while self._parameters.span_of(number - 1) < span:
                bars.append({**self._numbers(), "keyframe_values": keyed.copy()})
                keyed[...], span = 0.0, span - 1
                with lock_of(self._model.device):
                    self._parameters.bring_back(span)
            keyed += by_keyframes(self._model, number - 1, self._frame_back(told, number))
            on_frame(number)
        bars.append({**self._numbers(), "keyframe_values": keyed})
        bars += [{}] * span  # changes at the very start
        return [bars[-1] | self._by_start(told), *bars[-2::-1]]

    def _numbers(self) -> dict[str, Values]:
        return taken_numbers(self._model, self._backward, self._beside)

    def _frame_back(self, told: Told, number: int) -> Values:
        """Turn derivatives by a frame into those by the one before, and return those by keyed values."""
        model, pressures = self._model, told.pressures[:, number]
        begin = {name: self._tracks[name][:, number - 1] for name in ON_HOST}
        with lock_of(model.device):
            self._add(told, number, 0.0 * pressures if self._given else pressures)
            self._backward.turn_back(self._begins.pop() | begin)
            self._beside.note(number - 1)
            sums = np.asarray(self._backward.bars.keyed_totals.numpy(), dtype=np.float64).copy()
        if self._given:  # as a frame ends, the pressure of its last substep is noted
            sums[..., 0] += pressures
            sums[..., 1] += pressures * (model.substeps - 1) * model.step_seconds
        return sums

    def _add(self, told: Told, number: int, pressures: Values) -> None:
        """Add what the loss says of a frame itself."""
        self._backward.add(told.points[:, number], told.velocities[:, number], pressures)
        if self._backward.spheres:
            self._backward.spheres.add(told.sphere_positions[:, number], told.sphere_velocities[:, number])

    def _by_start(self, told: Told) -> dict[str, Values]:
        """Return derivatives by all that counts at the start alone."""
        backward = self._backward
        self._add(told, 0, told.pressures[:, 0])
        of_spheres = {}
        if backward.spheres:
            require_room_for_bounces(backward.spheres.crowded_worlds())
            of_spheres = backward.spheres.by_start()
        at_start = backward.by_state()
        gas = np.asarray(backward.bars.gas_totals.numpy(), dtype=np.float64)
        return {
            **of_spheres,
            **by_start(self._plan, self._model, at_start["points"], at_start["velocities"]),
            "initial_gas_amounts": gas[..., 0], "initial_free_volumes": gas[..., 1],
            "particle_points": at_start["points"], "particle_velocities": at_start["velocities"],
            "initial_pressures": at_start["pressures"], "initial_loads": at_start["loads"],
        }  # fmt: skip

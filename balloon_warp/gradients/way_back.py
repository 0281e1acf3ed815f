"""The way back through all frames: from derivatives by frames to those by parameters and by the start."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from balloon_warp.gradients.bars import by_keyframes, by_start, taken_numbers
from balloon_warp.gradients.by_launches import ByLaunches
from balloon_warp.gradients.checkpoints import Beginnings
from balloon_warp.gradients.loss import Told
from balloon_warp.gradients.refusals import require_room_for_bounces
from balloon_warp.gradients.spans import KeptParameters
from balloon_warp.model import Model, ModelPlan
from balloon_warp.schedules.backward import BackwardFrames
from balloon_warp.warp_lock import lock_of

Values = NDArray[np.float64]


class WayBack:
    """Run frames backwards.

    Args:
        parameters: in each span.
        beginnings: start states of frames.
        every: interval of the frames that the loss has seen.
        beside: derivatives that only launches find.
    """

    def __init__(
        self, plan: ModelPlan, model: Model, backward: BackwardFrames, parameters: KeptParameters,
        beginnings: Beginnings, every: int, beside: ByLaunches,
    ):  # fmt: skip
        self._plan, self._model, self._backward = plan, model, backward
        self._parameters, self._beginnings, self._every, self._beside = parameters, beginnings, every, beside
        kinds = {balloon.inflation.kind for balloon in plan.scene.balloon}
        self._given = "gas" not in kinds

    def back(self, told: Told, on_frame: Callable[[int], None]) -> list[dict[str, Values]]:
        """Return derivatives by all parameters of the model in each span, and by the start in the first, worlds first.

        A span is that between two changes of the scene.
        """
        keyed = np.zeros((self._model.world_count, *self._model.keyframe_times.shape))
        bars: list[dict[str, Values]] = []
        frames = self._plan.scene.frames
        span = self._parameters.span_of(frames - 1)
        for number in range(frames, 0, -1):
            while self._parameters.span_of(number - 1) < span:
                bars.append({**self._numbers(), "keyframe_values": keyed.copy()})
                keyed[...], span = 0.0, span - 1
            keyed += by_keyframes(self._model, number - 1, self._frame_back(told, number))
            on_frame(number)
        bars.append({**self._numbers(), "keyframe_values": keyed})
        bars += [{}] * span  # changes at the very start
        return [bars[-1] | self._by_start(told), *bars[-2::-1]]

    def _numbers(self) -> dict[str, Values]:
        return taken_numbers(self._model, self._backward, self._beside)

    def _frame_back(self, told: Told, number: int) -> Values:
        """Turn derivatives by a frame into those by the one before, and return those by keyed values."""
        model, (place, between) = self._model, divmod(number, self._every)
        pressures = 0.0 * told.pressures[:, 0] if between else told.pressures[:, place]
        begin = self._beginnings.take(number - 1)
        with lock_of(model.device):
            self._parameters.bring_back(self._parameters.span_of(number - 1))
            if not between:
                self._add(told, place, 0.0 * pressures if self._given else pressures)
            self._backward.turn_back(begin)
            self._beside.note(number - 1)
            sums = np.asarray(self._backward.bars.keyed_totals.numpy(), dtype=np.float64).copy()
        if self._given:  # as a frame ends, the pressure of its last substep is noted
            sums[..., 0] += pressures
            sums[..., 1] += pressures * (model.substeps - 1) * model.step_seconds
        return sums

    def _add(self, told: Told, place: int, pressures: Values) -> None:
        """Add the derivatives of the loss by a frame itself, by its place among those that it has seen."""
        self._backward.add(told.points[:, place], told.velocities[:, place], pressures)
        if self._backward.spheres:
            self._backward.spheres.add(told.sphere_positions[:, place], told.sphere_velocities[:, place])

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

"""A frame of a schedule, recorded once and replayed without the cost of its launches."""

from typing import Any

import warp as wp

from balloon_warp.model import Model, State
from balloon_warp.schedules.late_spheres import LateSpheres
from balloon_warp.warp_lock import recording


class RecordedFrame:
    """A frame of one schedule and one state of a model, and what the host does to spheres at its end."""

    def __init__(self, model: Model):
        self._device, self._late_spheres = model.device, LateSpheres(model)
        self._graph: Any = None

    def advance(self, schedule: Any, state: State) -> None:
        """Advance the state by a frame: record it, if the schedule can be and it is the first, and launch it."""
        if not schedule.capturable:
            self._launch(schedule, state)
            return
        if self._graph is None:
            with recording(self._device) as capture:
                self._launch(schedule, state)
            self._graph = capture.graph
        wp.capture_launch(self._graph)

    def _launch(self, schedule: Any, state: State) -> None:
        schedule.advance_frame(state)
        self._late_spheres.hold(state)

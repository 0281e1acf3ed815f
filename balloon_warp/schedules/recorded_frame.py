"""A frame of a schedule, recorded once and replayed without the cost of its launches."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.model import Model, State
from balloon_warp.schedules.late_spheres import LateSpheres
from balloon_warp.warp_lock import recording

RARE = 16
"""Number of times that a piece which is not always wanted is launched, before it is worth recording"""


class FramePiece(NamedTuple):
    """Piece of a frame that is recorded by itself; what is never wanted is not even compiled."""

    launch: Callable[[State], None]
    is_wanted: Callable[[], bool] | None = None
    """Whether it is wanted in this frame, which is known once earlier pieces are done; None for always"""


class RecordedFrame:
    """A frame of one schedule and one state of a model, and what the host does to spheres at its end."""

    def __init__(self, model: Model):
        self._device, self._late_spheres = model.device, LateSpheres(model)
        self._graphs: dict[int, Any] = {}
        self._launched: Counter[int] = Counter()

    def advance(self, schedule: Any, state: State) -> None:
        """Advance the state by a frame: record it, if the schedule can be and it is the first, and launch it."""
        if not schedule.capturable:
            schedule.advance_frame(state)
            self._late_spheres.hold(state)
            return
        for number, piece in enumerate(self._pieces(schedule)):
            if piece.is_wanted is None:
                self._replay(number, piece, state)
            elif piece.is_wanted():
                self._launched[number] += 1
                if self._launched[number] <= RARE:
                    piece.launch(state)
                else:
                    self._replay(number, piece, state)

    def _replay(self, number: int, piece: FramePiece, state: State) -> None:
        if number not in self._graphs:
            with recording(self._device) as capture:
                piece.launch(state)
            self._graphs[number] = capture.graph
        wp.capture_launch(self._graphs[number])

    def _pieces(self, schedule: Any) -> Sequence[FramePiece]:
        own = getattr(schedule, "pieces", None) or [FramePiece(schedule.advance_frame)]

        def last(state: State) -> None:
            own[-1].launch(state)
            self._late_spheres.hold(state)

        return [*own[:-1], FramePiece(last)]

"""A frame of a schedule, recorded once and replayed without the cost of its launches."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from balloon_warp.model import Model, State
from balloon_warp.schedules.contact_lists import ContactLists
from balloon_warp.schedules.late_spheres import LateSpheres
from balloon_warp.warp_lock import recording, replay

RARE = 16
"""Number of times that a GPU launches a piece which is not always wanted, before it is worth recording"""
FEW = 2
"""Number of times that a CPU launches a piece before it records it, which takes as long as to launch it two and a half
times"""


def _nothing() -> None:
    """Launch nothing."""


class FramePiece(NamedTuple):
    """Piece of a frame that is recorded by itself; a piece that is never wanted is not even compiled."""

    launch: Callable[[State], None]
    is_wanted: Callable[[], bool] | None = None
    """Whether it is wanted in this frame, which is known once earlier pieces are done; None for always"""
    is_short: bool = False
    """Whether far fewer substeps are recorded than it replays, so that it is worth recording at once, see `rounds`"""


class RecordedFrame:
    """A frame of one schedule and one state of a model, and the host's changes of spheres at its end.

    Args:
        before: launches the kernels before the frame, which are recorded with it.
        after: launch the kernels after it.
    """

    def __init__(self, model: Model, before: Callable[[], None] = _nothing, *after: Callable[[], None]):
        self._device, self._late_spheres = model.device, LateSpheres(model)
        self._before, self._after = before, after
        self._graphs: dict[int, Any] = {}
        self._launched: Counter[int] = Counter()

    def advance(self, schedule: Any, state: State) -> None:
        """Advance the state by a frame: record it, if the schedule can be and that is worth it, and launch it."""
        lists: ContactLists | None = schedule.contact_lists
        pieces = self._pieces(schedule)
        ending = len(pieces) - 1 if lists else len(pieces)
        self._go_through(pieces, range(ending), state, schedule.capturable)
        while lists and lists.grow(state):
            lists.put_back(state)
            self._graphs.clear()  # they have the shorter lists
            self._launched.clear()
            self._go_through(pieces, range(ending), state, schedule.capturable)
        self._go_through(pieces, range(ending, len(pieces)), state, schedule.capturable)

    def _go_through(self, pieces: Sequence[FramePiece], numbers: Iterable[int], state: State, recorded: bool) -> None:
        """Launch pieces of a frame, by their numbers."""
        for number in numbers:
            piece = pieces[number]
            if piece.is_wanted is not None and not piece.is_wanted():
                continue
            self._launched[number] += 1
            if not recorded or self._launched[number] <= self._unrecorded(piece):
                piece.launch(state)
            else:
                self._replay(number, piece, state)

    def _unrecorded(self, piece: FramePiece) -> int:
        """Return how often a piece is launched before it is recorded."""
        if piece.is_short:
            return 0
        if self._device.is_cpu:
            return FEW
        return 0 if piece.is_wanted is None else RARE

    def _replay(self, number: int, piece: FramePiece, state: State) -> None:
        if number not in self._graphs:
            with recording(self._device) as capture:
                piece.launch(state)
            self._graphs[number] = capture.graph
        replay(self._graphs[number])

    def _pieces(self, schedule: Any) -> Sequence[FramePiece]:
        """Return the pieces of a frame; where lists of contacts may have to grow, the last comes after it."""
        has_pieces = schedule.capturable and getattr(schedule, "pieces", None)
        own = list(has_pieces or [FramePiece(schedule.advance_frame)])
        lists: ContactLists | None = schedule.contact_lists
        begin, end = own[0].launch, own[-1].launch

        def first(state: State) -> None:
            if lists:
                lists.begin(state)
            self._before()
            begin(state)

        def last(state: State) -> None:
            (first if len(own) == 1 else end)(state)
            self._end(state)

        if lists:
            return [own[0]._replace(launch=first), *own[1:], FramePiece(self._end)]
        if len(own) == 1:
            return [own[0]._replace(launch=last)]
        return [own[0]._replace(launch=first), *own[1:-1], own[-1]._replace(launch=last)]

    def _end(self, state: State) -> None:
        self._late_spheres.hold(state)
        for launches in self._after:
            launches()

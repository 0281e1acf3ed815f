"""Rounds of substeps: a frame of launches in which a few substeps are recorded, and replayed as often as needed.

A recorded launch takes time and memory, so that a graph of every substep would grow with their number. A graph has the
first substeps instead, a round whose turns a device counts, and what is left over.
"""

from collections.abc import Callable
from typing import Any

import warp as wp

from balloon_warp.kernels.clock import Clock
from balloon_warp.kernels.frames.rounds import begin_round, end_turn
from balloon_warp.launching import launch
from balloon_warp.model import Model

TURN = 16
"""Number of substeps of a turn: few to record, and enough that counting turns takes little of a GPU's time"""
FLAT = 4 * TURN
"""Largest number of substeps of a frame without rounds, which would have to record as many"""
OUTER, INNER = 0, 1
"""Depths of rounds: those of searches for contacts, and those between two searches"""
Substeps = Callable[[range], None]
"""Function that launches substeps of these numbers, and leaves particles in the state"""


class Rounds:
    """Go through the substeps of a model's frames.

    Args:
        interval: number of substeps from one search for contacts to the next; 0 where nothing is searched for.
    """

    def __init__(self, model: Model, interval: int, clock: Any):
        self._device, self._clock = model.device, clock
        self._count, self._interval = model.substeps, interval or model.substeps
        can_repeat = model.device.is_cpu or wp.is_conditional_graph_supported()
        self.are_short = can_repeat and model.substeps > FLAT
        """Whether far fewer substeps are recorded than a frame has; a GPU with an old driver records all"""
        self._turns = [clock.left[depth : depth + 1] for depth in (OUTER, INNER)]

    def go_through(self, launch_substeps: Substeps) -> None:
        """Launch all substeps of a frame.

        Numbers are those of the first turn of a round, and a search is due at the same of them in every turn; the
        clock knows which substep it really is.
        """
        if not self.are_short:
            launch_substeps(range(self._count))
            return
        interval = self._interval
        if interval <= TURN:
            self._stretch(launch_substeps, 0, self._count, interval * (TURN // interval))
        else:
            turns, rest = divmod(self._count, interval)
            self._stretch(launch_substeps, 0, min(interval, self._count), TURN)
            self._clock.done.zero_()
            self._repeat(OUTER, turns - 1, interval, lambda: self._stretch(launch_substeps, interval, interval, TURN))
            if rest and turns:
                self._stretch(launch_substeps, interval, rest, TURN)
        self._clock.done.zero_()

    def _stretch(self, launch_substeps: Substeps, first: int, count: int, turn: int) -> int:
        """Launch so many substeps, where a search is due at the first of every turn, or at the first of all alone.

        Return by how many substeps the clock is further on.
        """
        turns, rest = divmod(count, turn)
        if not turns:
            launch_substeps(range(first, first + rest))
            return 0
        launch_substeps(range(first, first + turn))
        second = range(first + turn, first + 2 * turn)

        def again() -> int:
            launch_substeps(second)
            return 0

        self._repeat(INNER, turns - 1, turn, again)
        if rest:
            launch_substeps(second[:rest])
        return turn * (turns - 1)

    def _repeat(self, depth: int, turns: int, substeps: int, launch_turn: Callable[[], int]) -> None:
        """Launch a turn of so many substeps again and again, by which the clock goes on."""
        if turns < 1:
            return

        def turn() -> None:
            done = launch_turn()
            launch(end_turn, 1, [self._clock, depth, substeps - done], device=self._device)

        launch(begin_round, 1, [self._clock, depth, turns], device=self._device)
        wp.capture_while(self._turns[depth], turn)


def make_clock(model: Model) -> Any:
    """Return the clock of a model's launches, at the start of a frame."""
    clock = Clock()
    clock.done = wp.zeros(1, dtype=wp.int32, device=model.device)
    clock.left = wp.zeros(2, dtype=wp.int32, device=model.device)
    clock.substep_seconds = model.step_seconds
    return clock

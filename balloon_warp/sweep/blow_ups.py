"""Worlds of a batch that blow up: a report of the first few, an end to all, or a new start in shorter steps.

Detection and explanation of blow-ups are in `balloon_warp/blow_ups/`; this is the reaction of a batch.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.blow_ups import MOST_HALVINGS, BlowUp
from balloon_warp.errors import BlowUpError
from balloon_warp.model import lay_out
from balloon_warp.simulator import Simulator
from balloon_warp.sweep.groups import Group
from balloon_warp.sweep.recorder import Record, Recorder

MOST_REPORTED = 3
"""Number of worlds of a batch that are replayed to explain their blow-ups"""
RESTARTED = 2
"""Health of a world that blew up and, restarted with shorter steps, did not"""

Rows = NDArray[np.integer]
Replace = Callable[[Rows, Rows, Record], None]
"""Function that replaces the record of some worlds: their rows in the group, the places of those whose shape is
exported among all exported worlds of the group, and one of their frames"""


@dataclass
class Failures:
    """Outcomes of worlds that blew up."""

    reports: list[BlowUp] = field(default_factory=list)
    """Reports of the first few, in their order"""
    restarted: dict[int, int] = field(default_factory=dict)
    """Worlds that are good with shorter steps, and their initial number of substeps a frame"""

    def add(self, others: "Failures") -> None:
        """Add the failures of another part of the batch."""
        self.reports = sorted([*self.reports, *others.reports], key=lambda report: report.world)[:MOST_REPORTED]
        self.restarted = dict(sorted({**self.restarted, **others.restarted}.items()))


def require_health(simulator: Simulator, group: Group, record: Record) -> None:
    """Make sure that all worlds of a group are good.

    Raises:
        BlowUpError: one is not.
    """
    bad = np.flatnonzero(record.healthy == 0)
    if len(bad):
        raise BlowUpError(_report(simulator, group, int(bad[0]), record.number))


def report_failures(simulator: Simulator, group: Group, health: NDArray[np.integer]) -> list[BlowUp]:
    """Explain the blow-ups of the first few bad worlds of a group.

    Args:
        simulator: Simulator of the group.
        health: Health as in `Record`, of all frames, shape (frame_count, world_count).
    """
    bad = np.flatnonzero(health[-1] == 0)[:MOST_REPORTED]
    frames = np.argmax(health[:, bad] == 0, axis=0)
    return [_report(simulator, group, row, frame) for row, frame in zip(bad.tolist(), frames.tolist(), strict=True)]


def _report(simulator: Simulator, group: Group, row: int, frame: int) -> BlowUp:
    return replace(simulator.diagnose(row, frame), world=int(group.worlds[row]))


def restart_failures(
    group: Group, rows: Rows, chosen: Rows, device: wp.Device, schedule: str, put: Replace, every: int = 0
) -> dict[int, int]:
    """Simulate worlds anew with half the step, those that blow up again with half of that, and so on.

    A world that stays bad then has the rows of the last attempt, which stay at its last good frame.

    Args:
        group: of the worlds.
        rows: of the worlds that blew up, by their numbers in the group.
        chosen: the worlds whose shape is wanted, by their numbers in the batch.
        schedule: that simulated the group.
        put: is given every frame of every attempt.
        every: as of a `Recorder`.

    Returns:
        The worlds that are good now, and their substeps.
    """
    places_of_rows = {row: place for place, row in enumerate(group.rows_of(chosen).tolist())}
    good = {}
    for halving in range(1, MOST_HALVINGS + 1):
        if not len(rows):
            break
        part = group.part(rows)
        plan = part.plan.with_times_the_substeps(2**halving)
        simulator = Simulator.of_model(lay_out(plan, device), schedule)
        shown = part.rows_of(chosen)
        places = np.array([places_of_rows[row] for row in rows[shown].tolist()], dtype=np.int64)
        recorder = Recorder(simulator, shown, every)
        healthy = np.ones(len(rows), dtype=np.int32)
        for record in recorder.run():
            put(rows, places, replace(record, healthy=RESTARTED * record.healthy))
            healthy = record.healthy
        good |= dict.fromkeys(part.worlds[healthy != 0].tolist(), plan.substeps)
        rows = rows[healthy == 0]
    return good

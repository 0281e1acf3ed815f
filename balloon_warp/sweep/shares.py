"""A batch cut into shares: worlds that one worker simulates together, wherever it is."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil, log2
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.device import pick_device
from balloon_warp.kernels.lanes import LANE_COUNT
from balloon_warp.model import ModelPlan, Remark, lay_out, remarks_on
from balloon_warp.simulator import Simulator
from balloon_warp.solvers.choose import settled_solver
from balloon_warp.sweep.blow_ups import Failures, Rows, report_failures, require_health, restart_failures
from balloon_warp.sweep.groups import Group
from balloon_warp.sweep.memory import require_batch_memory
from balloon_warp.sweep.recorder import SHAPES, Record, Recorder

SHARES = 64
"""Approximate number of shares of a large batch: enough to keep many workers busy to the end"""


class Grain(NamedTuple):
    """Least size of a share: enough to fill a device and to be worth its overhead."""

    worlds: int
    particles: int
    particle_substeps: int = 0
    """Number of particle-substeps in all its frames, unless that takes more than `MOST_PARTICLES`"""

    def particles_of(self, plan: ModelPlan) -> float:
        """Find how many particles a share has at least, of worlds of a plan."""
        worth = self.particle_substeps / (plan.substeps * plan.scene.frames)
        return max(self.particles, min(worth, MOST_PARTICLES))


MOST_PARTICLES = 2**23
"""Largest number of particles of a share that more than fills a device: as many fit into the memory of any"""
GRAIN = {"cpu": Grain(LANE_COUNT, 2**11), "cuda": Grain(1, 2**18, 2**35)}
"""Least sizes by the kind of device; on a CPU `lanes` takes as long for one world as for eight; a GPU does that work in
a third of a second or, where it is much, in three, and a share has an overhead of a tenth or more"""


@dataclass(frozen=True)
class ShareResult:
    """Result of a share from a worker."""

    records: list[Record]
    """Records of all frames, including the start"""
    schedule: str
    failures: Failures
    remarks: list[Remark]
    overflow: int
    """Number of contacts that were ignored, as schedules count them"""


def cut_into_shares(groups: Sequence[Group], device_kind: str) -> list[Group]:
    """Cut groups into groups of fewer worlds.

    The cut depends on the batch and the kind of device, "cpu" or "cuda", and never on the number of workers. It has the
    planned step of the whole, and the geometry, so that a worker needs neither the other worlds nor any file.
    """
    world_count = sum(len(group.worlds) for group in groups)
    least = GRAIN[device_kind]
    shares = []
    for group in groups:
        enough = max(least.worlds, least.particles_of(group.plan) / group.plan.particle_count)
        size = 2 ** ceil(log2(max(world_count / SHARES, enough)))
        begin = 0
        for worlds in np.array_split(group.worlds, ceil(len(group.worlds) / size)):
            shares.append(group.part(np.arange(begin, begin + len(worlds))))
            begin += len(worlds)
    return shares


def simulate_share(
    share: Group,
    chosen: NDArray[np.integer],
    device: str | None,
    schedule: str,
    world_count: int,
    on_blowup: str,
    on_frame: Callable[[int], None],
    every: int = 0,
) -> ShareResult:
    """Simulate a share from its start to its end.

    Args:
        chosen: the worlds whose shape is wanted, by their numbers in the batch.
        device: Warp device; the GPU, or else the CPU, if not given.
        schedule: Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        world_count: how many worlds the whole batch has.
        on_blowup: as in `run_batch`.
        on_frame: Called with the number of each simulated frame.
        every: Interval of recorded frames, as in `Recorder`.

    Raises:
        InputError: there is no such device or schedule, or the share does not fit into its memory.
        BlowUpError: a world blew up, which is to stop all.
    """
    scene = share.plan.scene
    model = lay_out(share.plan, pick_device(device))
    settled = settled_solver(schedule, model, world_count)
    require_batch_memory([model], [settled], [share], chosen, scene, scene.frames + 1, every)
    simulator = Simulator.of_model(model, settled)
    recorder = Recorder(simulator, share.rows_of(chosen), every)
    records: list[Record] = []
    for record in recorder.run():
        records.append(record)
        if on_blowup == "stop":
            require_health(simulator, share, record)
        on_frame(record.number)
    health = np.stack([record.healthy for record in records])
    failures, overflow = Failures(report_failures(simulator, share, health)), simulator.schedule.overflow
    remarks = remarks_on(simulator.model, simulator.state, share.worlds)
    del simulator, recorder  # restarted worlds reuse their memory
    if on_blowup == "restart":
        bad, put = np.flatnonzero(health[-1] == 0), partial(_replace, records)
        failures.restarted = restart_failures(share, bad, chosen, model.device, settled, put, every)
    return ShareResult(records, settled, failures, remarks, overflow)


def _replace(records: list[Record], rows: Rows, places: Rows, part: Record) -> None:
    """See `restart_failures`."""
    record = records[part.number]
    for array, values in ((record.measures, part.measures), (record.healthy, part.healthy)):
        array[rows] = values
    if record.contacts is not None and part.contacts is not None:
        record.contacts[rows] = part.contacts
    for name, values in (part.tracks or {}).items():
        if record.tracks is not None:
            record.tracks[name][rows] = values
    for name in SHAPES:
        getattr(record, name)[places] = getattr(part, name)

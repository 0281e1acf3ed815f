"""Weak scaling: whether the rate grows with the GPUs, when each has the same number of worlds.

Each GPU has a process of its own. All lay out their worlds and warm up, wait for each other, and advance some frames;
measured is the time from the first one's start to the last one's end. Nothing but the simulation is in it.
"""

import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

import warp as wp

from balloon_warp.benchmarks.cases import Case
from balloon_warp.benchmarks.measure import prepared
from balloon_warp.benchmarks.result import Result
from balloon_warp.errors import InputError, WorkersLostError
from balloon_warp.farm.cluster import Cluster
from balloon_warp.farm.workers import worker_environments
from balloon_warp.model import build_model, initial_state
from balloon_warp.schedules import make_schedule
from balloon_warp.schedules.one_launch import LanesSchedule
from balloon_warp.system.warp_setup import quiet_warp

REPEATS = 5
PATIENCE = 600.0
"""seconds after which a process that does not come is given up"""

Answer = tuple[int, list[tuple[float, float]]]
"""of a process: the particles of a world, and when each repeat began and ended [s]"""


@dataclass(frozen=True)
class Share:
    """Share of each process, whatever the number of processes."""

    device: str
    """"cuda:0", of the GPUs that the process sees, or "cpu", of which it takes a thread"""
    case: Case
    frames: int
    """of a repeat, which should take about a second: processes do not begin at quite the same time"""


GPU_SHARE = Share("cuda:0", Case("8,192 balloons on a GPU", "block", 8192), frames=600)
GPU_SHARES = (GPU_SHARE, Share("cuda:0", Case("8,192 with sealed gas on a GPU", "block", 8192, gas=True), frames=300))
CPU_SHARE = Share("cpu", Case("64 balloons in a process", "lanes", 64), frames=50)


def measure_scaling(share: Share, counts: Sequence[int]) -> Iterator[Result]:
    """Return rates of so many processes together, beside as many that are each as fast as those of the first count.

    The ratio of both is the efficiency.

    Raises:
        InputError: a count is below 1, or there are fewer GPUs.
        WorkersLostError: a process failed.
    """
    environments = _environments(share, counts)
    alone = 0.0
    for count in counts:
        rate, particles = _rate_together(share, environments[:count])
        alone = alone or rate / count
        yield Result(
            case=f"{share.case.name} x {count}",
            device=share.device.partition(":")[0],
            schedule=share.case.schedule,
            worlds=count * share.case.worlds,
            particles=particles,
            rate=rate,
            peer="linear",
            peer_rate=count * alone,
            ratio=rate / (count * alone),
        )


def _environments(share: Share, counts: Sequence[int]) -> list[dict[str, str]]:
    """Return the environment of each process, with the GPU that it sees."""
    on_cpu = share.device == "cpu"
    option = "--workers" if on_cpu else "--gpus"
    if not counts or min(counts) < 1:
        raise InputError(f"{option}: expected numbers of at least 1, such as 1,2,4")
    return worker_environments(Cluster(workers=max(counts)) if on_cpu else Cluster(gpus=max(counts)))


def _rate_together(share: Share, environments: Sequence[dict[str, str]]) -> tuple[float, int]:
    """Particle-substeps a second of all processes, the median over the repeats; and the particles of a world."""
    context = multiprocessing.get_context("spawn")
    barrier, answers = context.Barrier(len(environments)), context.SimpleQueue()
    processes = [
        context.Process(target=_simulate, args=(share, environment, barrier, answers), daemon=True)
        for environment in environments
    ]
    try:
        for process in processes:
            process.start()
        for process in processes:
            process.join(PATIENCE)
        if any(process.exitcode != 0 for process in processes):
            raise WorkersLostError("a process of the benchmark failed; what it said stands above")
    finally:
        for process in processes:
            process.kill()
    told = [answers.get() for _ in processes]
    particles = told[0][0]
    work = len(processes) * share.case.worlds * particles * share.case.substeps * share.frames
    return work / median(spans_together(told)), particles


def spans_together(told: Sequence[Answer]) -> list[float]:
    """Seconds of each repeat, from the first start to the last end."""
    repeats = zip(*(spans for _, spans in told), strict=True)
    return [max(end for _, end in spans) - min(begin for begin, _ in spans) for spans in repeats]


def _simulate(share: Share, environment: dict[str, str], barrier: Any, answers: Any) -> None:
    """Simulate in a process of its own, and answer by the clock that all processes share."""
    os.environ.update(environment)
    try:
        quiet_warp()
        model = build_model(share.case.scene(), share.device, share.case.worlds)
        schedule = (
            LanesSchedule(model, thread_count=1) if model.device.is_cpu else make_schedule(model, share.case.schedule)
        )
        advance = prepared(schedule, initial_state(model))
        spans = []
        for _ in range(REPEATS):
            wp.synchronize_device(model.device)
            barrier.wait(PATIENCE)
            began = time.monotonic()
            for _ in range(share.frames):
                advance()
            wp.synchronize_device(model.device)
            spans.append((began, time.monotonic()))
        answers.put((model.particle_count, spans))
    except BaseException:
        barrier.abort()  # the others need not wait
        raise

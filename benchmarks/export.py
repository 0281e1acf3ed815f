"""Speed of writing stages."""

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np
import warp as wp

from balloon_warp.batch.recorder import Recorder
from balloon_warp.benchmarks.cases import ExportCase
from balloon_warp.benchmarks.result import Result
from balloon_warp.model import ModelPlan, lay_out, plan_model
from balloon_warp.simulator import Simulator
from balloon_warp.usd import StageWriter
from balloon_warp.usd.grid import GridGroup, GridWriter

REPEATS = 3


def measure_export(case: ExportCase, device: wp.Device) -> Result:
    """Measure writing one world as `run` does, or several as `batch` does, from frames that are in memory.

    The worlds differ: USD would store alike ones once.
    """
    plan = plan_model(case.scene(), case.worlds, {"balloon.inflation.k_normal": np.linspace(0.3, 0.6, case.worlds)})
    simulator = Simulator.of_model(lay_out(plan, device))
    write = _world_writer(simulator) if case.worlds == 1 else _batch_writer(simulator, plan)
    return Result(
        case=case.name,
        device=str(device),
        schedule=simulator.schedule.name,
        worlds=case.worlds,
        particles=plan.particle_count,
        rate=median(_megabytes_a_second(write) for _ in range(REPEATS)),
    )


def _megabytes_a_second(write: Callable[[Path], None]) -> float:
    with tempfile.TemporaryDirectory(prefix="balloon-warp-") as folder:
        stage = Path(folder) / "stage.usdc"
        began = time.perf_counter()
        write(stage)
        return 1e-6 * stage.stat().st_size / (time.perf_counter() - began)


def _world_writer(simulator: Simulator) -> Callable[[Path], None]:
    frames = list(simulator.run())

    def write(path: Path) -> None:
        with StageWriter(path, simulator.model) as stage:
            for frame in frames:
                stage.write(replace(frame))  # which has not measured itself yet, as in a run

    return write


def _batch_writer(simulator: Simulator, plan: ModelPlan) -> Callable[[Path], None]:
    worlds = np.arange(plan.world_count)
    recorder = Recorder(simulator, worlds)
    records = [recorder.read()]
    for _ in range(plan.scene.frames):
        simulator.advance()
        records.append(recorder.read())

    def write(path: Path) -> None:
        with GridWriter(path, [GridGroup(plan, worlds, worlds)]) as stage:
            for record in records:
                stage.write(record.number, 0, record.shapes)

    return write

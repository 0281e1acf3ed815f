"""Run of a comparison: a scene as far as the frame that is shown."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Any, Literal

import numpy as np

from balloon_warp.beginning import Beginning
from balloon_warp.comparison.choices import shown
from balloon_warp.errors import BlowUpError, InputError, MissingExtraError
from balloon_warp.kernels.laws import Law
from balloon_warp.outputs.usd import StageWriter
from balloon_warp.scene import Scene
from balloon_warp.scene.overrides import override_scene
from balloon_warp.simulator import Simulator
from balloon_warp.sweep.recorder import MEASURES, Recorder, columns_of

MOST_STRETCH = 100.0
"""Largest stretch of a spring in a run that is shown: one that explodes but stays finite would leave the others no room
in the picture"""


@dataclass(frozen=True)
class Run:
    """Run with one set of values."""

    values: dict[str, Any]
    """Varied values by their dotted paths"""
    outcome: Literal["done", "refused", "blew up"]
    sentence: str
    """Reason for failure; empty if the run is done"""
    figures: dict[str, float]
    """Measures at the frame that is shown; empty where the run is not done"""
    frame_seconds: list[float] = field(default_factory=list)
    """Duration of each frame [s]"""

    @property
    def label(self) -> list[str]:
        """Lines that distinguish this run, one for each value."""
        return [f"{path} = {shown(value)}" for path, value in self.values.items()]


def simulate(
    scene: Scene,
    values: dict[str, Any],
    stage: Path | None = None,
    frame: int | None = None,
    device: str | None = None,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
    on_begin: Callable[[Beginning], None] = lambda beginning: None,
    on_frame: Callable[[int, int], None] = lambda done, count: None,
    clock: Callable[[], float] = time.perf_counter,
) -> Run:
    """Run the scene with these values as far as the frame that is shown.

    Args:
        stage: the stage to write that frame into, if any.
        frame: the frame that is shown, unless `picture_frame` is varied; when missing, the one that the scene names as
            its picture, else the last.
        laws: User-defined laws beside the built-in ones; see `balloon_warp.laws`.
        on_begin: called with a summary of the run, whose frames end at the one that is shown.
        on_frame: Called with the number of frames done, and of all.
        clock: function that returns the time [s], by which frames are timed.
    """
    try:
        scene = override_scene(scene, values.items(), other_kinds=True)
        frame = scene.picture_frame if "picture_frame" in values else frame  # a label shows the value, or its refusal
        figures, seconds = _measured(scene, stage, frame, device, schedule, laws, on_begin, on_frame, clock)
    except (InputError, MissingExtraError) as refusal:
        return Run(values, "refused", str(refusal), {})
    except BlowUpError as failure:
        return Run(values, "blew up", str(failure), {})
    return Run(values, "done", "", figures, seconds)


def _measured(
    scene: Scene,
    stage: Path | None,
    frame: int | None,
    device: str | None,
    schedule: str,
    laws: Sequence[Law],
    on_begin: Callable[[Beginning], None],
    on_frame: Callable[[int, int], None],
    clock: Callable[[], float],
) -> tuple[dict[str, float], list[float]]:
    """Measure the figures at the frame that is shown, and the wall time of each frame until then [s]."""
    last = shown_frame(scene, frame)
    simulator = Simulator(scene, device, schedule=schedule, laws=laws)
    on_begin(replace(Beginning.of(simulator.model, simulator.schedule.name), frames=last))
    recorder = Recorder(simulator, np.zeros(0, dtype=np.int32))
    seconds = []
    for number in range(1, last + 1):
        began = clock()
        simulator.step_unread()  # waits for the device, to see whether the world is healthy
        seconds.append(clock() - began)
        on_frame(number, last)
    record = recorder.read()
    measured = dict(zip(columns_of(scene), map(float, record.measures[0]), strict=True))
    figures = {name: measured[name] for name in MEASURES}
    if not record.healthy[0] or figures["largest_stretch"] > MOST_STRETCH:
        raise BlowUpError(
            f"the simulation blew up: by frame {last} a spring exceeds {MOST_STRETCH:g} times its rest length"
        )
    if stage:
        with StageWriter(stage, simulator.model) as writer:
            writer.write(simulator.read_frame())
    shapes = simulator.model.shapes
    if len(shapes) == 1 and shapes[0].closed:
        figures["roundness"] = 36.0 * np.pi * figures["volume"] ** 2 / figures["area"] ** 3
    figures = {
        "frame": last,
        **(figures | measured),
        "particles": simulator.model.particle_count,
        "substeps": simulator.model.substeps,
        **({"seconds_a_frame": median(seconds)} if seconds else {}),
    }
    return figures, seconds


def shown_frame(scene: Scene, frame: int | None) -> int:
    """Find the frame that is shown of a scene.

    Raises:
        InputError: the scene has no such frame.
    """
    if frame is None:
        return min(scene.frames if scene.picture_frame is None else scene.picture_frame, scene.frames)
    if not 0 <= frame <= scene.frames:
        raise InputError(f"frame: {frame} is not in the scene; expected 0 to {scene.frames}")
    return frame

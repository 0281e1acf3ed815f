"""The time of a frame, of one contender or of several side by side."""

import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

import warp as wp

from balloon_warp.model import Model, State

FRAMES = 10
REPEATS = 5


def seconds_a_frame(contenders: Sequence[tuple[Any, State]], model: Model) -> list[float]:
    """Of each contender the median over some repeats, after a warm-up; the contenders take turns, so that what else
    the machine does slows all of them.

    Args:
        contenders: a schedule, or what advances a state like one, and the state that it advances.
    """
    advances = [prepared(schedule, model, state) for schedule, state in contenders]
    times = [[_seconds(advance, model) for advance in advances] for _ in range(REPEATS + 1)]
    return [median(of_one[1:]) for of_one in zip(*times, strict=True)]


def prepared(schedule: Any, model: Model, state: State) -> Callable[[], None]:
    """What advances the state by a frame, warmed up; recorded and replayed where the schedule allows."""
    schedule.advance_frame(state)
    if not schedule.capturable:
        return lambda: schedule.advance_frame(state)
    with wp.ScopedDevice(model.device), wp.ScopedCapture(model.device) as capture:
        schedule.advance_frame(state)
    graph: Any = capture.graph
    return lambda: wp.capture_launch(graph)


def _seconds(advance: Callable[[], None], model: Model) -> float:
    wp.synchronize_device(model.device)
    began = time.perf_counter()
    for _ in range(FRAMES):
        advance()
    wp.synchronize_device(model.device)
    return (time.perf_counter() - began) / FRAMES

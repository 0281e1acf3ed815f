"""The time of a frame, of one contender or of several side by side."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from statistics import median
from typing import Any

import warp as wp

from balloon_warp.model import State, initial_state

FRAMES = 10
REPEATS = 5


def seconds_a_frame(
    contenders: Sequence[Any], frames: int = FRAMES, states: Sequence[State] | None = None
) -> list[float]:
    """Return the median time of a frame for each contender, over some repeats, after a warm-up.

    The contenders take turns, so that other work of the machine slows all of them.

    Args:
        contenders: schedules, or objects that have a model and advance its states like one.
        frames: that are timed together; each then has its part of some 30 us to launch the first and wait for the last.
        states: that they advance; the initial one of each when missing.
    """
    states = states or [initial_state(contender.model) for contender in contenders]
    advances = [prepared(*each) for each in zip(contenders, states, strict=True)]
    devices = [contender.model.device for contender in contenders]
    times = [[_seconds(*each, frames) for each in zip(advances, devices, strict=True)] for _ in range(REPEATS + 1)]
    return [median(of_one[1:]) for of_one in zip(*times, strict=True)]


def prepared(schedule: Any, state: State) -> Callable[[], None]:
    """Return a function that advances the state by a frame: warmed up, and recorded where the schedule allows."""
    schedule.advance_frame(state)
    if not schedule.capturable:
        return lambda: schedule.advance_frame(state)
    device = schedule.model.device
    with wp.ScopedDevice(device), wp.ScopedCapture(device) as capture:
        schedule.advance_frame(state)
    return partial(_replay, capture.graph, (schedule, state))


def _replay(graph: Any, recorded: tuple[Any, State]) -> None:
    """Launch a graph; it reads and writes arrays of the recorded schedule, which must live as long as it does."""
    del recorded
    wp.capture_launch(graph)


def _seconds(advance: Callable[[], None], device: wp.Device, frames: int) -> float:
    wp.synchronize_device(device)
    began = time.perf_counter()
    for _ in range(frames):
        advance()
    wp.synchronize_device(device)
    return (time.perf_counter() - began) / frames

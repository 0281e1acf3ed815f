"""The rate of a schedule, and its bound."""

import time
from statistics import median
from typing import Any

import warp as wp

from balloon_warp.model import Model, State

FRAMES = 10
REPEATS = 5
INSTRUCTIONS = 196
OBSTACLE_INSTRUCTIONS = 80
ISSUE_RATE = 4 * 32 * 1.98e9
"""thread instructions a second and multiprocessor of an H100 or H200 at its highest clock"""


def seconds_a_frame(schedule: Any, model: Model, state: State) -> float:
    """The median over some repeats, after a warm-up; recorded and replayed where the schedule allows."""
    schedule.advance_frame(state)
    advance = _replayed(schedule, model, state) if schedule.capturable else lambda: schedule.advance_frame(state)
    times = []
    for _ in range(REPEATS + 1):
        wp.synchronize_device(model.device)
        began = time.perf_counter()
        for _ in range(FRAMES):
            advance()
        wp.synchronize_device(model.device)
        times.append((time.perf_counter() - began) / FRAMES)
    return median(times[1:])


def _replayed(schedule: Any, model: Model, state: State) -> Any:
    with wp.ScopedDevice(model.device), wp.ScopedCapture(model.device) as capture:
        schedule.advance_frame(state)
    graph: Any = capture.graph
    return lambda: wp.capture_launch(graph)


def bound(model: Model, schedule: str) -> float | None:
    """Particle-substeps a second that the GPU could issue the `block` schedule's instructions for.

    Counted in its machine code for sm_90, for 12 springs a particle: 16 a spring (3 loads, 3 differences, 3 for the
    squared length, 1 root, 1 for the coefficient, 3 for the force, 2 of address and padding) and some more for
    inflation, damping, the step, the store and the barrier; with obstacles, each thread also moves the sphere and
    looks for contact. Shared memory allows about as much: 39 wavefronts a warp without bank conflicts, at one a cycle.
    """
    if schedule != "block" or not model.device.is_cuda:
        return None
    instructions = INSTRUCTIONS + (OBSTACLE_INSTRUCTIONS if model.sphere_count else 0)
    return model.device.sm_count * ISSUE_RATE / instructions

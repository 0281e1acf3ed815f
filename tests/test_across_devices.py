"""Short runs of every bundled scene: a GPU agrees with a CPU within a stated tolerance. test_matrix.py compares a CPU's
schedules."""

from functools import cache

import numpy as np
import pytest

from balloon_warp.errors import InputError
from balloon_warp.scene import Scene
from balloon_warp.scene.load import bundled_scenes, load_scene
from balloon_warp.simulator import Simulator

FRAMES = 10
TYPICAL, LARGEST = 2e-4, 5e-3
"""Differences allowed, as parts of the scene's size: the root mean square, and the largest.

Float32 rounds places by 6e-8, and sums of ten forces in another order, or with a GPU's fast division and square root,
by some 1e-6 of a step. Where nothing jumps, schedules so differ by 3e-7 after ten frames. But the inflation takes the
face nearest to the particle, and contact is or is not: where rounding decides, a particle moves elsewhere. Between the
CPU's schedules that made 4e-5 and 8e-4; a GPU rounds more, and so decides otherwise more often: five times as much.
Longer runs differ by more, since colliding bodies are chaotic."""
EARLIER = {"bowl_to_sphere": [("balloon.inflation.k_normal", 2.0)]}
"""of a scene that would be still"""
SCHEDULES = ("scatter", "gather", "block", "projective")


@cache
def reference(name: str, solver: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the points at the start and the end by the readable schedule on the CPU, shape (particle_count, 3)."""
    simulator = Simulator(scene(name, solver), "cpu", schedule="auto" if solver == "projective" else "scatter")
    return np.concatenate(simulator.read_frame().points), points_after(simulator)


def scene(name: str, solver: str) -> Scene:
    return load_scene(name, [*EARLIER.get(name, []), ("solver", solver)])


def points_after(simulator: Simulator) -> np.ndarray:
    for _ in range(FRAMES):
        simulator.step()
    return np.concatenate(simulator.read_frame().points)


@pytest.mark.parametrize("schedule", SCHEDULES)
@pytest.mark.parametrize("name", bundled_scenes())
def test_a_short_run_is_that_of_the_cpu(name: str, schedule: str, device: str):
    if device == "cpu":
        pytest.skip("is what GPUs are compared with")
    solver = "projective" if schedule == "projective" else "symplectic_euler"
    try:
        start, expected = reference(name, solver)
        simulator = Simulator(scene(name, solver), device, schedule="auto" if solver == "projective" else schedule)
    except InputError as refusal:  # of what a schedule or the solver does not have
        pytest.skip(str(refusal))
    size = float(np.ptp(start, axis=0).max())
    assert np.linalg.norm(expected - start, axis=1).max() / size > LARGEST
    away = np.linalg.norm(points_after(simulator) - expected, axis=1) / size
    assert np.sqrt((away**2).mean()) <= TYPICAL
    assert away.max() <= LARGEST

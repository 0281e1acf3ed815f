"""Frames handed from one to the next: what spheres and touching balloons carry is handed on, and back."""

from collections.abc import Sequence
from typing import Any

import gradient_scenes
import numpy as np
import pytest
import test_gradients_around as around
import test_gradients_spheres as spheres
import test_gradients_touch as touching
import warp as wp

import balloon_warp as bw
from balloon_warp.gradients.steps import Moving, Steps
from balloon_warp.trajectories import Trajectories

CASES = {
    "touching": (touching.CASES["of their own"], touching.value_at),
    "spheres": (gradient_scenes.CASES["gas beside spheres"], gradient_scenes.value_at),
    "obstacles": ((around.AMONG, [*around.OF_AMONG, "balloon.0.velocity.0"]), around.value_of),
    "exchange": (spheres.CASES_OF_SPHERES["exchange"], spheres.value_of),
}


def case_of(name: str) -> tuple[bw.Scene, Sequence[str], np.ndarray]:
    """Return a scene, paths, and values at them in two worlds, of which the second starts slower."""
    (of, paths), value_at = CASES[name]
    values = np.array([[value_at(of, path) for path in paths]] * 2)
    values[1, [path.startswith("balloon") and "velocity.0" in path for path in paths].index(True)] *= 0.9
    return of, paths, values


def weights_of(array: np.ndarray) -> np.ndarray:
    return np.random.default_rng(4).uniform(0.5, 1.5, array.shape[1:]).astype(np.float32)


def end(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return a loss of the last frame: weighted sums of places of particles and velocities of spheres."""
    slopes = [np.zeros(each.shape) for each in moved.points]
    loss: Any = 0.0
    for each, slope in zip(moved.points, slopes, strict=True):
        slope[:, -1] = weights_of(each[:, -1])
        loss = loss + (slope * each).sum(axis=(1, 2, 3))
    by_spheres = np.zeros(moved.sphere_velocities.shape)
    by_spheres[:, -1] = weights_of(moved.sphere_velocities[:, -1])
    loss = loss + (by_spheres * moved.sphere_velocities).sum(axis=(1, 2, 3))
    return loss, {"points": slopes, "sphere_velocities": by_spheres}


@pytest.mark.parametrize("name", CASES)
def test_frames_one_by_one_have_the_derivatives_of_gradient(name: str, device: str):
    """Frames are equal to the bit, and derivatives to 1e-5 of each: those by the values round in each frame."""
    of, paths, values = case_of(name)
    vary = dict(zip(paths, values.T, strict=True))
    told = bw.gradient(of, of=paths, loss=end, world_count=2, vary=vary, device=device)
    steps = Steps(of, paths, 2, device, "auto", ())
    begins = [steps.start(values)]
    for frame in range(of.frames):
        begins.append(steps.advance(begins[-1], frame, values))
    last = told.trajectories
    np.testing.assert_array_equal(begins[-1].points.numpy(), np.concatenate([each[:, -1] for each in last.points], 1))
    np.testing.assert_array_equal(begins[-1].sphere_positions.numpy(), last.sphere_positions[:, -1])
    bars = Moving(*(wp.zeros_like(array) for array in begins[-1]))
    of_points = np.concatenate([weights_of(each[:, -1]) for each in last.points])
    for array, each in ((bars.points, of_points), (bars.sphere_velocities, weights_of(last.sphere_velocities[:, -1]))):
        array.assign(np.stack([each] * 2))
    found = np.zeros(values.shape)
    for frame in reversed(range(of.frames)):
        bars, by_values = steps.turn_back(begins[frame], frame, values, bars)
        found += by_values
    found += steps.turn_start_back(values, bars)
    for column, path in enumerate(paths):
        np.testing.assert_allclose(found[:, column], told.gradients[path], rtol=1e-5, err_msg=path)

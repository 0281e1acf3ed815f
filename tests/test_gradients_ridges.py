"""Gradients of balloons whose faces meet ridges, see also `gradient_scenes`."""

from typing import Any

import numpy as np
import pytest
from gradient_scenes import CASES, RIDGED, far, scene

import balloon_warp as bw
from balloon_warp.gradients.refusals import require_paths
from balloon_warp.model import lay_out, plan_model
from balloon_warp.trajectories import Trajectories


@pytest.mark.full
def test_frames_are_those_without_gradients(device: str):
    of, paths = CASES["ridges"]
    found = bw.gradient(of, of=paths, loss=far, device=device).trajectories
    told = bw.simulate(of, device=device, schedule="gather")
    for name in ("points", "velocities"):
        np.testing.assert_array_equal(getattr(found, name)[0], getattr(told, name)[0])


def test_all_that_moves_together_has_the_gradients_of_what_rests():
    """Gradients are the same in a frame of reference that moves along: obstacles and ball, by 2 m/s, without damping.

    They agree to 1e-4 of the largest: places in float32 are others."""
    pace, seconds = np.array([2.0, 0.5, -1.0]), 2 / 120.0
    start: dict[str, Any] = {"position": (0.05, 1.02, 0.1), "velocity": np.array([1.5, -2.0, 0.1]), "damping": 0.0}
    found = []
    for part in (0.0, 1.0):
        along = [(0.0, (0.0, 0.0, 0.0)), (1.0, tuple(part * pace))]
        of = scene(
            frames=2, rate=120.0, substeps=16, faces=True, obstacle=[each | {"motion": along} for each in RIDGED],
            **start | {"velocity": tuple(start["velocity"] + part * pace)},
        )  # fmt: skip

        def loss(moved: Trajectories, shift: Any = part * pace * seconds) -> tuple[Any, dict[str, Any]]:
            slopes = np.zeros(moved.points[0].shape)
            slopes[..., -1, :, :] = 2.0 * (moved.points[0][..., -1, :, :] - shift)
            return (slopes**2).sum(axis=(-1, -2, -3)) / 4.0, {"points": [slopes]}

        found.append(bw.gradient(of, of=CASES["ridges"][1], loss=loss, device="cpu"))
    resting, moving = found
    assert moving.loss[0] == pytest.approx(resting.loss[0], rel=1e-5)
    most = np.abs(resting.by_points[0]).max()
    np.testing.assert_allclose(moving.by_points[0], resting.by_points[0], atol=1e-4 * most)
    of_stiffness = [each.gradients["balloon.stiffness.structural"][0] for each in found]
    assert of_stiffness[1] == pytest.approx(of_stiffness[0], rel=1e-3)


@pytest.mark.parametrize("name", ["balloon_pit", "letter_slot", "table"])
def test_bundled_scenes_with_edges_can_be_derived(name: str):
    plan = plan_model(bw.load_scene(name))
    require_paths(plan, lay_out(plan, "cpu"), [])

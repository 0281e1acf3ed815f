"""Gradients of small spheres that meet faces: one by one, at any time of a step, and moving on with them as one."""

from typing import Any

import numpy as np
import pytest
from dot_products import require_adjoint
from gradient_scenes import scene, value_at
from reference_runs import run
from test_gradients_spheres import SPHERE_TRACKS, ends, ends_in_float64, value_of

import balloon_warp as bw


def ball(**more: Any) -> dict[str, Any]:
    """Return a sphere that flies to a ball's wall from within, unless told otherwise."""
    told = {
        "radius": 0.2, "mass": 0.02, "velocity": (3.0, -2.0, -10.0), "friction": 0.3, "position": (0.1, 1.0, 0.2),
        "angular_velocity": (2.0, 1.0, 3.0),
    }  # fmt: skip
    return told | more


PRESSES = ball(position=(0.1, 1.98, 0.25), velocity=(3.0, -2.0, 1.0))
FALLS = ball(position=(0.3, 2.15, 0.03), radius=0.1, velocity=(2.0, -8.0, 0.2), friction=0.05)
FAST = ball(radius=0.1, velocity=(10.0, -200.0, 5.0), mass=0.05, position=(0.12, 1.97, 0.2), friction=0.02)
TINY = ball(radius=0.005, velocity=(3.0, -200.0, 2.0), mass=0.05, position=(0.02, 1.97, 0.03))
ON_CORNER = ball(position=(0.15, 2.19, 0.05), radius=0.25, velocity=(0.5, -3.0, 0.2), mass=0.1, friction=0.1)
OF_BALL = ["balloon.0.mass", "balloon.0.stiffness.structural", "balloon.0.friction"]
OF_SPHERE = ("mass", "radius", "position.0", "velocity.1", "angular_velocity.1", "friction")
CASES: dict[str, tuple[bw.Scene, tuple[int, int]]] = {
    "a substep": (scene(rate=1920.0, substeps=1, contact="penalty", friction=0.2, sphere=[PRESSES]), (2, 0)),
    "fast": (scene("gas", rate=480.0, substeps=4, contact="impulse", friction=0.2, sphere=[FAST]), (100, 0)),
    "as one": (scene(rate=480.0, substeps=4, contact="impulse", friction=0.2, sphere=[TINY]), (66, 1)),
    "beside a particle": (
        scene("gas", frames=2, contact="impulse", friction=0.2, sphere=[ON_CORNER]), (8, 0)
    ),
    "frames": (
        scene("gas", ground=True, frames=8, contact="penalty", friction=0.2, sphere=[ball(), FALLS]), (72, 0)
    ),
}  # fmt: skip
"""Scenes, with the numbers of contacts, and of contacts in which a sphere moves on with faces as one"""


def paths_of(of: bw.Scene) -> list[str]:
    return [*OF_BALL, *(f"sphere.{number}.{name}" for number in range(len(of.sphere)) for name in OF_SPHERE)]


@pytest.mark.full
@pytest.mark.parametrize("case", CASES)
def test_contacts_are_those_of_the_run_in_double_precision(case: str):
    of, contacts = CASES[case]
    told = run(of)
    small = told.reference.around.contacts.small
    assert (small.contacts, small.lumped) == contacts
    moved = bw.simulate(of, device="cpu", schedule="gather")
    np.testing.assert_allclose(moved.points[0], told.points[0], atol=2e-6)
    np.testing.assert_allclose(moved.sphere_positions, told.sphere_positions, atol=5e-6)


@pytest.mark.full
@pytest.mark.parametrize("case", CASES)
def test_what_a_shift_of_the_start_does_to_the_end_is_what_the_end_says_of_the_start(case: str, device: str):
    """Random directions of all particles' places and velocities, and of all values."""
    of, _ = CASES[case]

    def at_end(values: dict[str, float], shifts: Any) -> Any:
        told = run(of, values, shifts)
        courses = {name: getattr(told, name)[-1] for name in SPHERE_TRACKS}
        return [told.points[0][-1]], [told.velocities[0][-1]], courses

    require_adjoint(of, at_end, {path: value_at(of, path) for path in paths_of(of)}, device)


@pytest.mark.full
@pytest.mark.parametrize("case", ["a substep", "fast"])
def test_gradients_are_those_of_a_run_in_double_precision(case: str, device: str):
    """Each value's part in the loss is that of central differences, to 1e-4 of it and 1e-5 of the largest."""
    of, _ = CASES[case]
    paths = paths_of(of)
    found = bw.gradient(of, of=paths, loss=ends, device=device)
    assert found.loss[0] == pytest.approx(ends_in_float64(of, {}), rel=1e-6)
    values = np.array([value_of(of, path) for path in paths])
    slopes = []
    for path, value in zip(paths, values, strict=True):
        more, less = (ends_in_float64(of, {path: value * (1.0 + side * 1e-6)}) for side in (1.0, -1.0))
        slopes.append((more - less) / 2e-6)
    parts = values * [found.gradients[path][0] for path in paths]
    np.testing.assert_allclose(parts, slopes, rtol=1e-4, atol=1e-5 * np.abs(slopes).max())


@pytest.mark.full
@pytest.mark.parametrize("case", ["fast", "as one"])
def test_worlds_of_a_batch_have_the_gradients_and_frames_that_they_have_alone(case: str, device: str):
    of, _ = CASES[case]
    paths = paths_of(of)
    masses = {"sphere.0.mass": np.array([0.01, 0.03]), "balloon.0.velocity.0": np.array([0.1, -0.2])}
    found = bw.gradient(of, of=paths, loss=ends, world_count=2, vary=masses, device=device)
    alone = {path: values[1:] for path, values in masses.items()}
    single = bw.gradient(of, of=paths, loss=ends, vary=alone, device=device)
    assert single.loss[0] == found.loss[1] != found.loss[0]
    assert all(single.gradients[path][0] == found.gradients[path][1] for path in paths)
    np.testing.assert_array_equal(single.by_points[0], found.by_points[0][1])
    told = bw.simulate(of, device=device, schedule="gather", world_count=2, vary=masses)
    for name in ("points", "velocities"):
        np.testing.assert_array_equal(getattr(found.trajectories, name)[0], getattr(told, name)[0])
    np.testing.assert_array_equal(found.trajectories.sphere_positions, told.sphere_positions)

"""Every schedule against the reference, in every feature set: over a substep, a frame and three frames."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from feature_sets import SETS, feature_set

from balloon_warp.reference import Reference
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator

MOVE = 1e-6
"""Of the size of balloons: by so much all places are moved, to see what a scene makes of some roundings of float32.
One is 6e-8 of a place; a force has a few of its own, and so does each substep"""
ULP = 6e-8
LENGTHS = {"substep": 1, "frame": 1, "frames": 3}


def scene_of(name: str, length: str) -> Scene:
    """Return the scene of a set, of frames that are as long as a substep, or that have some."""
    scene = feature_set(name)
    if length != "substep":
        return scene
    rate = scene.frames_per_second * scene.substeps
    return scene.model_copy(update={"frames_per_second": rate, "substeps": 1})


def ended(reference: Any, frames: int) -> dict[str, np.ndarray]:
    """Return what the reference comes to."""
    for _ in range(frames):
        reference.frame()
    places, speeds = ([ball[name] for ball in reference.spheres] for name in ("position", "velocity"))
    return {
        "points": np.concatenate(reference.points), "velocities": np.concatenate(reference.velocities),
        "pressures": reference.pressures, "gas_amounts": reference.gas_amounts,
        "sphere_positions": np.reshape(places, (-1, 3)), "sphere_velocities": np.reshape(speeds, (-1, 3)),
    }  # fmt: skip


@cache
def told(name: str, length: str) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return what the reference comes to, and by how much else where places are moved, and numbers rounded."""
    scene, frames = scene_of(name, length), LENGTHS[length]
    end, most = ended(Reference(scene), frames), {}
    rng, roundings = np.random.default_rng(1), 4.0 + np.sqrt(frames * scene.substeps)  # which add up as a random walk
    others = [
        ended(Reference(scene, shifts=(MOVE * rng.uniform(-1.0, 1.0, end["points"].shape), 0.0)), frames) for _ in "12"
    ]
    for field, values in end.items():
        amplified = max(np.abs(other[field] - values).max(initial=0.0) for other in others)
        most[field] = 2.0 * amplified + roundings * ULP * np.abs(values).max(initial=0.0)
    most["sphere_positions"] += most["sphere_velocities"] * frames / scene.frames_per_second  # which they follow
    if scene.correction != "none":  # by how much a place is corrected over the substep, of which that is known to a ULP
        step = 1.0 / scene.frames_per_second / scene.substeps
        most["velocities"] += roundings * ULP * np.abs(end["points"]).max() / step
    if any(balloon.inflation.kind == "gas" for balloon in scene.balloon):
        most["pressures"] += 8.0 * ULP * scene.atmosphere.pressure  # from which they are told
    return end, most


def require_same(name: str, length: str, schedule: str, device: str) -> None:
    expected, most = told(name, length)
    simulator = Simulator(scene_of(name, length), device, schedule=schedule)
    for _ in range(LENGTHS[length]):
        simulator.step_unread()
    for field, values in expected.items():
        found = getattr(simulator.state, field).numpy()[0].astype(float)
        off = np.abs(found - values).max(initial=0.0)
        assert off <= most[field], (field, off, most[field])


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("name", SETS)
def test_the_schedule_of_a_device_does_what_the_reference_does(name: str, length: str, device: str):
    require_same(name, length, "auto", device)


@pytest.mark.full
@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("schedule", ["scatter", "gather", "block", "lanes", "octets"])
def test_every_schedule_does_what_the_reference_does(name: str, length: str, schedule: str, device: str):
    require_same(name, length, schedule, device)

"""Rounds of substeps: each runs once, in order, and what is recorded does not grow with their number."""

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere
from warp._src.apic.capture import APICapture

from balloon_warp import Simulator
from balloon_warp.scene import Balloon, Inflation, Obstacle, Scene, Touch
from balloon_warp.schedules import frames
from balloon_warp.schedules.frames import TURN, Rounds, make_clock

TURNS = Obstacle(
    size=(4, 0.2, 4), position=(0, -0.1, 0), motion=[(0, (0, 0, 0), (0, 0, 0)), (1, (0, 1, 0), (0, 90, 0))]
)
SOFT = Balloon(mesh=quad_sphere(3), position=(0, 1.1, 0), inflation=Inflation(k_normal=[(0, 0.0), (1, 1.0)]))
MANY, MORE = 501, 2003
"""Numbers of substeps of which none is a multiple of a turn, nor of the substeps between two searches"""


@pytest.mark.parametrize("interval", [0, 1, 5, TURN, TURN + 1, 2 * TURN - 1, 2 * TURN, 119, 600, 5000])
@pytest.mark.parametrize("count", [1, 65, 96, 590, 782])
def test_every_substep_runs_once_in_order_and_searches_when_it_should(count: int, interval: int):
    model: Any = SimpleNamespace(device=wp.get_device("cpu"), substeps=count, step_seconds=1.0e-4)
    clock, ran, launched = make_clock(model), [], 0
    a_frame = Rounds(model, interval, clock)

    def launch_substeps(numbers: range) -> None:
        nonlocal launched
        launched += 1
        for number in numbers:
            true = number + int(clock.done.numpy()[0])
            assert (number == 0) == (true == 0)
            if interval:
                assert (number % interval == 0) == (true % interval == 0)
            ran.append(true)

    for _ in range(2):
        a_frame.go_through(launch_substeps)
    assert ran == 2 * list(range(count))
    assert clock.done.numpy()[0] == 0
    assert a_frame.are_short == (count > frames.FLAT)


def scene(**changes: Any) -> Scene:
    """Return balloons that inflate by a ramp, touch each other, and are lifted by a moving floor."""
    balloons = [
        Balloon(mesh=quad_sphere(3), position=(0.15 * k, 1.1, 0), inflation=Inflation(k_normal=[(0, 0.0), (1, 1.0)]))
        for k in (-1, 1)
    ]
    return Scene(**{"balloon": balloons, "obstacle": [TURNS], "frames": 4, "substeps": MANY} | changes)


def points_of(made: Scene, schedule: str, device: str = "cpu") -> np.ndarray:
    """Return the points of all frames."""
    return np.stack([np.concatenate(frame.points) for frame in Simulator(made, device=device, schedule=schedule).run()])


@pytest.mark.parametrize(
    ("schedule", "changes"),
    [
        ("gather", {}),
        ("octets", {}),
        ("scatter", {"touch": Touch(itself=True)}),
        ("projective", {"solver": "projective", "substeps": 67, "balloon": [SOFT]}),
    ],
)
def test_a_frame_of_rounds_is_to_the_bit_one_of_single_substeps(
    monkeypatch: pytest.MonkeyPatch, device: str, schedule: str, changes: dict[str, Any]
):
    if schedule in ("octets", "scatter") and device != "cpu":
        pytest.skip("octets are a CPU's, and a GPU's scatter adds forces in any order")
    made = scene(**changes)
    in_rounds = points_of(made, schedule, device)
    monkeypatch.setattr(frames, "FLAT", MORE)
    monkeypatch.setattr("balloon_warp.schedules.frames.FEW", 99)
    np.testing.assert_array_equal(in_rounds, points_of(made, schedule, device))


def test_what_is_recorded_does_not_grow_with_the_substeps(monkeypatch: pytest.MonkeyPatch):
    recorded, record = [0], APICapture.build_launch_info

    def counted(*given: Any, **named: Any) -> Any:
        recorded[-1] += 1
        return record(*given, **named)

    monkeypatch.setattr("balloon_warp.system.warp_threads._remembering", nullcontext)
    monkeypatch.setattr(APICapture, "build_launch_info", counted)
    for substeps in (MANY, MORE):
        recorded.append(0)
        points_of(scene(substeps=substeps), "gather")
    _, few, many = recorded
    assert 0 < many <= 1.2 * few, "what is left over of a turn, and between two searches, has fewer than a turn"

"""Gradients from few checkpoints: others are simulated again, as seldom as can be, and results are the same."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from gradient_scenes import CHANGES, SPRINGS, N, scene

import balloon_warp as bw
from balloon_warp.batch.simulate import Trajectories
from balloon_warp.lab.gradients import derive
from balloon_warp.lab.gradients.derive import FewFrames, frames_again

PATHS = [SPRINGS[0], "balloon.damping", "balloon.velocity.1", "change.0.set.balloon.damping", "change.1.set.gravity"]


@cache
def least(frames: int, free: int) -> int:
    """Return the least number of simulated frames, of all places for the next beginning that is kept."""
    if frames <= 1 or free == 0:
        return frames * (frames - 1) // 2
    return min(way + least(frames - way, free - 1) + least(way, free) for way in range(1, frames))


class Counted:
    """Frames that are only counted: the state at the start of one is its number."""

    def __init__(self, frames: int, most: int):
        self.now = self.simulated = 0
        self.beginnings = FewFrames(frames, most, self.keep, self.go_back, self.advance)
        for frame in range(frames):
            self.beginnings.note(frame)
            self.now = frame + 1
        self.kept_first = len(self.beginnings._kept)
        self.last_kept = self.beginnings._kept[-1][0]

    def keep(self, frame: int) -> int:
        assert frame == self.now
        return frame

    def go_back(self, frame: int, beginning: int) -> None:
        assert frame == beginning
        self.now = frame

    def advance(self, frame: int) -> None:
        assert frame == self.now
        self.now += 1
        self.simulated += 1


@pytest.mark.parametrize("most", [1, 2, 3, 5, 40])
@pytest.mark.parametrize("frames", [1, 2, 7, 20, 36])
def test_frames_are_taken_in_order_and_simulated_as_seldom_as_can_be(frames: int, most: int):
    counted = Counted(frames, most)
    for frame in reversed(range(frames)):
        assert counted.beginnings.take(frame) == frame
        assert len(counted.beginnings._kept) <= most
    assert counted.kept_first == min(frames, most)
    assert counted.simulated + counted.last_kept == frames_again(frames, most - 1) == least(frames, most - 1)


def test_ten_thousand_frames_are_planned_at_once():
    counted = Counted(10_000, 10)
    for frame in reversed(range(10_000)):
        counted.beginnings.take(frame)
    assert counted.simulated < 5 * 10_000


def at_end(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return a loss of the last frame, and of the one in the middle."""
    slopes = np.zeros(moved.points[0].shape)
    weights = np.linspace(-1.0, 1.0, 3 * N).reshape(N, 3)
    seen = [-1, (len(slopes) - 1) // 2]
    slopes[seen] = weights
    return (weights * moved.points[0][seen]).sum(), {"points": [slopes]}


def same(found: bw.Gradient, told: bw.Gradient) -> None:
    """Require the same derivatives to the bit."""
    np.testing.assert_array_equal(found.loss, told.loss)
    for path in told.gradients:
        np.testing.assert_array_equal(found.gradients[path], told.gradients[path])
    for name in ("by_points", "by_velocities"):
        np.testing.assert_array_equal(getattr(found, name)[0], getattr(told, name)[0])


@pytest.mark.full
@pytest.mark.parametrize("way", ["block", "launched", "lanes"])
def test_few_checkpoints_give_the_same_bits(way: str, device: str):
    """Parameters change in frames 2 and 4, so that the way back goes through spans and returns to later ones."""
    if way == "lanes" and device != "cpu":
        pytest.skip("lanes are a CPU's")
    of = scene(frames=20, rate=240.0, substeps=4, change=CHANGES)
    asked: dict[str, Any] = {"of": PATHS, "loss": at_end, "device": device, "schedule": way}
    told = bw.gradient(of, **asked)
    for most in (3, 1):
        same(bw.gradient(of, checkpoints=most, **asked), told)
    seldom = bw.gradient(of, every=10, checkpoints=3, **asked)
    same(seldom, told)
    assert seldom.trajectories.points[0].shape == (3, N, 3)
    np.testing.assert_allclose(seldom.trajectories.times, [0.0, 10.0 / 240.0, 20.0 / 240.0])


@pytest.mark.nightly
def test_gas_is_restored(device: str):
    of = scene("gas", frames=6, substeps=4, rate=240.0, ground=True)
    asked: dict[str, Any] = {"of": ["balloon.inflation.start_pressure"], "loss": at_end, "device": device}
    same(bw.gradient(of, checkpoints=2, **asked), bw.gradient(of, **asked))


@pytest.mark.full
def test_as_many_are_kept_as_there_is_room_for(monkeypatch: pytest.MonkeyPatch):
    """Trajectories of all frames do not fit here; of each tenth they do, with few beginnings beside."""
    of = scene(frames=20, rate=240.0, substeps=4)
    asked: dict[str, Any] = {"of": PATHS[:1], "loss": at_end, "device": "cpu"}
    told = bw.gradient(of, **asked)
    room = 72 * N * 4
    monkeypatch.setattr(derive, "usable_memory", lambda device: room)
    monkeypatch.setattr("balloon_warp.lab.gradients.derive.usable_memory", lambda device: room)
    with pytest.raises(bw.InputError, match="enough for 4 frames, or 0 worlds; expected fewer, or a loss of"):
        bw.gradient(of, **asked)
    same(bw.gradient(of, every=10, **asked), told)

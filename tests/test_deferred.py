"""Deferred obstacle contact, in a launch of its own, gives the same motion as contact at once."""

import numpy as np
import pytest
import warp as wp

from balloon_warp.model import build_model, initial_state
from balloon_warp.scene import load_scene
from balloon_warp.schedules.choose import fastest_schedule
from balloon_warp.schedules.gather import GatherSchedule


def after_frames(name: str, frames: int) -> list[np.ndarray]:
    """Return points and velocities of a bundled scene's worlds."""
    model = build_model(load_scene(name), "cpu", 2)
    state, schedule = initial_state(model), GatherSchedule(model)
    for _ in range(frames):
        schedule.advance_frame(state)
    return [state.points.numpy(), state.velocities.numpy()]


@pytest.mark.full
def test_particles_that_are_put_off_do_the_same(monkeypatch):
    at_once = after_frames("table", 8)
    monkeypatch.setattr("balloon_warp.schedules.gather.has_many", lambda model: True)
    np.testing.assert_array_equal(after_frames("table", 8), at_once)


@pytest.mark.parametrize(("name", "taken"), [("knot", "gather"), ("balloon_bunch", "block")])
def test_auto_takes_what_is_faster_for_many_worlds_that_touch(name: str, taken: str, gpu: wp.Device):
    """The automatic schedule of a crowded batch is the faster one by benchmarks/RESULTS.md."""
    assert fastest_schedule(build_model(load_scene(name), gpu), 1024) == taken

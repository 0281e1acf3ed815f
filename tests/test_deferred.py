"""Launches for many particles on a GPU give the same motion as for few.

Obstacle contact has a launch of its own, and what pulls particles adds up what they do to the gas.
"""

import numpy as np
import pytest
import warp as wp

from balloon_warp.model import build_model, initial_state
from balloon_warp.scene import load_scene
from balloon_warp.schedules.choose import fastest_schedule
from balloon_warp.schedules.gather import GatherSchedule


def after_frames(name: str, frames: int) -> tuple[GatherSchedule, list[np.ndarray]]:
    """Return the schedule of two worlds of a bundled scene, and their points and velocities."""
    model = build_model(load_scene(name), "cpu", 2)
    state, schedule = initial_state(model), GatherSchedule(model)
    for _ in range(frames):
        schedule.advance_frame(state)
    return schedule, [state.points.numpy(), state.velocities.numpy()]


@pytest.mark.parametrize(("name", "frames"), [("table", 8), ("balloon_bunch", 2)])
def test_launches_for_many_particles_do_the_same(name, frames, monkeypatch):
    _, few = after_frames(name, frames)
    monkeypatch.setattr("balloon_warp.schedules.gather.has_many", lambda model: True)
    schedule, many = after_frames(name, frames)
    step = schedule.launches.step
    names = {piece.name for piece in step.pieces}
    assert {"particles_leave", "balloons_pull_to_note"} & names == {
        "balloons_pull_to_note" if step.features.gas else "particles_leave"
    }
    for one, other in zip(few, many, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("name", "taken"), [("knot", "gather"), ("balloon_bunch", "block")])
def test_auto_takes_what_is_faster_for_many_worlds_that_touch(name: str, taken: str, gpu: wp.Device):
    """The automatic schedule of a crowded batch is the faster one by benchmarks/RESULTS.md."""
    assert fastest_schedule(build_model(load_scene(name), gpu), 1024) == taken

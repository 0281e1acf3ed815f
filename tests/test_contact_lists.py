"""Lists of contacts that are too short at first: they grow, and nothing tells it of a trajectory."""

import numpy as np
import pytest
from feature_sets import feature_set
from gradient_losses import far
from gradient_scenes import CASES

import balloon_warp as bw
from balloon_warp.kernels.working import OF_TRIANGLES
from balloon_warp.scene import load_scene
from balloon_warp.schedules import contact_lists
from balloon_warp.simulator import Simulator

SHORT = 4
"""Length of short lists of triangles, whole fours; of others it is 1"""


@pytest.fixture
def short_lists(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Make lists short at first."""
    usual = contact_lists.first_lengths

    def shortened(model, features) -> dict[str, int]:
        first = usual(model, features)
        return {name: min(length, SHORT if name == "candidates" else 1) for name, length in first.items()}

    monkeypatch.setattr(contact_lists, "first_lengths", shortened)
    return monkeypatch


@pytest.mark.parametrize(
    ("name", "lists"), [("touch", {"candidates", "edge_pairs", "catches"}), ("faces", {"ridge_pairs", "catches"})]
)
def test_lists_that_grow_change_no_bit(name: str, lists: set[str], device: str, short_lists: pytest.MonkeyPatch):
    """A frame that finds no room is computed again: worlds, in a batch and alone, are as with room from the start."""
    own, gravities = "octets" if device == "cpu" else "gather", [9.81, 2.0, 9.81]
    vary = {"gravity": gravities}
    if feature_set(name).sphere:  # of which each world then has its own row
        vary["sphere.0.radius"] = 3 * [feature_set(name).sphere[0].radius]
    batch = Simulator(feature_set(name), device, 3, vary, schedule=own)
    alone = Simulator(load_scene(feature_set(name), {"gravity": gravities[0]}), device, schedule=own)
    short_lists.undo()
    roomy = Simulator(load_scene(feature_set(name), {"gravity": gravities[0]}), device, schedule=own)
    for simulator in (batch, alone, roomy):
        for _ in range(3):
            simulator.step_unread()
        assert simulator.warnings == roomy.warnings
        assert not simulator.schedule.overflow
    assert set(batch.model.contact_room) == set(alone.model.contact_room) == lists
    assert not roomy.model.contact_room
    for field in ("points", "velocities", "sphere_positions", "frame"):
        expected = getattr(roomy.state, field).numpy()
        np.testing.assert_array_equal(getattr(alone.state, field).numpy(), expected)
        if field != "frame":
            np.testing.assert_array_equal(getattr(batch.state, field).numpy()[[0, 2]], np.repeat(expected, 2, axis=0))


def test_gradients_have_the_lists_that_frames_have_come_to_need(device: str, short_lists: pytest.MonkeyPatch):
    of, paths, *_ = CASES["touch in a crowd"]
    found = bw.gradient(of, of=paths, loss=far, device=device)
    short_lists.undo()
    expected = bw.gradient(of, of=paths, loss=far, device=device)
    assert found.loss == expected.loss
    for path in paths:
        assert found.gradients[path] == expected.gradients[path]


def test_a_world_that_blows_up_makes_no_list_grow(device: str):
    """Everything is near everything, and ignored contacts are not told."""
    simulator = Simulator(feature_set("touch"), device, schedule="gather")
    lists = simulator.schedule.contact_lists
    assert lists
    working = lists._working
    for bad in (True, False):
        simulator.state.first_bad.fill_(0 if bad else contact_lists.HEALTHY)
        needs = np.zeros(working.needs.shape, dtype=np.int32)
        needs[0, int(OF_TRIANGLES)] = 1000
        working.needs.assign(needs)
        working.overflow.fill_(960)
        assert lists.grow(simulator.state) != bad
        assert lists.ignored == 0
        assert simulator.model.contact_room == ({} if bad else {"candidates": 1504})

"""Division of a batch into shares."""

import numpy as np
import pytest
from meshes import cube, quad_sphere

from balloon_warp import Scene
from balloon_warp.scene import Balloon
from balloon_warp.sweep import shares
from balloon_warp.sweep.groups import plan_groups
from balloon_warp.sweep.shares import cut_into_shares


@pytest.mark.parametrize(
    ("worlds", "sizes"),
    [
        (1, [1]),
        (9, [5, 4]),
        (64, [8] * 8),
        (65, [13] * 5),  # more than eight times eight: the next power of two, 16, makes five shares
    ],
)
def test_the_cut_depends_on_the_batch_alone(worlds: int, sizes: list[int], monkeypatch):
    """The cut has at most eight shares of at least eight cubes; each has its own part of the varied values."""
    monkeypatch.setitem(shares.GRAIN, "cpu", shares.Grain(1, 64))
    monkeypatch.setattr(shares, "SHARES", 8)
    mass = np.linspace(1.0, 0.01, worlds)
    groups = plan_groups(Scene(balloon=[Balloon(mesh=cube())]), worlds, {"balloon.mass": mass})
    cut = cut_into_shares(groups, "cpu")
    assert [share.plan.world_count for share in cut] == sizes
    np.testing.assert_array_equal(np.concatenate([share.worlds for share in cut]), np.arange(worlds))
    np.testing.assert_array_equal(np.concatenate([share.plan.parameters["mass"][:, 0] for share in cut]), mass)
    assert {len(share.plan.parameters["gravity"]) for share in cut} == {1}
    assert {share.plan.substeps for share in cut} == {groups[0].plan.substeps}  # that of the lightest world


def test_a_share_fills_the_lanes_of_a_cpu():
    """A share has as many worlds as a CPU has lanes, however many particles a world has."""
    groups = plan_groups(Scene(balloon=[Balloon(mesh=quad_sphere(20))]), 20, {"balloon.mass": np.full(20, 1.0)})
    assert groups[0].plan.particle_count > shares.GRAIN["cpu"].particles
    assert [len(share.worlds) for share in cut_into_shares(groups, "cpu")] == [7, 7, 6]


@pytest.mark.parametrize(("frames", "count"), [(1, 2), (100, 4), (1000, 32)])
def test_a_share_is_worth_its_beginning(frames: int, count: int, monkeypatch):
    """A short batch is cut into fewer shares, as each has a start-up cost, which still fit into a small memory."""
    monkeypatch.setattr(shares, "MOST_PARTICLES", 8 * 128)
    monkeypatch.setitem(shares.GRAIN, "cuda", shares.Grain(1, 8, 8 * 64 * 100 * 10))
    scene = Scene(balloon=[Balloon(mesh=cube())], frames=frames, substeps=10)
    assert len(cut_into_shares(plan_groups(scene, 256, {"balloon.mass": np.full(256, 100.0)}), "cuda")) == count

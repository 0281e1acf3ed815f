"""Worlds that differ in what makes a model: how large a balloon is, and how its springs differ from each other."""

import numpy as np
import pytest
from meshes import quad_sphere

from balloon_warp import Balloon, InputError, Scene, Simulator, load_scene, run_batch, simulate
from balloon_warp.sweep.groups import plan_groups
from balloon_warp.sweep.values import parse_vary, spread

SCENE = Scene(frames=3, substeps=8, balloon=[Balloon(mesh=quad_sphere(2), mass=1.0)])
VARIED = {
    "balloon.stiffness.variation": [0.0, 0.5, 0.5, 0.5],
    "balloon.0.stiffness.seed": np.array([0, 1, 2, 1]),
    "balloon.scale": [1.0, 1.0, 1.0, 2.0],
    "gravity": [1.0, 2.0, 3.0, 4.0],
}


def test_each_world_is_as_it_is_alone():
    """A world of a batch is bit-identical to the scene run alone, and all worlds differ."""
    found = simulate(SCENE, world_count=4, vary=VARIED, device="cpu", schedule="gather")
    for world in range(4):
        own = {path: values[world] for path, values in VARIED.items()}
        alone = simulate(load_scene(SCENE, own), device="cpu", schedule="gather")
        np.testing.assert_array_equal(found.points[0][world], alone.points[0])
    assert len({points.tobytes() for points in found.points[0][:, -1]}) == 4


def test_worlds_of_one_model_stay_together():
    vary = {"balloon.stiffness.seed": [3, 5, 3, 3], "gravity": [1.0, 2.0, 3.0, 4.0]}
    groups = plan_groups(SCENE, 4, vary)
    assert [group.worlds.tolist() for group in groups] == [[0, 2, 3], [1]]
    assert groups[0].plan.parameters["gravity"].tolist() == [1.0, 3.0, 4.0]


def test_the_command_line_s_lists_do(tmp_path):
    """Lists of the command line, whose numbers are all floats, vary integers such as a seed."""
    vary = spread(dict([parse_vary("balloon.stiffness.seed=1,2"), parse_vary("balloon.stiffness.variation=0.5")]), 3)
    run_batch(SCENE, tmp_path, 3, vary, export=range(3), device="cpu")
    with np.load(tmp_path / "table.npz") as table:
        assert table["balloon.stiffness.seed"][:3].tolist() == [1.0, 2.0, 1.0]
        energy = table["kinetic_energy"].reshape(4, 3)[-1]
    assert energy[0] == energy[2] != energy[1]


def test_what_is_wrong_is_told_with_its_world():
    with pytest.raises(InputError, match=r"^balloon\.0\.stiffness\.variation: must be .* 1 \(got 2\.0\), in world 1$"):
        plan_groups(SCENE, 2, {"balloon.stiffness.variation": [1.0, 2.0]})
    with pytest.raises(InputError, match=r"^balloon\.scale: expected a number for each of 2 worlds \(got 1\)$"):
        plan_groups(SCENE, 2, {"balloon.scale": [1.0]})
    with pytest.raises(InputError, match=r"^balloon\.scale: needs a model for each world; batches and `simulate`"):
        Simulator(SCENE, "cpu", 2, {"balloon.scale": [1.0, 2.0]})

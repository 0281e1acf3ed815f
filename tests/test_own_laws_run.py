"""Laws of one's own at work: in simulators, batches and their repetition, on a cluster, in the page."""

import json
from pathlib import Path

import numpy as np
import pytest
from meshes import cube
from own_laws import HARDENING, MAGNET, magnet
from trajectories import stepped

import balloon_warp as bw
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Change, Inflation, Scene, Stiffness
from balloon_warp.viewer.playground import Playground

SLACK = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
STRENGTH = "balloon.law.magnet.strength"


def loose(strength: float = 2.0, mesh: Path | bw.PolygonMesh | None = None, **fields) -> Scene:
    """Return a cube without springs about a pole at its middle."""
    law = {"magnet": {"strength": strength}}
    still = {"stiffness": SLACK, "damping": 0.0, "inflation": Inflation(k_normal=0.0)}
    balloon = Balloon(mesh=mesh or cube(), law=law, **still)
    fields = {"frames": 6, "substeps": 40, "gravity": 0.0, "law": {"magnet": {"pole": (0.5, 0.5, 0.5)}}} | fields
    return Scene(balloon=[balloon], **fields)


def sizes(simulator: bw.Simulator) -> np.ndarray:
    """Return the size of the cube in each world, over that at the start."""
    return np.ptp(simulator.state.points.numpy()[:, :, 1], axis=1)


def test_a_law_acts_in_every_schedule(schedule, device):
    """Each particle oscillates about the pole like a cosine, each world by its own strength."""
    simulator = stepped(bw.Simulator(loose(), device, 2, {STRENGTH: [9.0, 25.0]}, schedule, [MAGNET]), 30)
    np.testing.assert_allclose(sizes(simulator), np.abs(np.cos([1.5, 2.5])), atol=5e-3)


@pytest.mark.full
def test_a_law_begins_when_its_parameters_change(device):
    change = Change(time=0.5, set={STRENGTH: 9.0})
    simulator = bw.Simulator(loose(0.0, change=[change]), device, laws=[MAGNET])
    for frame in range(60):
        assert frame > 30 or sizes(simulator) == 1.0
        simulator.step()
    np.testing.assert_allclose(sizes(simulator), np.cos(1.5), atol=5e-3)


def test_a_batch_is_repeated_with_the_same_law_alone(tmp_path: Path):
    write_obj(tmp_path / "cube.obj", cube())
    scene = loose(mesh=tmp_path / "cube.obj")
    summary = bw.run_batch(scene, tmp_path / "a", 2, {STRENGTH: [1.0, 9.0]}, device="cpu", laws=[MAGNET])
    manifest = json.loads(Path(summary.manifest).read_text())
    assert manifest["laws"]["magnet"].keys() == {"force", "energy"}
    bw.repeat_batch(summary.manifest, tmp_path / "b", laws=[MAGNET])
    assert (tmp_path / "a" / "table.csv").read_bytes() == (tmp_path / "b" / "table.csv").read_bytes()
    for laws, sentence in (
        ([], r"its law magnet is missing; expected it in laws$"),
        ([MAGNET, HARDENING], r"has no law hardening; expected magnet$"),
        ([bw.particle_law(magnet, MAGNET.parameters)], r"^law magnet: its source has changed since the batch of"),
    ):
        with pytest.raises(bw.InputError, match=sentence):
            bw.repeat_batch(summary.manifest, tmp_path / "c", laws=laws)


def test_a_batch_on_workers_is_the_batch_here(tmp_path: Path):
    vary = {STRENGTH: [1.0, 9.0]}
    here = bw.run_batch(loose(), tmp_path / "a", 2, vary, device="cpu", laws=[MAGNET])
    there = bw.run_batch(loose(), tmp_path / "b", 2, vary, cluster=bw.Cluster(workers=1), laws=[MAGNET])
    assert Path(here.table[1]).read_bytes() == Path(there.table[1]).read_bytes()


def test_workers_refuse_a_law_that_they_cannot_find(tmp_path: Path):
    nameless = bw.particle_law(magnet, MAGNET.parameters)
    with pytest.raises(bw.InputError, match=r"^workers 1: law magnet: other processes cannot find it; expected a gl"):
        bw.run_batch(loose(), tmp_path, 2, cluster=bw.Cluster(workers=1), laws=[nameless])


@pytest.mark.full
def test_a_run_and_a_comparison_have_laws(tmp_path: Path):
    summary = bw.animate(loose(), tmp_path / "out.usdc", device="cpu", laws=[MAGNET])
    assert summary.frames == 6
    options = {"size": (64, 64), "samples": 1, "device": "cpu", "laws": [MAGNET]}
    comparison = bw.compare(loose(), {STRENGTH: [1.0, 9.0]}, tmp_path / "out.png", **options)
    volumes = [run.figures["volume"] for run in comparison.runs]
    assert volumes[0] > 1.01 * volumes[1]


@pytest.mark.full
def test_a_law_of_a_page_begins_when_its_slider_moves():
    playground = Playground(loose(0.0), "cpu", [MAGNET])
    playground.step()
    assert np.ptp(playground.points[:, 1]) == 1.0
    playground.set(STRENGTH, 100.0)
    for _ in range(3):
        playground.step()
    assert np.ptp(playground.points[:, 1]) < 0.95
    with pytest.raises(bw.InputError, match=r"^balloon\.0\.law\.magnet\.strength: must be at least 0"):
        playground.set(STRENGTH, -1.0)

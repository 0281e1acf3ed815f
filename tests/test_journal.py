"""Journal of a batch's finished shares: no workers are needed for that."""

import json

import numpy as np
import pytest
from meshes import quad_sphere
from pxr import Usd

from balloon_warp.blow_ups import BlowUp, Pull
from balloon_warp.scene import Balloon, Ground, Inflation, Scene
from balloon_warp.sweep import shares
from balloon_warp.sweep.blow_ups import Failures
from balloon_warp.sweep.checkpoints import batch_checkpoints
from balloon_warp.sweep.groups import plan_groups
from balloon_warp.sweep.journal import FAILURES, ShareJournal
from balloon_warp.sweep.manifest import describe_batch
from balloon_warp.sweep.output import BatchOutput
from balloon_warp.sweep.task import BatchTask

BALL = Balloon(mesh=quad_sphere(3), position=(0, 2, 0), inflation=Inflation(k_normal=0.2))
SCENE = Scene(balloon=[BALL], ground=Ground(), frames=6, substeps=40)


def test_what_blew_up_in_a_share_is_kept_with_it():
    spring = Pull("the structural spring to particle 7", 3.5, stretch=np.inf)
    blow_up = BlowUp(5, 2, 40, 1e-4, "particle 7", 3, np.inf, spring, touched=("the ground",), stable_step=2e-5)
    failures = Failures([blow_up], {3: 80, 11: 160})
    assert FAILURES.validate_python(json.loads(json.dumps(FAILURES.dump_python(failures)))) == failures


@pytest.mark.full
def test_shares_that_are_done_are_taken_up_with_what_became_of_them(device: str, tmp_path, monkeypatch):
    """Finished shares are restored with their rows, schedules and reports of blow-ups, and their stages join."""
    monkeypatch.setitem(shares.GRAIN, "cpu", shares.Grain(1, 1))
    vary = {"balloon.inflation.k_normal": [9e11, 0.2, 0.3, 0.4]}
    task = BatchTask(SCENE, plan_groups(SCENE, 4, vary), vary, np.array([0, 3]), tmp_path, on_blowup="restart")
    cut = shares.cut_into_shares(task.groups, "cpu")

    def journal(output: BatchOutput, resume: bool) -> ShareJournal:
        notes: list[str] = []
        safe = batch_checkpoints(task, describe_batch(task), 0.0, resume, notes.append)
        return ShareJournal(task, output, safe, "cpu")

    with BatchOutput(task, cut) as output:
        first = journal(output, resume=False)
        for number in (3, 0):
            share = cut[number], task.chosen, device, "gather", 4, task.on_blowup
            first.add(number, shares.simulate_share(*share, on_frame=lambda frame: None))
            first.save()
    played = Usd.Stage.Open(str(tmp_path / "partial" / "frames.usda"))
    for part, world in enumerate((3, 0)):
        alone = Usd.Stage.Open(str(tmp_path / "partial" / f"frames_{part:06d}.usdc"))
        points, there = (stage.GetAttributeAtPath(f"/World/World_{world}/mesh.points") for stage in (played, alone))
        assert points.GetNumTimeSamples() == SCENE.frames + 1
        for frame in range(SCENE.frames + 1):
            np.testing.assert_array_equal(points.Get(frame), there.Get(frame))
    assert [report.world for report in first.failures.reports] == [0]
    with BatchOutput(task, cut) as output_again:
        again = journal(output_again, resume=True)
    assert (again.schedules, again.failures, again.resumed) == (first.schedules, first.failures, 0.5)
    np.testing.assert_array_equal(output_again.table.values, output.table.values)
    np.testing.assert_array_equal(output_again.table.health, output.table.health)

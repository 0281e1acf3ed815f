"""Resumed batches, stopped or killed: the same files, byte by byte, as of an uninterrupted one."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batches import FRAMES, NAMES, OFTEN, WORLDS, contents, files_limited_to, press_ctrl_c_once, scene, stop_after
from meshes import quad_sphere
from pxr import Usd, UsdGeom

from balloon_warp import Balloon, Ground, Inflation, InputError, Scene, run_batch
from balloon_warp.batch.batch import BatchSummary
from balloon_warp.batch.output import BatchOutput, describe_batch
from balloon_warp.batch.recorder import plan_groups
from balloon_warp.batch.task import BatchTask, Failures, batch_checkpoints
from balloon_warp.blow_ups import BlowUp, Pull
from balloon_warp.farm import cluster
from balloon_warp.farm.cluster import FAILURES, ShareJournal
from balloon_warp.mesh.obj import write_obj
from balloon_warp.run.checkpoints import Checkpoints, Part
from balloon_warp.usd import stage as growing


@pytest.fixture
def vary(tmp_path) -> dict:
    """Return two meshes, which make two groups, and a push under which the last world blows up."""
    paths = [tmp_path / "coarse.obj", tmp_path / "fine.obj"]
    for number, path in enumerate(paths):
        write_obj(path, quad_sphere(2 + number))
    return {
        "balloon.mesh": [paths[world % 2] for world in range(WORLDS)],
        "balloon.inflation.k_normal": [0.2, 0.3, 0.4, 0.5, 9e11],
    }


def run(folder: Path, worlds: int = 2, **how: Any) -> BatchSummary:
    """Simulate a batch whose worlds differ in gravity, which was stopped in `folder` or is begun there."""
    how = {"vary": {"gravity": np.linspace(1, 9, worlds).tolist()}, "device": "cpu", **how}
    return run_batch(scene(), folder, worlds, **how)


def resumed(folder: Path, worlds: int = 2, **how: Any) -> list[str]:
    """Go on with such a batch, require the files of one that was never stopped, and return its messages."""
    notes: list[str] = []
    run(folder, worlds, resume=True, on_note=notes.append, **how)
    run(folder.with_name("whole"), worlds, **how)
    assert contents(folder) == contents(folder.with_name("whole"))
    return notes


@pytest.mark.full
def test_it_goes_on_to_the_same_bytes(vary: dict, schedule: str, device: str, tmp_path, monkeypatch):
    """Stopped twice: before and after the last world blew up."""
    monkeypatch.setattr(growing, "SAVE_BYTES", 10_000)
    how = {"vary": vary, "export": [1, 4], "device": device, "schedule": schedule}
    parts, frames, notes = tmp_path / "parts", [], []
    run(tmp_path / "whole", WORLDS, **how)
    for last in (2, 5):
        with pytest.raises(RuntimeError, match="stopped"):
            run(parts, WORLDS, **how, checkpoint_seconds=OFTEN, resume=True, on_frame=stop_after(last))
    assert contents(parts) == {}
    summary = run(parts, WORLDS, **how, resume=True, on_frame=frames.append, on_note=notes.append)
    assert frames == [5, 6]
    assert notes == [f"resuming after frame 4, from {parts / 'partial'}"]
    assert summary.resumed == pytest.approx(4 / FRAMES, abs=1e-3)
    assert summary.unhealthy_worlds == 1
    assert contents(parts) == contents(tmp_path / "whole")
    assert sorted(path.name for path in parts.iterdir()) == sorted([*NAMES, "manifest.json"])


def test_what_was_saved_opens(tmp_path):
    partial, whole = tmp_path / "partial", tmp_path / "whole"
    with pytest.raises(RuntimeError):
        run(tmp_path, 3, export=[2], checkpoint_seconds=OFTEN, on_frame=stop_after(4))
    run(whole, 3, export=[2])
    stages, tables = sorted(partial.glob("frames_*.usdc")), sorted(partial.glob("rows_*.npz"))
    assert len(stages) == len(tables) == 4
    opened, played = Usd.Stage.Open(str(whole / "worlds.usdc")), Usd.Stage.Open(str(partial / "frames.usda"))
    meshes = (str(prim.GetPath()) for prim in opened.Traverse() if prim.IsA(UsdGeom.Mesh))
    path = next(mesh for mesh in meshes if "World_2" in mesh)
    with np.load(whole / "table.npz") as table:
        volumes = table["volume"].reshape(FRAMES + 1, 3)
    assert (played.GetStartTimeCode(), played.GetEndTimeCode()) == (0, 3)
    for number, (stage_path, rows) in enumerate(zip(stages, tables, strict=True)):
        stage = Usd.Stage.Open(str(stage_path))
        assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (number, number)
        alone, together, expected = (
            UsdGeom.Mesh(each.GetPrimAtPath(path)).GetPointsAttr().Get(number) for each in (stage, played, opened)
        )
        np.testing.assert_array_equal(alone, expected)
        np.testing.assert_array_equal(together, expected)
        with np.load(rows) as saved:
            assert saved["frames"].tolist() == [number]
            assert saved["worlds"].tolist() == [0, 1, 2]
            np.testing.assert_array_equal(saved["values"][0, :, saved["columns"] == "volume"][0], volumes[number])
    assert [path.name for path in partial.glob("state_*")] == ["state_000003_0000.npz"]


@pytest.fixture
def stopped(tmp_path) -> Path:
    """Return the folder of a batch that was stopped after frame 3, and saved after frame 2."""
    with pytest.raises(RuntimeError):
        run(tmp_path / "stopped", checkpoint_seconds=OFTEN, on_frame=stop_after(3))
    return tmp_path / "stopped"


def test_rows_without_their_stage_are_never_there(tmp_path, monkeypatch):
    """A stage's part without its rows does not count, as a kill between the two leaves it."""
    rows, out = BatchOutput.rows, tmp_path / "out"

    def kill(self: BatchOutput, part: Part) -> dict[str, np.ndarray]:
        if part.frames.start == 2:
            assert (out / "partial" / "frames_000002.usdc").exists()
            raise RuntimeError("killed")
        return rows(self, part)

    monkeypatch.setattr(BatchOutput, "rows", kill)
    with pytest.raises(RuntimeError, match="killed"):
        run(out, export=[1], checkpoint_seconds=OFTEN)
    monkeypatch.undo()
    assert resumed(out, export=[1]) == [f"resuming after frame 1, from {out / 'partial'}"]


def test_rows_without_their_state_are_never_there(tmp_path, monkeypatch):
    """Rows without their state do not count, as a kill between the two leaves them."""
    save_state = Checkpoints.save_state

    def kill(self: Checkpoints, frame: int, *state: Any) -> None:
        if frame == 2:
            raise RuntimeError("killed")
        save_state(self, frame, *state)

    monkeypatch.setattr(Checkpoints, "save_state", kill)
    with pytest.raises(RuntimeError, match="killed"):
        run(tmp_path, checkpoint_seconds=OFTEN)
    assert sorted(path.name for path in (tmp_path / "partial").glob("rows_*")) == ["rows_000000.npz", "rows_000001.npz"]


def test_a_disk_that_fills_up_leaves_what_was_saved(stopped: Path):
    with files_limited_to(2000), pytest.raises(InputError, match=r"\A.*(state|rows)_.*: cannot be written: .*\Z"):
        run(stopped, resume=True, checkpoint_seconds=OFTEN)
    assert resumed(stopped) == [f"resuming after frame 2, from {stopped / 'partial'}"]


def test_ctrl_c_saves_the_frame_that_it_finds_and_no_later_one_is_simulated(tmp_path):
    frames: list[int] = []
    press = press_ctrl_c_once(lambda frame: frame == 3)

    def look(frame: int) -> None:
        frames.append(frame)
        press(frame)

    plays = r"partial/frames\.usda plays the frames so far, and --resume continues from them$"
    with pytest.raises(KeyboardInterrupt, match=plays):
        run(tmp_path / "out", export=[1], checkpoint_seconds=0.0, on_frame=look)
    assert frames == [0, 1, 2, 3]
    run(tmp_path / "out", export=[1], resume=True, on_frame=frames.append)
    assert frames == [*range(FRAMES + 1)]
    run(tmp_path / "whole", export=[1])
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_a_state_without_its_rows_is_not_gone_on_from(stopped: Path):
    """A kill between the two leaves it like that."""
    (stopped / "partial" / "state_000003_0000.npz").write_bytes(b"of a frame whose rows are not there")
    assert resumed(stopped) == [f"resuming after frame 2, from {stopped / 'partial'}"]


BALL = Balloon(mesh=quad_sphere(3), position=(0, 2, 0), inflation=Inflation(k_normal=0.2))
SCENE = Scene(balloon=[BALL], ground=Ground(), frames=6, substeps=40)


def test_what_blew_up_in_a_share_is_kept_with_it():
    spring = Pull("the structural spring to particle 7", 3.5, stretch=np.inf)
    blow_up = BlowUp(5, 2, 40, 1e-4, "particle 7", 3, np.inf, spring, touched=("the ground",), stable_step=2e-5)
    failures = Failures([blow_up], {3: 80, 11: 160})
    assert FAILURES.validate_python(json.loads(json.dumps(FAILURES.dump_python(failures)))) == failures


@pytest.mark.full
def test_shares_that_are_done_are_taken_up_with_what_became_of_them(device: str, tmp_path, monkeypatch):
    monkeypatch.setitem(cluster.GRAIN, "cpu", cluster.Grain(1, 1))
    vary = {"balloon.inflation.k_normal": [9e11, 0.2, 0.3, 0.4]}
    task = BatchTask(SCENE, plan_groups(SCENE, 4, vary), vary, np.array([0, 3]), tmp_path, on_blowup="restart")
    cut = cluster.cut_into_shares(task.groups, "cpu")

    def journal(output: BatchOutput, resume: bool) -> ShareJournal:
        notes: list[str] = []
        safe = batch_checkpoints(task, describe_batch(task), 0.0, resume, notes.append)
        return ShareJournal(task, output, safe, "cpu")

    with BatchOutput(task, cut) as output:
        first = journal(output, resume=False)
        for number in (3, 0):
            share = cut[number], task.chosen, device, "gather", 4, task.on_blowup
            first.add(number, cluster.simulate_share(*share, on_frame=lambda frame: None))
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

"""Resumed runs: the same bytes as of an uninterrupted one; and what holds for checkpoints of runs and batches alike."""

import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from time import sleep
from typing import Any

import batches
import numpy as np
import pytest
from meshes import cube, quad_sphere
from pxr import Usd

from balloon_warp import Balloon, Change, Ground, Inflation, InputError, Scene, Sphere, String, animate, run_batch
from balloon_warp.usd import stage

FRAMES, STOPPED_AT = 12, 7
SCENE = Scene(
    frames=FRAMES,
    net_forces=True,
    normals="cached",
    balloon=[Balloon(mesh=quad_sphere(3), position=(0.0, 1.2, 0.0), inflation=Inflation(k_normal=0.2))],
    sphere=[Sphere(position=(0.2, 2.2, 0.0), radius=0.4, start=0.05, end=0.15)],
    string=[String(anchor=(0.0, 0.0, 0.0), length=0.1)],
    ground=Ground(),
    change=[Change(time=0.06, set={"ground.height": 0.1}), Change(time=0.14, set={"normals": "fresh"})],
)
SCENES = {"euler": SCENE, "projective": SCENE.model_copy(update={"solver": "projective", "change": SCENE.change[:1]})}


class CrashError(Exception):
    """Error that nothing handles, as a kill."""


def crash(frame: int) -> None:
    if frame == STOPPED_AT:
        raise CrashError


def press_ctrl_c(frame: int) -> None:
    if frame == STOPPED_AT:
        os.kill(os.getpid(), signal.SIGINT)


def stop(scene: Scene, output: Path, how: Callable[[int], None] = crash, **options: Any) -> Path:
    """Run until frame `STOPPED_AT` and return the folder that is left."""
    options = {"checkpoint_seconds": batches.OFTEN, **options}
    with pytest.raises((CrashError, KeyboardInterrupt)):
        animate(scene, output, on_frame=how, **options)
    return output.with_name(f"{output.name}.partial")


def gone_on(scene: Scene, output: Path, **options: Any) -> int:
    """Resume a run, require the bytes of one that was never stopped, and return the frame that it went on from."""
    whole = output.with_stem("whole")
    if not whole.exists():
        animate(scene, whole, **options)
    begin = animate(scene, output, resume=True, **options).begin
    assert output.read_bytes() == whole.read_bytes()
    return begin


@pytest.mark.full
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(("save_bytes", "suffix"), [(0, ".usdc"), (2**26, ".usda")])
def test_the_bytes_are_those_of_a_run_that_was_never_stopped(name, save_bytes, suffix, device, tmp_path, monkeypatch):
    monkeypatch.setattr(stage, "SAVE_BYTES", save_bytes)
    output = tmp_path / f"out{suffix}"
    folder = stop(SCENES[name], output, device=device)
    assert not output.exists()
    assert gone_on(SCENES[name], output, device=device) == STOPPED_AT - 1  # it crashed before frame 7 was saved
    assert not folder.exists()


@pytest.mark.full
def test_ctrl_c_saves_the_frames_so_far_in_a_stage_that_opens(tmp_path):
    whole, output = tmp_path / "whole.usdc", tmp_path / "out.usdc"
    animate(SCENE, whole)
    output.write_bytes(b"good")
    with pytest.raises(KeyboardInterrupt, match=r"out\.usdc\.partial/frames\.usda plays .* --resume"):
        animate(SCENE, output, on_frame=press_ctrl_c)
    assert output.read_bytes() == b"good"
    part, all_frames = (Usd.Stage.Open(str(path)) for path in (tmp_path / "out.usdc.partial/frames.usda", whole))
    assert (part.GetStartTimeCode(), part.GetEndTimeCode()) == (0, STOPPED_AT)
    for prim in all_frames.Traverse():
        if "Studio" in str(prim.GetPath()):
            continue  # which stands around all frames, once they are there
        for attribute in prim.GetAttributes():
            there = part.GetAttributeAtPath(attribute.GetPath())
            last = STOPPED_AT - (attribute.GetName() == "velocities")  # the last one's are of the frames so far
            for time in range(last + 1):
                np.testing.assert_array_equal(np.array(there.Get(time)), np.array(attribute.Get(time)), str(attribute))
    assert gone_on(SCENE, output) == STOPPED_AT


@pytest.mark.full
def test_a_checkpoint_waits_for_frames_that_are_still_being_written(tmp_path, monkeypatch):
    write = stage.StageWriter.write

    def write_slowly(self: stage.StageWriter, frame: Any) -> None:
        sleep(0.05)
        write(self, frame)

    output = tmp_path / "out.usdc"
    monkeypatch.setattr(stage.StageWriter, "write", write_slowly)
    with pytest.raises(KeyboardInterrupt):
        animate(SCENE, output, on_frame=press_ctrl_c)
    monkeypatch.undo()
    assert gone_on(SCENE, output) == STOPPED_AT


class Job:
    """A run, or a batch whose worlds differ in gravity."""

    def __init__(self, word: str, folder: Path):
        self.word, self.folder, self.stopped_at = word, folder, 7 if word == "run" else 3
        self.partial = folder / ("out.usdc.partial" if word == "run" else "partial")

    def begin(self, **how: Any) -> Any:
        """Simulate the job, or another of its name."""
        if self.word == "run":
            return animate(**{"scene": SCENE, "output": self.folder / "out.usdc", "device": "cpu", **how})
        of = {"scene": batches.scene(), "folder": self.folder, "world_count": 2, "vary": {"gravity": [1, 9]}}
        return run_batch(**{**of, "export": [0], "device": "cpu", **how})

    def stop(self, **how: Any) -> dict[str, bytes]:
        """Kill the job on the way, and return the files of its last checkpoint."""
        how = {"checkpoint_seconds": batches.OFTEN, "on_frame": batches.stop_after(self.stopped_at), **how}
        with pytest.raises(RuntimeError, match="stopped"):
            self.begin(**how)
        return self.saved()

    def saved(self, folder: Path | None = None) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (folder or self.partial).glob("*")}

    def refused(self, sentence: str, **how: Any) -> str:
        """Require that the job cannot go on, by one sentence, and that its saved state stays."""
        before = self.saved()
        with pytest.raises(InputError, match=sentence) as refusal:
            self.begin(**{"resume": True, "on_frame": lambda _: pytest.fail("simulates"), **how})
        assert self.saved() == before
        assert "\n" not in str(refusal.value)
        return str(refusal.value)


@pytest.fixture(params=["run", "batch"])
def job(request: pytest.FixtureRequest, tmp_path: Path) -> Job:
    return Job(request.param, tmp_path)


@pytest.mark.parametrize("seconds", [0.0, 1e6])
def test_what_is_short_or_not_to_be_saved_leaves_nothing(seconds: float, job: Job):
    job.stop(checkpoint_seconds=seconds)
    assert list(job.folder.iterdir()) == []


def scene_of(**fields: Any) -> dict[str, Scene]:
    return {"scene": SCENE.model_copy(update=fields)}


ANOTHER = [
    ("run", scene_of(balloon=[Balloon(mesh=quad_sphere(3, 0.6))]), "files.balloon.0.mesh is "),
    ("batch", {"vary": {"gravity": [1, 8]}}, "vary.gravity.1 is 9.0 there and 8.0 here"),
    ("batch", {"world_count": 3, "vary": {"gravity": [1, 9, 9]}}, "vary.gravity is a list of 2 there and a list of 3 "),
    ("batch", {"schedule": "gather"}, 'schedules.0 is "lanes" there and "gather" here'),
    ("batch", {"scene": batches.scene(balloon=[Balloon(mesh=cube())])}, "files."),
]
"""Jobs of the same name, and where they differ"""


@pytest.mark.parametrize(
    ("job", "change", "difference"),
    [
        ("run", scene_of(gravity=3.0), "scene.gravity is 9.81 there and 3"),
        *(pytest.param(*case, marks=pytest.mark.full) for case in ANOTHER),
    ],
    indirect=["job"],
)
def test_another_job_is_refused(job: Job, change: dict[str, Any], difference: str):
    job.stop()
    said = job.refused("belongs to another", **change)
    assert said.startswith(f"--resume: {job.partial} belongs to another {job.word}: {difference}")


OF_RUN = {"versions.balloon-warp": "0.0.1", "schedule": "lanes", "device": "another"}
OF_BATCH = {"versions.warp-lang": "0.1", "substeps": 1, "on_blowup": "restart", "simulated": "in 3 shares"}


@pytest.mark.full
@pytest.mark.parametrize(
    ("job", "path", "value"),
    [*(("run", *other) for other in OF_RUN.items()), *(("batch", *other) for other in OF_BATCH.items())],
    indirect=["job"],
)
def test_what_else_the_bits_depend_on_is_compared(job: Job, path: str, value: object):
    job.stop()
    said = json.loads((job.partial / "job.json").read_text())
    *above, name = path.split(".")
    place = said[above[0]] if above else said
    assert place[name] != value
    place[name] = value
    (job.partial / "job.json").write_text(json.dumps(said))
    job.refused(rf"belongs to another {job.word}: {path} is {json.dumps(value)} there and .* here; expected the same")


@pytest.mark.parametrize("old", ["", ".old"])
def test_something_else_of_that_name_is_told_before_the_job(old: str, job: Job):
    there = job.partial.with_name(f"{job.partial.name}{old}")
    there.mkdir()
    (there / "thesis.txt").write_text("not ours")
    job.refused(rf"{there.name}: is where checkpoints go; expected no file of that name$", resume=False)
    assert (there / "thesis.txt").read_text() == "not ours"


def test_an_earlier_job_is_mentioned_and_kept_aside_until_another_is_done(job: Job):
    """Jobs that are too short for a checkpoint leave it where it is."""
    saved, notes, aside = job.stop(), [], job.partial.with_name(f"{job.partial.name}.old")
    other = {"scene": (SCENE if job.word == "run" else batches.scene()).model_copy(update={"substeps": 60})}
    job.begin(**other)
    assert job.saved() == saved
    job.stop(**other, on_note=notes.append)
    kept = f"it is kept as {aside.name} until this {job.word} is done"
    assert notes == [f"{job.partial} holds an earlier {job.word} that --resume would continue; {kept}"]
    assert job.saved(aside) == saved
    job.begin(**other, resume=True)
    assert not job.partial.exists()
    assert not aside.exists()


def test_nothing_to_resume_begins_at_the_start(job: Job):
    notes: list[str] = []
    job.begin(resume=True, on_note=notes.append)
    assert notes == [f"no checkpoint in {job.partial} to resume from: starting from the beginning"]


@pytest.mark.parametrize(
    ("job", "name"),
    [
        ("run", "job.json"),
        pytest.param("run", "frames_000003.usdc", marks=pytest.mark.full),
        pytest.param("run", "state_000006_0000.npz", marks=pytest.mark.full),
        *(("batch", name) for name in ("job.json", "rows_000001.npz", "state_000002_0000.npz")),
    ],
    indirect=["job"],
)
def test_a_damaged_checkpoint_is_refused(job: Job, name: str):
    job.stop()
    (job.partial / name).write_bytes((job.partial / name).read_bytes()[:40])
    job.refused(rf"{name}: (cannot be read|USD cannot open it)")
    assert [path.name for path in job.folder.iterdir()] == [job.partial.name]


class Spy:
    """Pickle that runs code when it is loaded."""

    def __reduce__(self) -> tuple:
        return os.mkdir, ("run",)


@pytest.mark.parametrize(
    ("job", "name", "array"),
    [
        pytest.param("run", "state_000006_0000.npz", "points", marks=pytest.mark.full),
        ("batch", "rows_000000.npz", "values"),
        ("batch", "state_000002_0000.npz", "points"),
    ],
    indirect=["job"],
)
def test_nothing_in_a_checkpoint_is_run(job: Job, name: str, array: str, monkeypatch):
    monkeypatch.chdir(job.folder)
    job.stop()
    with np.load(job.partial / name) as saved:
        arrays = dict(saved)
    np.savez(job.partial / name, **{**arrays, array: np.array([Spy()], dtype=object)})
    job.refused(rf"{name}: cannot be read: ")
    assert not (job.folder / "run").exists()


def test_each_file_of_a_checkpoint_appears_whole(job: Job, monkeypatch):
    """Each is renamed into place, once it is whole."""
    whole, replace = set(), os.replace

    def name(source: Path, target: Path) -> None:
        whole.add(target)
        replace(source, target)

    monkeypatch.setattr(os, "replace", name)
    kinds = {name.partition("_")[0] for name in job.stop()}
    assert kinds == {"job.json", "rows", "frames", "state", "frames.usda", "still.usdc"}
    assert {*job.partial.iterdir()} <= whole


def test_a_checkpoint_that_cannot_be_written_ends_the_job_and_harms_nothing(job: Job):
    (job.folder / "out.usdc").write_bytes(b"good")

    def take_away(frame: int) -> None:
        if frame == job.stopped_at:
            job.partial.rename(job.folder / "taken away")  # at once: it is written to meanwhile

    with pytest.raises(InputError, match=rf"\A.*{job.partial.name}/.*: cannot be written: .*\Z"):
        job.begin(checkpoint_seconds=batches.OFTEN, on_frame=take_away)
    assert (job.folder / "out.usdc").read_bytes() == b"good"


@pytest.mark.full
@pytest.mark.parametrize("name", [f"state_{STOPPED_AT - 2:06d}_0000.npz", f"frames_{STOPPED_AT:06d}.usdc"])
def test_a_kill_between_the_files_of_a_checkpoint_does_no_harm(name: str, tmp_path):
    folder = stop(SCENE, tmp_path / "out.usdc")
    assert not (folder / name).exists()
    (folder / name).write_bytes(b"not needed")
    assert gone_on(SCENE, tmp_path / "out.usdc") == STOPPED_AT - 1


@pytest.mark.full
def test_checkpoints_go_all_at_once_so_that_a_kill_leaves_nothing_to_resume(tmp_path, monkeypatch):
    folder = stop(SCENE, tmp_path / "out.usdc")
    monkeypatch.setattr(shutil, "rmtree", lambda *_, **__: None)
    animate(SCENE, tmp_path / "out.usdc", resume=True)
    assert not folder.exists()

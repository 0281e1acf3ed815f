"""Resumed runs, stopped or killed: the same bytes as of an uninterrupted one."""

import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
import pytest
from batches import plant_spy, tamper, watch_names
from meshes import quad_sphere
from pxr import Usd

from balloon_warp import Balloon, Change, Ground, Inflation, InputError, Scene, Sphere, String, animate
from balloon_warp.mesh.obj import write_obj
from balloon_warp.outputs.usd import growing
from balloon_warp.outputs.usd import stage as usd_stage
from balloon_warp.resume import differences

FRAMES, STOPPED_AT = 12, 7
ALWAYS = 1e-9
"""seconds between checkpoints: one after each frame"""
SCENE = Scene(
    frames=FRAMES,
    net_forces=True,
    normals="cached",
    balloon=[Balloon(mesh=quad_sphere(3), position=(0.0, 1.2, 0.0), inflation=Inflation(k_normal=0.2))],
    sphere=[Sphere(position=(0.2, 2.1, 0.0), radius=0.3, start=0.05, end=0.15)],
    string=[String(anchor=(0.0, 0.0, 0.0), length=0.1)],
    ground=Ground(),
    change=[Change(time=0.06, set={"ground.height": 0.1}), Change(time=0.14, set={"normals": "fresh"})],
)
POINTS = "/World/mesh.points"
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
    options = {"checkpoint_seconds": ALWAYS, **options}
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
@pytest.mark.parametrize("save_bytes", [0, 2**26])
@pytest.mark.parametrize("suffix", [".usdc", ".usda"])
def test_the_bytes_are_those_of_a_run_that_was_never_stopped(name, save_bytes, suffix, device, tmp_path, monkeypatch):
    monkeypatch.setattr(growing, "SAVE_BYTES", save_bytes)
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
    write = usd_stage.StageWriter.write

    def write_slowly(self: usd_stage.StageWriter, frame: Any) -> None:
        sleep(0.05)
        write(self, frame)

    output = tmp_path / "out.usdc"
    monkeypatch.setattr(usd_stage.StageWriter, "write", write_slowly)
    with pytest.raises(KeyboardInterrupt):
        animate(SCENE, output, on_frame=press_ctrl_c)
    monkeypatch.undo()
    assert gone_on(SCENE, output) == STOPPED_AT


@pytest.mark.full
def test_several_parts_are_played_one_after_the_other(tmp_path):
    folder = stop(SCENE, tmp_path / "out.usdc")
    assert len(list(folder.glob("frames_*.usdc"))) == STOPPED_AT
    assert len(list(folder.glob("state_*.npz"))) == 1
    animate(SCENE, tmp_path / "whole.usdc")
    together, whole = (Usd.Stage.Open(str(path)) for path in (folder / "frames.usda", tmp_path / "whole.usdc"))
    for time in range(STOPPED_AT):
        alone = Usd.Stage.Open(str(folder / f"frames_{time:06d}.usdc"))
        assert (alone.GetStartTimeCode(), alone.GetEndTimeCode()) == (time, time)
        expected = np.array(whole.GetAttributeAtPath(POINTS).Get(time))
        for stage in (together, alone):
            np.testing.assert_array_equal(np.array(stage.GetAttributeAtPath(POINTS).Get(time)), expected)


@pytest.mark.parametrize("seconds", [0.0, 1e6])
def test_what_is_short_or_not_to_be_saved_leaves_nothing(seconds: float, tmp_path):
    assert not stop(SCENE, tmp_path / "out.usdc", checkpoint_seconds=seconds).exists()
    assert list(tmp_path.iterdir()) == []


def test_another_scene_is_refused(tmp_path):
    output = tmp_path / "out.usdc"
    folder = stop(SCENE, output)
    other = r"out\.usdc\.partial belongs to another run: scene\.gravity is 9\.81 there and 3"
    with pytest.raises(InputError, match=other):
        animate(SCENE.model_copy(update={"gravity": 3.0}), output, resume=True)
    assert folder.exists()


OTHERS = {"versions.warp-lang": "0.1", "versions.balloon-warp": "0.0.1", "device": "another", "schedule": "lanes"}


@pytest.mark.full
@pytest.mark.parametrize(("path", "value"), [*OTHERS.items(), ("substeps", 1)])
def test_what_else_the_bits_depend_on_is_compared(path: str, value: object, tmp_path):
    output = tmp_path / "out.usdc"
    tamper(stop(SCENE, output) / "job.json", path, value)
    there = rf"belongs to another run: {path} is {json.dumps(value)} there and .* here; expected"
    with pytest.raises(InputError, match=there):
        animate(SCENE, output, resume=True)


@pytest.mark.full
def test_another_mesh_is_refused(tmp_path):
    mesh, output = tmp_path / "ball.obj", tmp_path / "out.usdc"
    scene = SCENE.model_copy(update={"balloon": [Balloon(mesh=mesh, position=(0.0, 1.2, 0.0))]})
    write_obj(mesh, quad_sphere(3))
    stop(scene, output)
    write_obj(mesh, quad_sphere(3, 0.6))
    with pytest.raises(InputError, match=r"belongs to another run: files\.balloon\.0\.mesh is "):
        animate(scene, output, resume=True)


@pytest.mark.parametrize("name", ["out.usdc.partial", "out.usdc.partial.old"])
def test_something_else_of_that_name_is_told_before_the_run(name: str, tmp_path):
    (tmp_path / name).mkdir()
    (tmp_path / name / "thesis.txt").write_text("not ours")
    with pytest.raises(InputError, match=rf"{name}: is where checkpoints go; expected no file of that name$"):
        animate(SCENE, tmp_path / "out.usdc", on_frame=lambda _: pytest.fail("simulates"))
    assert (tmp_path / name / "thesis.txt").read_text() == "not ours"


@pytest.mark.full
def test_an_earlier_run_is_mentioned_and_kept_aside_until_another_is_done(tmp_path):
    output, notes = tmp_path / "out.usdc", []
    folder = stop(SCENE, output)
    saved = {path.name: path.read_bytes() for path in folder.iterdir()}
    other, aside = SCENE.model_copy(update={"gravity": 3.0}), tmp_path / "out.usdc.partial.old"
    stop(other, output, on_note=notes.append)
    kept = f"it is kept as {aside.name} until this run is done"
    assert notes == [f"{folder} holds an earlier run that --resume would continue; {kept}"]
    assert {path.name: path.read_bytes() for path in aside.iterdir()} == saved
    assert animate(other, output, resume=True).begin == STOPPED_AT - 1
    assert [path.name for path in tmp_path.iterdir()] == ["out.usdc"]


@pytest.mark.full
def test_of_runs_that_were_begun_anew_the_last_is_kept_aside(tmp_path):
    output = tmp_path / "out.usdc"
    for gravity in (3.0, 4.0, 5.0):
        stop(SCENE.model_copy(update={"gravity": gravity}), output)
    names = "out.usdc.partial.old", "out.usdc.partial"
    kept = [json.loads((tmp_path / name / "job.json").read_text())["scene"]["gravity"] for name in names]
    assert kept == [4.0, 5.0]
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(
    ("there", "here", "phrases"),
    [
        ({"a": 1}, {"a": 1, "b": 2}, ["b is here only"]),
        ({"a": {"b": 1}}, {"a": {}}, ["a.b is there only"]),
        ({"a": [1, 2]}, {"a": [1, 3]}, ["a.1 is 2 there and 3 here"]),
        ({"a": [1, 2]}, {"a": [1]}, ["a is a list of 2 there and a list of 1 here"]),
        ({"a": "x"}, {"a": "x"}, []),
    ],
)
def test_where_two_jobs_differ_is_said(there: dict, here: dict, phrases: list[str]):
    assert list(differences(there, here)) == phrases


@pytest.mark.full
def test_nothing_to_resume_is_the_start_and_short_runs_leave_an_earlier_checkpoint_as_it_is(tmp_path):
    output, notes = tmp_path / "out.usdc", []
    assert animate(SCENE, output, resume=True, on_note=notes.append).begin == 0
    assert "starting from the beginning" in notes[0]
    folder = stop(SCENE, output)
    animate(SCENE.model_copy(update={"gravity": 3.0}), output)
    assert folder.exists()


@pytest.mark.full
@pytest.mark.parametrize("name", ["frames_000003.usdc", "state_000006_0000.npz", "job.json"])
def test_a_damaged_checkpoint_is_refused(name: str, tmp_path):
    output = tmp_path / "out.usdc"
    damaged = stop(SCENE, output) / name
    damaged.write_bytes(damaged.read_bytes()[:40])
    with pytest.raises(InputError, match=name):
        animate(SCENE, output, resume=True)
    assert not output.exists()


@pytest.mark.full
@pytest.mark.parametrize("name", [f"state_{STOPPED_AT - 2:06d}_0000.npz", f"frames_{STOPPED_AT:06d}.usdc"])
def test_a_kill_between_the_files_of_a_checkpoint_does_no_harm(name: str, tmp_path):
    folder = stop(SCENE, tmp_path / "out.usdc")
    assert not (folder / name).exists()
    (folder / name).write_bytes(b"not needed")
    assert gone_on(SCENE, tmp_path / "out.usdc") == STOPPED_AT - 1


@pytest.mark.full
def test_nothing_in_a_checkpoint_is_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = stop(SCENE, tmp_path / "out.usdc") / f"state_{STOPPED_AT - 1:06d}_0000.npz"
    plant_spy(path, "points")
    with pytest.raises(InputError, match=rf"{path.name}: cannot be read: "):
        animate(SCENE, tmp_path / "out.usdc", resume=True)
    assert not (tmp_path / "run").exists()


def test_each_file_of_a_checkpoint_appears_whole(tmp_path, monkeypatch):
    whole = watch_names(monkeypatch)
    assert {*stop(SCENE, tmp_path / "out.usdc").iterdir()} <= whole


@pytest.mark.full
def test_checkpoints_go_all_at_once_so_that_a_kill_leaves_nothing_to_resume(tmp_path, monkeypatch):
    output = tmp_path / "out.usdc"
    folder = stop(SCENE, output)
    monkeypatch.setattr(shutil, "rmtree", lambda *_, **__: None)
    animate(SCENE, output, resume=True)
    assert not folder.exists()


def test_a_checkpoint_that_cannot_be_written_ends_the_run_and_harms_nothing(tmp_path):
    output = tmp_path / "out.usdc"
    output.write_bytes(b"good")

    def take_away(frame: int) -> None:
        if frame == STOPPED_AT:
            (tmp_path / "out.usdc.partial").rename(tmp_path / "taken away")  # at once: it is written to meanwhile

    with pytest.raises(InputError, match=r"out\.usdc\.partial/.*: cannot be written: "):
        animate(SCENE, output, checkpoint_seconds=ALWAYS, on_frame=take_away)
    assert output.read_bytes() == b"good"

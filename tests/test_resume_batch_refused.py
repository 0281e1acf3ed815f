"""Refusals to resume a batch from its checkpoints."""

import json
from pathlib import Path

import pytest
from batches import contents, plant_spy, tamper
from meshes import cube
from stopped_batch import scene, stop_after, stop_batch

from balloon_warp import InputError, run_batch
from balloon_warp.scene import Balloon


@pytest.fixture
def stopped(tmp_path) -> Path:
    return stop_batch(tmp_path / "stopped")


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        ({"vary": {"gravity": [1, 8]}}, "vary.gravity.1 is 9.0 there and 8.0 here"),
        ({"world_count": 3, "vary": {"gravity": [1, 9, 9]}}, "vary.gravity is a list of 2 there and a list of 3 here"),
        ({"export": [0]}, "export is a list of 0 there and a list of 1 here"),
        ({"schedule": "gather"}, 'schedules.0 is "lanes" there and "gather" here'),
        ({"scene": scene(frames=9)}, "scene.frames is 6 there and 9 here"),
        ({"scene": scene(balloon=[Balloon(mesh=cube())])}, "meshes."),
    ],
)
def test_another_batch_is_refused(stopped: Path, change: dict, difference: str):
    before = {path: path.read_bytes() for path in stopped.rglob("*") if path.is_file()}
    arguments = {"scene": scene(), "folder": stopped, "world_count": 2, "vary": {"gravity": [1, 9]}} | change
    with pytest.raises(InputError) as refusal:
        run_batch(**arguments, device="cpu", resume=True, on_frame=stop_after(0))
    assert str(refusal.value).startswith(f"--resume: {stopped / 'partial'} belongs to another batch: {difference}")
    assert len(str(refusal.value).splitlines()) == 1
    assert {path: path.read_bytes() for path in stopped.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("versions.warp-lang", "0.1"),
        ("device", "another"),
        ("substeps", 1),
        ("on_blowup", "restart"),
        ("simulated", "in 3 shares"),
    ],
)
def test_what_else_the_bits_depend_on_is_compared(stopped: Path, path: str, value: object):
    """A batch resumes only with the same version, on which its bits depend."""
    tamper(stopped / "partial" / "job.json", path, value)
    with pytest.raises(InputError, match=rf"batch: {path} is {json.dumps(value)} there and .* here; expected the same"):
        run_batch(scene(), stopped, 2, {"gravity": [1, 9]}, device="cpu", resume=True)


@pytest.mark.parametrize("name", ["rows_000001.npz", "state_000002_0000.npz", "job.json"])
def test_a_damaged_checkpoint_is_told(stopped: Path, name: str):
    path = stopped / "partial" / name
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match=rf"{name}: cannot be read: ") as refusal:
        run_batch(scene(), stopped, 2, {"gravity": [1, 9]}, device="cpu", resume=True)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize(("name", "array"), [("rows_000000.npz", "values"), ("state_000002_0000.npz", "points")])
def test_nothing_in_a_checkpoint_is_run(stopped: Path, tmp_path, monkeypatch, name: str, array: str):
    monkeypatch.chdir(tmp_path)
    plant_spy(stopped / "partial" / name, array)
    with pytest.raises(InputError, match=rf"{name}: cannot be read: "):
        run_batch(scene(), stopped, 2, {"gravity": [1, 9]}, device="cpu", resume=True)
    assert not (tmp_path / "run").exists()


def test_a_state_without_its_rows_is_not_gone_on_from(stopped: Path, tmp_path):
    """A state without its rows, as a kill between the two leaves it, is not resumed from."""
    partial = stopped / "partial"
    (partial / "state_000003_0000.npz").write_bytes(b"of a frame whose rows are not there")
    notes: list[str] = []
    run_batch(scene(), stopped, 2, {"gravity": [1, 9]}, device="cpu", resume=True, on_note=notes.append)
    run_batch(scene(), tmp_path / "whole", 2, {"gravity": [1, 9]}, device="cpu")
    assert notes == [f"resuming after frame 2, from {partial}"]
    assert contents(stopped) == contents(tmp_path / "whole")

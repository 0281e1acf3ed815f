"""Resumed batches whose process was killed, terminated, or spread over a cluster: the same files."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batches import NAMES, contents, press_ctrl_c_once
from clusters import start_workers
from meshes import quad_sphere
from pxr import Sdf, Usd

from balloon_warp import Cluster, load_scene, run_batch
from balloon_warp.batch.output import STAGE_NAME
from balloon_warp.farm import cluster as shares
from balloon_warp.mesh.obj import write_obj

LONG = 200
"""frames of a batch that is ended while it simulates"""
WORLDS = 8


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("ball")
    write_obj(folder / "ball.obj", quad_sphere(6))
    return folder


@pytest.fixture(scope="module")
def whole(ball: Path) -> dict[str, bytes]:
    """Return the files of an uninterrupted batch."""
    go_on(ball, ball / "whole", resume=False)
    return contents(ball / "whole")


def go_on(ball: Path, folder: Path, address: str | None = None, **options: Any) -> list[str]:
    """Simulate the batch in this process, or from here on a cluster, and return its message of where it begins."""
    notes: list[str] = []
    scene, vary = load_scene(str(ball / "ball.obj"), [("frames", LONG)]), {"gravity": np.linspace(1, 9, WORLDS)}
    how = {"export": range(WORLDS), "device": "cpu", "schedule": "lanes", "resume": True, **options}
    cluster = Cluster(address) if address else None
    run_batch(scene, folder, WORLDS, vary, cluster=cluster, on_note=notes.append, **how)
    return notes


def end(ball: Path, folder: Path, number: int, *words: str) -> tuple[int, str]:
    """Start the batch as a process, signal it once it has saved something, and return its status and messages."""
    fine = "from balloon_warp.batch import shares; shares.GRAIN['cpu'] = shares.Grain(1, 1); "
    fine += "from balloon_warp.cli import main; main()"
    command = [sys.executable, "-c", fine, "batch", str(ball / "ball.obj"), "-o", str(folder), *words]
    varied = f"--worlds {WORLDS} --vary gravity=1:9 --grid --export all --schedule lanes --set frames={LONG}"
    command, pipe = [*command, *varied.split(), "--checkpoint", "0.01"], subprocess.PIPE
    process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env={**os.environ, "NO_COLOR": "1"})
    try:
        while process.poll() is None and not list(folder.glob("partial/rows_*")):
            time.sleep(0.05)
        process.send_signal(number)
        said = process.communicate(timeout=300)[1]
    finally:
        process.kill()
    first, _, rest = said.partition("\n")
    assert first.startswith("note: ball.obj inflates above a floor. ")
    return process.returncode, rest


def test_a_killed_process_is_gone_on_from(ball: Path, whole: dict[str, bytes], tmp_path):
    assert end(ball, tmp_path / "out", signal.SIGKILL, "--device", "cpu") == (-signal.SIGKILL, "")
    assert contents(tmp_path / "out") == {}
    notes = go_on(ball, tmp_path / "out")
    assert re.fullmatch(r"resuming after frame \d+, from .*out/partial", *notes)
    assert contents(tmp_path / "out") == whole
    assert not (tmp_path / "out" / "partial").exists()


def test_a_process_that_is_told_to_end_finishes_its_frame_and_saves_it(ball: Path, whole: dict[str, bytes], tmp_path):
    status, said = end(ball, tmp_path / "out", signal.SIGTERM, "--device", "cpu")
    assert status == 128 + signal.SIGTERM
    stopped = r"error: ball was interrupted after frame (\d+) of 200"
    advice = r".*out/partial/frames\.usda plays the frames so far, and --resume continues from them"
    assert (found := re.fullmatch(rf"{stopped}; {advice}\n", said)), said
    assert contents(tmp_path / "out") == {}
    assert go_on(ball, tmp_path / "out") == [f"resuming after frame {found[1]}, from {tmp_path / 'out' / 'partial'}"]
    assert contents(tmp_path / "out") == whole


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Yield the address of a scheduler with two workers."""
    with start_workers(2) as workers:
        yield str(workers.scheduler_address)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_cluster_goes_on_without_the_shares_that_are_done(ball, whole, address, tmp_path, monkeypatch, number):
    monkeypatch.setitem(shares.GRAIN, "cpu", shares.Grain(1, 1))
    out = tmp_path / "out"
    if number == signal.SIGKILL:
        end(ball, out, number, "--cluster", address, "--device", "cpu")
    else:
        press = press_ctrl_c_once(lambda frame: frame > LONG / 2)  # at most two shares are between start and end
        plays = r"partial/frames\.usda plays the frames so far, and --resume continues from them$"
        with pytest.raises(KeyboardInterrupt, match=plays):
            go_on(ball, out, address, on_frame=press, checkpoint_seconds=0.0)
    assert contents(out) == {}
    stages = out / "partial/frames.usda", ball / "whole" / STAGE_NAME
    together, expected = (Usd.Stage.Open(str(path)) for path in stages)
    assert together.GetEndTimeCode() == LONG
    done = np.concatenate([np.load(path)["worlds"] for path in out.glob("partial/rows_*")])
    for world in range(WORLDS):
        path = Sdf.Path(f"/World/World_{world}/ball.points")
        found, there = (stage.GetAttributeAtPath(path) for stage in (together, expected))
        assert there.GetNumTimeSamples() == LONG + 1
        assert found.GetNumTimeSamples() == (LONG + 1 if world in done else 0)
        if world in done:
            np.testing.assert_array_equal(found.Get(LONG), there.Get(LONG))
    notes = go_on(ball, out, address)
    assert re.fullmatch(r"resuming with [1-7] of 8 shares done, from .*out/partial", *notes)
    written = contents(out)
    stages = [Sdf.Layer.OpenAsAnonymous(str(folder / STAGE_NAME)).ExportToString() for folder in (out, ball / "whole")]
    assert stages[0] == stages[1]  # sample by sample: the shares came in another order
    assert {name: written[name] for name in NAMES[:4]} == {name: whole[name] for name in NAMES[:4]}
    assert not (out / "partial").exists()

"""Kills runs and batches at random moments, and looks at the remains of the outputs that they were to replace.

    python -m balloon_warp.benchmarks.kills --count 200

A file that a killed process leaves must be, byte by byte, the good one of before or the whole new one. Anything else is
damaged: a part, a mixture, none at all. Checkpoints until then must open, and the resumed process must write the same
bytes as an uninterrupted one; or it is damaged, too.
"""

import argparse
import multiprocessing
import random
import shutil
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from multiprocessing.process import BaseProcess
from pathlib import Path

from pxr import Usd, UsdGeom

from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Scene, load_scene
from balloon_warp.system.warp_setup import quiet_warp

FRAMES_BEFORE, FRAMES = 2, 60
"""of the good output, and of the one that is to replace it"""
LONGER = 1.25
"""times the writing time of an undisturbed process: the last moment of a kill"""
CHECKPOINT_SECONDS = 0.02
"""between two checkpoints: many of the kills come while one is written"""
WORLDS = 8
KINDS = ("run", "batch")
WORD = {
    "kept": "kept the old output",
    "replaced": "had the new one",
    "between": "had some files of each, all whole",
    "resumed": "had saved some frames and went on from there to the same bytes",
}

Files = Mapping[str, bytes | None]
"""contents of an output's files by their names; None where there is no such file"""


def judge(found: Files, before: Files, after: Files) -> str:
    """Return the state of an output: "kept", "replaced", "between" (each file is whole, some are old) or "damaged"."""
    if any(found.get(name) not in (before[name], content) for name, content in after.items()):
        return "damaged"
    if all(found[name] == content for name, content in after.items()):
        return "replaced"
    return "kept" if all(found[name] == content for name, content in before.items()) else "between"


def kill_at_random(kind: str, count: int, folder: Path, seed: int = 0) -> Counter[str]:
    """Start, kill and judge.

    Args:
        kind: "run" or "batch".
        count: how many processes are killed.
        folder: where they work.
        seed: of the moments, which are uniform over the time in which a process writes.

    Returns:
        how many outputs were "kept", "replaced", "between" or "damaged", and how many of those were "resumed".
    """
    write_obj(folder / "ball.obj", quad_sphere(6, 1.0))
    output = folder / kind
    output.mkdir()
    before = _written(kind, output, FRAMES_BEFORE)
    seconds = LONGER * statistics.median(_seconds_to_write(kind, output) for _ in range(3))
    after = _read(output, before)
    assert all(after[name] != content for name, content in before.items())
    moments, outcomes = random.Random(seed), Counter[str]()
    for _ in range(count):
        for name, content in before.items():
            (output / name).write_bytes(content or b"")
        process = _start_to_write(kind, output)
        time.sleep(moments.uniform(0.0, seconds))
        process.kill()
        process.join()
        outcome = judge(_read(output, before), before, after)
        saved = _saved(kind, output)
        if saved and outcome != "damaged":
            outcomes["resumed"] += 1
        if saved and not _goes_on(kind, output, after):
            outcome = "damaged"
        outcomes[outcome] += 1
        for left in output.glob(".*.partial*"):
            shutil.rmtree(left) if left.is_dir() else left.unlink()
    return outcomes


def _saved(kind: str, output: Path) -> bool:
    """Return whether there is a checkpoint."""
    return any(any(folder.glob("state_*.npz" if kind == "run" else "rows_*.npz")) for folder in _partial(output))


def _partial(output: Path) -> list[Path]:
    """Return the folder of an unfinished run, if there is one; not one that was being removed."""
    return [path for path in output.glob("*partial") if path.is_dir() and not path.name.startswith(".")]


def _plays(stage: Path) -> bool:
    """Return whether a stage opens and has the frames that it claims."""
    opened = Usd.Stage.Open(str(stage))
    meshes = [mesh for prim in opened.Traverse() if (mesh := UsdGeom.Mesh(prim))]
    moving = [mesh.GetPointsAttr() for mesh in meshes if mesh.GetVelocitiesAttr().GetNumTimeSamples()]
    ends = opened.GetStartTimeCode(), opened.GetEndTimeCode()
    return bool(moving) and all(points.Get(end) for points in moving for end in ends)


def _goes_on(kind: str, output: Path, after: Files) -> bool:
    """Return whether saved frames play, and resuming leads to the output."""
    stages = [path for folder in _partial(output) for path in folder.glob("[!.]*.usd*") if path.name != "still.usdc"]
    if not all(map(_plays, stages)):
        return False
    process = _start(kind, output, FRAMES, resume=True)
    process.join()
    return process.exitcode == 0 and _read(output, after) == after


def _written(kind: str, output: Path, frames: int) -> dict[str, bytes | None]:
    """Return the output of an undisturbed process."""
    process = _start(kind, output, frames)
    process.join()
    assert process.exitcode == 0
    return {path.name: path.read_bytes() for path in output.iterdir()}


def _seconds_to_write(kind: str, output: Path) -> float:
    """Return the seconds from the first touch to the end of an undisturbed process."""
    process = _start_to_write(kind, output)
    began = time.monotonic()
    process.join()
    assert process.exitcode == 0
    return time.monotonic() - began


def _start(kind: str, output: Path, frames: int, resume: bool = False) -> BaseProcess:
    server = multiprocessing.get_context("forkserver")  # loads common modules once
    server.set_forkserver_preload(["balloon_warp.run.job", "balloon_warp.batch.batch"])
    process = server.Process(target=_write, args=(kind, output, frames, resume))
    process.start()
    return process


def _write(kind: str, output: Path, frames: int, resume: bool) -> None:
    """Write the output, in the process that is killed."""
    quiet_warp()
    scene: Scene = load_scene(output.parent / "ball.obj", [("frames", frames)])
    often = CHECKPOINT_SECONDS if frames == FRAMES else 0.0
    if kind == "run":
        from balloon_warp.studio.animate import animate

        stage = output / "ball.usdc"
        animate(scene, stage, device="cpu", schedule="gather", checkpoint_seconds=often, resume=resume)
    else:
        from balloon_warp.batch.batch import run_batch

        vary = {"gravity": [0.5 * world for world in range(WORLDS)]}
        how = {"export": [0, 3], "device": "cpu", "schedule": "lanes"}
        run_batch(scene, output, WORLDS, vary, **how, checkpoint_seconds=often, resume=resume)


def _start_to_write(kind: str, output: Path) -> BaseProcess:
    """Return a process that has just touched its folder, or a file in it."""
    before = _touched(output)
    process = _start(kind, output, FRAMES)
    while process.is_alive() and _touched(output) == before:
        time.sleep(0.001)
    return process


def _touched(output: Path) -> list[int]:
    return [path.stat().st_mtime_ns for path in (output, *sorted(output.glob("[!.]*")))]


def _read(output: Path, like: Files) -> dict[str, bytes | None]:
    return {name: (output / name).read_bytes() if (output / name).is_file() else None for name in like}


def main() -> None:
    """Print the number of outputs by outcome; status 1 where one is damaged."""
    parser = argparse.ArgumentParser(description="Kill runs and batches at random moments, and look at what is left.")
    parser.add_argument("--count", type=int, default=200, help="processes to kill, half of them batches")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    arguments = parser.parse_args()
    damaged = 0
    for number, kind in enumerate(KINDS):
        count = (arguments.count + number) // len(KINDS)
        with tempfile.TemporaryDirectory() as folder:
            outcomes = kill_at_random(kind, count, Path(folder), arguments.seed)
        damaged += outcomes["damaged"]
        shares = ", ".join(f"{outcomes[outcome]} {words}" for outcome, words in WORD.items())
        print(f"{kind}: {count} killed, {shares}; {outcomes['damaged']} damaged", flush=True)
    sys.exit(1 if damaged else 0)


if __name__ == "__main__":
    main()

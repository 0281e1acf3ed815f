"""Outputs that cannot be written to the end: earlier good ones stay, and a sentence gives the reason."""

import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from meshes import quad_sphere

from balloon_warp.errors import InputError
from balloon_warp.job import animate
from balloon_warp.mesh.obj import write_obj
from balloon_warp.outputs.render import render_stage
from balloon_warp.scene import Scene, load_scene
from balloon_warp.sweep.batch import run_batch

LIMIT = 16_384
"""bytes of a file: less than each output takes, more than its beginning"""
WORLDS = 40


@pytest.fixture
def scene(tmp_path) -> Scene:
    write_obj(tmp_path / "ball.obj", quad_sphere(6))
    return load_scene(tmp_path / "ball.obj", [("frames", 12)])


@contextmanager
def files_limited_to(size: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def write(kind: str, scene: Scene, folder: Path, on_frame: Callable[[int], None] = lambda number: None) -> None:
    match kind:
        case "table":
            run_batch(scene, folder / "batch", WORLDS, device="cpu", on_frame=on_frame)
        case "worlds":
            run_batch(scene, folder / "batch", 4, export=range(4), device="cpu", on_frame=on_frame)
        case "picture":
            render_stage(folder / "ball.usdc", folder / "ball.png", 0, (320, 180), 1, device="cpu")
        case "mesh":
            write_obj(folder / "mesh.obj", quad_sphere(scene.frames))
        case suffix:
            animate(scene, folder / f"ball{suffix}", device="cpu", on_frame=on_frame)


@pytest.mark.parametrize("kind", [".usdc", ".usda", "table", "worlds", "picture", "mesh"])
def test_a_file_that_reaches_a_limit_leaves_the_good_one(kind: str, scene: Scene, tmp_path):
    if kind == "picture":
        write(".usdc", scene, tmp_path)
    write(kind, scene, tmp_path)
    good = contents(tmp_path)
    longer = scene.model_copy(update={"frames": 14})
    with files_limited_to(LIMIT), pytest.raises(InputError, match="cannot be written: ") as refusal:
        write(kind, longer, tmp_path)
    assert len(str(refusal.value).splitlines()) == 1
    assert contents(tmp_path) == good


@pytest.mark.parametrize("kind", [".usdc", "table", "worlds"])
def test_a_folder_that_vanishes_is_told(kind: str, scene: Scene, tmp_path):
    folder = tmp_path / "gone"
    folder.mkdir()

    def vanish(number: int) -> None:
        if number == 5:
            shutil.rmtree(folder)

    with pytest.raises(InputError, match="cannot be written: ") as refusal:
        write(kind, scene, folder, on_frame=vanish)
    assert len(str(refusal.value).splitlines()) == 1
    assert contents(folder) == {}  # USD makes the folder anew, and leaves it empty


def test_a_folder_that_takes_no_files_is_told_before_the_run(scene: Scene):
    """A folder of the kernel's is refused before the run: not even the superuser may write to it."""
    frames = []
    for write_there in (
        lambda: animate(scene, "/proc/self/ball.usdc", device="cpu", on_frame=frames.append),
        lambda: run_batch(scene, "/proc/self/fdinfo", 2, device="cpu", on_frame=frames.append),
    ):
        with pytest.raises(InputError, match="cannot be written: "):
            write_there()
    assert frames == []


FULL_DISK = """
set -e
mkdir disk
mount -t tmpfs -o size=128k none disk
cp good.usdc disk/ball.usdc
if "$0" -m balloon_warp run ball.obj --set frames=60 -o disk/ball.usdc --device cpu; then exit 9; else status=$?; fi
cmp good.usdc disk/ball.usdc
test "$(ls -A disk)" = ball.usdc
exit $status
"""


@pytest.mark.full
def test_a_full_disk_leaves_the_good_file(scene: Scene, tmp_path):
    """A full disk of 128 KiB leaves the good file, where the system allows a mount."""
    names = ["unshare", "-rm"]
    if shutil.which("unshare") is None or subprocess.run([*names, "mount", "-t", "tmpfs", "none", "/mnt"]).returncode:
        pytest.skip("needs a mount namespace")
    animate(scene.model_copy(update={"frames": 2}), tmp_path / "good.usdc", device="cpu")
    done = subprocess.run(
        [*names, "sh", "-c", FULL_DISK, sys.executable],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "NO_COLOR": "1"},
    )
    assert done.returncode == 2, done.stderr
    first, swells, last = done.stderr.splitlines()
    assert first.startswith("note: ball.obj inflates above a floor. ")
    assert swells.startswith("note: auto pressure ")
    assert last.startswith("error: disk/ball.usdc: cannot be written: ")

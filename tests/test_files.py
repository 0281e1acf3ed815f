"""Files that appear whole or not at all, without room, and after a kill."""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import pytest
from batches import files_limited_to, stop_after
from commands import contents
from meshes import cube, quad_sphere

from balloon_warp import InputError, animate, export_stage, render_stage, run_batch
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Scene, load_scene
from balloon_warp.system import files
from balloon_warp.system.warp_setup import quiet_warp


def write_text(path: Path) -> None:
    with files.whole_file(path) as temporary:
        temporary.write_text("new")


def write_arrays(path: Path) -> None:
    with files.whole_file(path) as temporary:
        files.write_npz(temporary, [("place", cube().points)])


@pytest.mark.parametrize("write", [write_text, write_arrays, lambda path: write_obj(path, cube())])
def test_a_file_is_on_the_disk_before_it_has_its_name_and_its_name_follows(write, tmp_path, monkeypatch):
    """A file is flushed to disk before its rename, and its folder after: otherwise a crash of the machine, which no
    test can have, leaves an empty file in the place of a good one."""
    (place := tmp_path / "place").mkdir()
    path = place / "file"
    path.write_text("good")
    happened: list[tuple[str, int, int]] = []
    flush, replace = os.fsync, os.replace

    def watch_flush(descriptor: int) -> None:
        flush(descriptor)
        happened.append(("on the disk", os.fstat(descriptor).st_ino, os.fstat(descriptor).st_size))

    def watch_replace(source: Path, target: Path) -> None:
        assert path.read_text() == "good"
        happened.append(("named", source.stat().st_ino, source.stat().st_size))
        replace(source, target)

    monkeypatch.setattr(os, "fsync", watch_flush)
    monkeypatch.setattr(os, "replace", watch_replace)
    write(path)
    file = path.stat().st_ino, path.stat().st_size
    assert happened[:2] == [("on the disk", *file), ("named", *file)]
    assert [each[:2] for each in happened[2:]] == [("on the disk", place.stat().st_ino)]
    assert list(place.iterdir()) == [path]


SCENE = Scene(balloon=[Balloon(mesh=cube(), name="box")], frames=6)
BEGIN = """
import sys, time
from contextlib import ExitStack
from pathlib import Path
from balloon_warp.system.files import folder_beside, whole_file
from balloon_warp.system.files import scratch_folder
path = Path(sys.argv[1])
with ExitStack() as files:
    one = files.enter_context(whole_file(path))
    one.write_text("part")
    one.with_name(one.name + ".Xy12ab").write_text("as USD has it beside the file that it saves")
    (files.enter_context(folder_beside(path)) / "frames.usdc").write_text("part")
    (files.enter_context(scratch_folder()) / "frame.usdc").write_text("part")
    print("begun", flush=True)
    time.sleep(600)
"""
"""program that has all kinds of temporaries, until it is killed"""


@pytest.fixture(autouse=True)
def system_folder(tmp_path, monkeypatch) -> Path:
    """Return a temporary folder in place of /tmp."""
    (folder := tmp_path / "system").mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return folder


def begin_python(*words: str | Path, **environment: str) -> subprocess.Popen:
    """Start Python, and wait until it has printed that it has begun."""
    around = {**os.environ, **environment}
    process = subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, env=around)
    assert process.stdout
    assert process.stdout.readline() == b"begun\n"
    return process


def begin(path: Path) -> subprocess.Popen:
    return begin_python("-c", BEGIN, path)


def kill(process: subprocess.Popen) -> None:
    process.kill()
    process.communicate()


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_what_a_killed_process_left_goes_and_what_a_living_one_has_stays(tmp_path, system_folder: Path):
    (place := tmp_path / "place").mkdir()
    (place / ".mine").write_text("not ours")
    killed, living = begin(place / "out.usdc"), begin(place / "out.usdc")
    try:
        both = names(place), names(system_folder)
        kill(killed)
        assert (names(place), names(system_folder)) == both
        files.check_writable(place / "other.usdc", (".usdc",))
        with files.scratch_folder():
            pass
        left = names(place), names(system_folder)
        assert [2 * len(kinds) for kinds in left] == [len(both[0]) + 1, len(both[1])]
    finally:
        kill(living)
    files.check_writable(place / "other.usdc", (".usdc",))
    with files.scratch_folder():
        pass
    assert names(place) == [".mine"]
    assert names(system_folder) == []


def test_another_thread_or_file_of_the_same_process_is_a_living_one(tmp_path):
    with files.whole_file(tmp_path / "a.txt") as one, files.folder_beside(tmp_path / "a.txt") as other:
        one.write_text("part")
        files.clear_left_over(tmp_path)
        assert one.read_text() == "part"
        assert other.is_dir()
    assert names(tmp_path) == ["a.txt", "system"]


LIMIT = 16_384  # bytes of a file: less than each output takes, more than its beginning
WRITERS: dict[str, Callable[..., object]] = {
    **{
        suffix: lambda scene, place, suffix=suffix, **how: animate(scene, place / f"ball{suffix}", device="cpu", **how)
        for suffix in (".usdc", ".usda", ".glb")
    },
    "table": lambda scene, place, **how: run_batch(scene, place, 40, device="cpu", **how),
    "worlds": lambda scene, place, **how: run_batch(scene, place, 4, export=range(4), device="cpu", **how),
    "convert": lambda scene, place: export_stage(place / "ball.usdc", place / "out.usdz"),
    "picture": lambda scene, place: render_stage(place / "ball.usdc", place / "a.png", 0, (320, 180), 1, device="cpu"),
    "mesh": lambda scene, place: write_obj(place / "mesh.obj", quad_sphere(scene.frames)),
    "checkpoints": lambda scene, place: animate(scene, place / "a.usdc", device="cpu", checkpoint_seconds=1e-9),
}
"""What writes a kind of file to a place"""


@pytest.mark.full
@pytest.mark.parametrize("kind", [".usdc", ".glb", "table", "convert", "checkpoints"])
def test_the_next_that_writes_there_clears_it_away(kind: str, tmp_path):
    (place := tmp_path / "place").mkdir()
    WRITERS[".usdc"](SCENE, place)
    kill(begin(place / "out.usdc"))
    kill(begin(place / "ball.usdc"))
    assert len(names(place)) > 2
    WRITERS[kind](SCENE, place)
    assert [name for name in names(place) if "partial" in name] == []


@pytest.mark.full
@pytest.mark.parametrize("left", ["nothing yet", "no checkpoint", "a checkpoint"])
def test_a_folder_of_checkpoints_stays_only_if_it_has_one(left: str, tmp_path):
    folder = tmp_path / "out.usdc.partial"
    if left == "nothing yet":
        folder.mkdir()
    else:
        with pytest.raises(RuntimeError):
            animate(SCENE, tmp_path / "out.usdc", device="cpu", checkpoint_seconds=1e-9, on_frame=stop_after(3))
    if left == "no checkpoint":
        for rows in folder.glob("rows_*"):
            rows.unlink()
    kill(begin(folder / "state_000009_0000.npz"))
    animate(SCENE, tmp_path / "out.usdc", device="cpu", checkpoint_seconds=0.0)
    assert folder.exists() == (left == "a checkpoint")
    if folder.exists():
        assert [name for name in names(folder) if name.startswith(".")] == []
        assert animate(SCENE, tmp_path / "out.usdc", device="cpu", resume=True).begin == 2


@pytest.mark.full
def test_a_folder_that_a_living_run_has_begun_stays(tmp_path):
    begun = """
import sys, time
from pathlib import Path
from balloon_warp.run.checkpoints import PartialFolder
PartialFolder(folder := Path(sys.argv[1])).begin({}); kept = PartialFolder(folder); kept.go_on()
print("begun", flush=True)
time.sleep(600)
"""
    folder = tmp_path / "out.usdc.partial"
    process = begin_python("-c", begun, folder)
    try:
        animate(SCENE, tmp_path / "out.usdc", device="cpu")
        assert folder.is_dir()
    finally:
        kill(process)
    animate(SCENE, tmp_path / "out.usdc", device="cpu")
    assert names(tmp_path) == ["out.usdc", "system"]


def test_without_locks_only_what_is_old_goes(tmp_path, monkeypatch):
    kill(begin(tmp_path / "out.usdc"))
    monkeypatch.setattr(files, "fcntl", None)
    left = names(tmp_path)
    files.clear_left_over(tmp_path)
    assert names(tmp_path) == left
    with files.whole_file(tmp_path / "fine.txt") as path:
        path.write_text("whole")
    assert names(tmp_path) == sorted([*left, "fine.txt"])
    yesterday = time.time() - 2.0 * files.OLD_SECONDS
    for path in tmp_path.rglob("*"):
        os.utime(path, (yesterday, yesterday))
    files.clear_left_over(tmp_path)
    assert names(tmp_path) == ["fine.txt", "system"]


def test_a_lock_that_is_cleared_away_before_it_is_held_is_made_again(tmp_path, monkeypatch):
    held, taken = files._is_held_elsewhere, []

    def come_between(descriptor: int) -> bool:
        if not taken:
            taken.append(descriptor)
            files.clear_left_over(tmp_path)
        return held(descriptor)

    monkeypatch.setattr(files, "_is_held_elsewhere", come_between)
    with files.temporary_in(tmp_path) as path:
        locks = [name for name in names(tmp_path) if name.endswith(".lock")]
        assert locks == [f"{path.name}.lock"]


@pytest.mark.full
def test_headers_that_warp_compiles_go_with_a_kill(tmp_path, system_folder: Path):
    compile_one = """
import time
import warp as wp
from balloon_warp.system.warp_setup import quiet_warp
quiet_warp()
@wp.kernel(module="unique")
def one(a: wp.array(dtype=float)):
    a[wp.tid()] = 1.2345678
wp.launch(one, 1, [wp.zeros(1, device="cpu")], device="cpu")
print("begun", flush=True)
time.sleep(600)
"""
    (script := tmp_path / "compile.py").write_text(compile_one)
    process = begin_python(script, WARP_CACHE_PATH=str(tmp_path / "cache"))
    headers = list(system_folder.rglob("*.pch"))
    kill(process)
    assert headers
    quiet_warp.cache_clear()
    quiet_warp()
    assert names(system_folder) == []


@pytest.fixture
def scene(tmp_path) -> Scene:
    write_obj(tmp_path / "ball.obj", quad_sphere(6))
    return load_scene(tmp_path / "ball.obj", [("frames", 12)])


@pytest.mark.full
@pytest.mark.parametrize("kind", [".usdc", ".usda", "table", "worlds", "picture", "mesh"])
def test_a_file_that_reaches_a_limit_leaves_the_good_one(kind: str, scene: Scene, tmp_path):
    if kind == "picture":
        WRITERS[".usdc"](scene, tmp_path)
    WRITERS[kind](scene, tmp_path)
    good = contents(tmp_path)
    longer = scene.model_copy(update={"frames": 14})
    with files_limited_to(LIMIT), pytest.raises(InputError, match=r"\A.*cannot be written: .*\Z"):
        WRITERS[kind](longer, tmp_path)
    assert contents(tmp_path) == good


@pytest.mark.full
@pytest.mark.parametrize("kind", [".usdc", "table", "worlds"])
def test_a_folder_that_vanishes_is_told(kind: str, scene: Scene, tmp_path):
    (folder := tmp_path / "gone").mkdir()

    def vanish(number: int) -> None:
        if number == 5:
            shutil.rmtree(folder)

    with pytest.raises(InputError, match=r"\A.*cannot be written: .*\Z"):
        WRITERS[kind](scene, folder, on_frame=vanish)
    assert contents(folder) == {}  # USD makes the folder anew, and leaves it empty


def test_a_folder_that_takes_no_files_is_told_before_the_run(scene: Scene, tmp_path):
    """A folder of the kernel's is refused before the run: not even the superuser may write to it."""
    how = {"device": "cpu", "on_frame": Mock(side_effect=AssertionError("is not to be called"))}
    animate(scene.model_copy(update={"frames": 1}), tmp_path / "ball.usdc", device="cpu")
    with pytest.raises(InputError, match="cannot be written: "):
        animate(scene, "/proc/self/ball.usdc", **how)
    with pytest.raises(InputError, match="cannot be written: "):
        run_batch(scene, "/proc/self/fdinfo", 2, **how)
    with pytest.raises(InputError, match="cannot be written: "):
        render_stage(tmp_path / "ball.usdc", "/proc/a.png", **how)


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
    names = ["unshare", "-rm"]
    if shutil.which("unshare") is None or subprocess.run([*names, "mount", "-t", "tmpfs", "none", "/mnt"]).returncode:
        pytest.skip("needs a mount namespace")
    animate(scene.model_copy(update={"frames": 2}), tmp_path / "good.usdc", device="cpu")
    command, plain = [*names, "sh", "-c", FULL_DISK, sys.executable], {**os.environ, "NO_COLOR": "1"}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, env=plain)
    assert done.returncode == 2, done.stderr
    first, *_coarse, swells, last = done.stderr.splitlines()
    assert first.startswith("note: ball.obj inflates above a floor. ")
    assert swells.startswith("note: auto pressure ")
    assert last.startswith("error: disk/ball.usdc: cannot be written: ")

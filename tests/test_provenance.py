"""Provenance in stages and manifests, whose place an output may take, interrupts, and files of a release."""

import csv
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
import warp as wp
import yaml
from commands import contents, status_of
from meshes import cube, quad_sphere
from painted import atlas, write_obj_cube, write_painted
from PIL import Image
from pxr import Sdf, Usd

from balloon_warp import Balloon, Cluster, InputError, Scene, animate, design, repeat_batch, run_batch
from balloon_warp.farm.workers import begin_children, start_child, worker_environments
from balloon_warp.lab.fit.fit import Journal
from balloon_warp.mesh.obj import write_obj
from balloon_warp.run import report
from balloon_warp.run.checkpoints import Background
from balloon_warp.run.report import hash_of_file
from balloon_warp.scene import Material, Obstacle, load_scene
from balloon_warp.scene.load import write_scene
from balloon_warp.studio import render
from balloon_warp.studio.animate import RequestedOutputs
from balloon_warp.studio.render.render import Film
from balloon_warp.system.files import is_ours, replacing_any, sole_writer
from balloon_warp.system.process import Interrupts

SCENE = """
frames = 2
[[balloon]]
mesh = "ball.obj"
"""
COMMAND = ["balloon-warp", "run", "ball.toml", "--set", "balloon.mass=0.5", "--set", "balloon.name='a b'"]
COMMAND += ["--device", "cpu"]


def stage(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, *more: str) -> Any:
    """Return the command's JSON, from a folder with its files in it."""
    folder.mkdir(exist_ok=True)
    (folder / "ball.toml").write_text(SCENE)
    write_obj(folder / "ball.obj", quad_sphere(2))
    monkeypatch.chdir(folder)
    assert status_of(*COMMAND[1:], "--json", *more) == 0
    return json.loads(capsys.readouterr().out)


def test_a_stage_says_what_it_takes_to_make_it_again(tmp_path, monkeypatch, capsys):
    summary = stage(tmp_path, monkeypatch, capsys, "-o", "ball.usda")
    opened = Usd.Stage.Open(summary["output"])
    said = opened.GetRootLayer().customLayerData["balloonWarp"]
    assert said["command"] == (
        """balloon-warp run ball.toml --set balloon.mass=0.5 --set 'balloon.name='"'"'a b'"'"'' --device cpu"""
    )
    assert said["versions"]["warp-lang"] == metadata.version("warp-lang")
    assert said["files"] == {"balloon.0.mesh": hashlib.sha256((tmp_path / "ball.obj").read_bytes()).hexdigest()}
    taken = said["device"], said["schedule"], said["substeps"]
    assert taken == ("cpu", summary["schedule"], summary["substeps"])
    scene = Scene.model_validate_json(said["scene"])
    assert (scene.frames, scene.balloon[0].mesh, scene.balloon[0].mass) == (2, Path("ball.obj"), 0.5)


def test_where_the_files_are_is_not_in_the_bytes(tmp_path, monkeypatch, capsys):
    first = stage(tmp_path / "here", monkeypatch, capsys, "-o", "one.usdc")
    bytes_here = (tmp_path / "here" / first["output"]).read_bytes()
    stage(tmp_path / "there", monkeypatch, capsys, "--output", "../two.usdc", "--checkpoint", "9", "--resume")
    assert (tmp_path / "two.usdc").read_bytes() == bytes_here
    stage(tmp_path / "there", monkeypatch, capsys, "-o", "../three.usdc", "--set", "frames=3")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "three.usdc"))
    assert layer.customLayerData["balloonWarp"]["command"].endswith("--set frames=3 --device cpu")


def test_a_scene_without_folders_names_its_files_alone():
    files = {name: Path(f"/home/me/{name}") for name in ("ball.obj", "print.png", "springs.npz", "mould.obj")}
    rubber = Material(kind="neo_hookean", shear_modulus=1e5, thickness=1e-4, rest_mesh=files["mould.obj"])
    balloons = [
        Balloon(mesh=files["ball.obj"], print=files["print.png"], material=rubber),
        Balloon(mesh=files["ball.obj"], springs=files["springs.npz"]),
    ]
    described = report.without_folders({"scene": report.describe_scene(Scene(balloon=balloons)), "files": {}})
    assert "home" not in json.dumps(described)
    assert all(name in json.dumps(described["scene"]) for name in files)
    assert report.named_files(described["scene"]).keys() == {
        *("balloon.0.mesh", "balloon.0.print", "balloon.0.material.rest_mesh", "balloon.1.mesh", "balloon.1.springs")
    }


@pytest.mark.parametrize(
    ("word", "left"),
    [
        ("/home/me/my scene.toml", "my scene.toml"),
        ("balloon.mesh=/home/me/a.obj,/b.obj,c.obj", "balloon.mesh=a.obj,b.obj,c.obj"),
        ("~/a.obj", "a.obj"),
        ("balloon.name='a b'", "balloon.name='a b'"),
    ],
)
def test_a_command_without_folders_has_no_absolute_path(word: str, left: str):
    assert report.command_without_folders([word]) == [left]


BATCH_SCENE = """
faces = false
frames = 3
[[balloon]]
mesh = "ball.obj"
[balloon.inflation]
k_normal = 0.2
[[sphere]]
position = [0, 3, 0]
"""
BATCH_COMMAND = ["balloon-warp", "batch", "ball.toml", "--worlds", "9", "--seed", "5", "--export", "2,8", "-o", "first"]
BATCH_COMMAND += ["--device", "cpu", "--vary", "balloon.inflation.k_normal=0:8"]
BATCH_COMMAND += ["--vary", "balloon.mesh=ball.obj,other.obj"]


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """Return a folder where the command has just simulated a batch, into `first`."""
    (tmp_path / "ball.toml").write_text(BATCH_SCENE)
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    write_obj(tmp_path / "other.obj", quad_sphere(3))
    monkeypatch.chdir(tmp_path)
    assert status_of(*BATCH_COMMAND[1:]) == 0
    return tmp_path


def manifest(folder: Path) -> dict:
    return json.loads((folder / "manifest.json").read_text())


def test_it_says_what_was_simulated_and_its_hashes_are_those_of_the_files(folder: Path):
    said = manifest(folder / "first")
    assert (said["command"], said["seed"]) == (BATCH_COMMAND, 5)
    assert (said["worlds"], said["export"], said["device"], said["schedule"]) == (9, [2, 8], "cpu", "lanes")
    assert said["versions"]["warp-lang"] == metadata.version("warp-lang")
    assert said["scene"]["gravity"] == 9.81
    assert len(set(said["vary"]["balloon.inflation.k_normal"])) == 9
    assert set(said["outputs"]) == {"table.npz", "table.csv", "worlds.npz", "worlds.csv", "worlds.usdc"}
    for name, expected in said["outputs"].items():
        assert hash_of_file(folder / "first" / name) == expected
    assert said["files"] == {"balloon.0.mesh": hash_of_file(folder / "ball.obj")}
    hashes = {name: hash_of_file(folder / name) for name in ("ball.obj", "other.obj")}
    assert said["vary"]["balloon.mesh.sha256"] == [hashes[name] for name in said["vary"]["balloon.mesh"]]


def test_no_file_of_a_batch_tells_where_it_was_made(tmp_path, monkeypatch):
    """Absolute paths of the scene, of meshes that vary, of prints and of outputs: names and hashes, the same bytes."""
    made: list[dict[str, Any]] = []
    for home in (tmp_path / "at home", tmp_path / "elsewhere"):
        home.mkdir()
        for name, sides in (("ball", 2), ("other", 3)):
            write_obj(home / f"{name}.obj", quad_sphere(sides))
        write_obj(home / "tile.obj", cube())
        tile = f'[[obstacle]]\nmesh = "{home}/tile.obj"\nposition = [0, -9, 0]\n'
        (home / "ball.toml").write_text(BATCH_SCENE.replace('"ball.obj"', f'"{home}/ball.obj"') + tile)
        varied = ["--vary", f"balloon.mesh={home}/ball.obj,{home}/other.obj"]
        batch = ["batch", str(home / "ball.toml"), "--worlds", "2", "--export", "all", "--device", "cpu", *varied]
        monkeypatch.chdir(home)
        assert status_of(*batch, "-o", str(home / "out"), "--trajectories", str(home / "data"), "--format", "npz") == 0
        files = [path for name in ("out", "data") for path in sorted((home / name).rglob("*")) if path.is_file()]
        made.append({str(path.relative_to(home)): path.read_bytes() for path in files})
        stage = Sdf.Layer.FindOrOpen(str(home / "out" / "worlds.usdc")).ExportToString()
        assert not any(str(tmp_path) in text for text in (stage, *map(str, made[-1].values())))
    assert made[0] == made[1]
    with (tmp_path / "at home" / "out" / "worlds.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            assert row["balloon.mesh"] in ("ball.obj", "other.obj")
            assert row["balloon.mesh.sha256"] == hash_of_file(tmp_path / "at home" / row["balloon.mesh"])
    said = manifest(tmp_path / "at home" / "out")
    assert said["files"]["obstacle.0.mesh"] == hash_of_file(tmp_path / "elsewhere" / "tile.obj")
    assert {"balloon.mesh.sha256", "balloon.mesh"} <= said["columns"].keys()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "at home" / "out").rename(tmp_path / "out")
    summary = repeat_batch(tmp_path / "out" / "manifest.json", tmp_path / "again", files=tmp_path / "elsewhere")
    assert manifest(tmp_path / "again")["outputs"] == said["outputs"]
    assert str(tmp_path) not in Path(summary.manifest).read_text()
    (tmp_path / "elsewhere" / "tile.obj").write_bytes(b"other")
    with pytest.raises(InputError, match=r"tile\.obj: has changed since the batch"):
        repeat_batch(tmp_path / "out" / "manifest.json", tmp_path / "again", files=tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"its file ball\.obj is missing; expected it in this folder, or another as"):
        repeat_batch(tmp_path / "out" / "manifest.json", tmp_path / "again")


def test_its_command_has_the_same_hashes_and_other_values_have_others(folder: Path):
    said = manifest(folder / "first")
    (folder / "first").rename(folder / "moved")
    assert status_of(*said["command"][1:]) == 0
    assert manifest(folder / "first") == said
    said["vary"]["balloon.inflation.k_normal"][7] += 0.1
    (folder / "changed.json").write_text(json.dumps(said))
    repeat_batch(folder / "changed.json", folder / "again")
    assert all(
        manifest(folder / "again")["outputs"][name] != said["outputs"][name] for name in ("table.npz", "table.csv")
    )


def test_what_cannot_be_repeated_is_told(folder: Path):
    path, others = folder / "first" / "manifest.json", folder / "other.obj"
    for file, text, complaint in (
        (others, "v 0 0 0\n", r"other\.obj: has changed since the batch: its SHA-256 is "),
        *((path, text, "manifest") for text in ("[]", "{}", "{", "\x00")),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=complaint):
            repeat_batch(path, folder / "again")
    assert not (folder / "again").exists()


def test_a_mesh_from_python_is_named_and_hashed(tmp_path):
    hashes = []
    for cells in (2, 2, 3):
        run_batch(Scene(frames=1, balloon=[Balloon(mesh=quad_sphere(cells))]), tmp_path / "out", 2, device="cpu")
        hashes += manifest(tmp_path / "out")["files"].values()
    assert hashes[0] == hashes[1] != hashes[2]
    with pytest.raises(InputError, match="is missing; expected it"):
        repeat_batch(tmp_path / "out" / "manifest.json", tmp_path / "again")


BOX = Scene(balloon=[Balloon(mesh=cube(), name="box")], frames=1)
RUN, COMPARE = "run box.obj --frames 1 --device cpu", "compare box.obj --vary balloon.mass=1,2 --frames 1 --device cpu"
BATCH = "batch box.obj --worlds 2 --frames 1 --device cpu"
DATA = "--trajectories data --format npz"


@pytest.fixture(scope="module")
def made_stage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    animate(BOX, path := tmp_path_factory.mktemp("stage") / "film.usdc", device="cpu")
    return path


@pytest.fixture
def own_folder(tmp_path: Path, made_stage: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working folder: a mesh without a texture, one with it, and a stage. Pictures are small."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "balloon_warp.studio.render.render.Film", lambda size, samples, *others: Film((64, 36), 1, *others)
    )
    write_obj(tmp_path / "box.obj", cube())
    write_painted(tmp_path, "obj")
    (tmp_path / "film.usdc").write_bytes(made_stage.read_bytes())
    return tmp_path


@pytest.mark.parametrize(
    ("words", "mine"),
    [
        pytest.param(RUN, "box.usdc", id="run"),
        pytest.param(f"{RUN} --picture", "box.png", id="its picture"),
        pytest.param(f"{RUN} -o f.####.obj", "f.0001.obj", id="a frame, .obj"),
        pytest.param(f"{RUN} -o f.pvd", "f.0001.vtu", id="a frame, .vtu"),
        pytest.param("render film.usdc --device cpu", "film.png", id="render"),
        pytest.param(COMPARE, "box_compare.png", id="compare"),
        pytest.param(BATCH, "box_batch/table.csv", id="batch"),
        pytest.param(f"{BATCH} --table csv", "box_batch/table.parquet", id="a table of the kind that goes"),
        pytest.param(f"{BATCH} {DATA}", "data/train/world_000000.npz", id="trajectories"),
        pytest.param("scenes squirrel_tether -o mine.toml", "mine.toml", id="scenes"),
        pytest.param("scenes squirrel_tether -o mine.toml", "squirrel.obj", id="a mesh beside a scene"),
        pytest.param("foil I -o i.toml", "i.toml", id="a scene of foil"),
        pytest.param("foil I -o i.obj --apart", "i_1.obj", id="a part of foil"),
        pytest.param("design box.obj -o d --steps 0 --device cpu", "d/error.png", id="design"),
        pytest.param("remesh cube.obj -o q.obj --cells 6", "q.mtl", id="materials of a mesh"),
    ],
)
def test_what_the_program_did_not_make_stays(words: str, mine: str, own_folder: Path, capfd) -> None:
    (own_folder / mine).parent.mkdir(parents=True, exist_ok=True)
    (own_folder / mine).write_text("MINE\n")
    before = contents(own_folder)
    assert status_of(*words.split()) == 2
    said = [line for line in capfd.readouterr().err.splitlines() if not line.startswith("note: ")]
    assert len(said) == 1
    assert mine in said[0]
    assert "--force" in said[0]
    assert contents(own_folder) == before


@pytest.mark.parametrize(
    ("words", "made"),
    [
        pytest.param(f"{RUN} --picture", ["box.usdc", "box.png"], id="run"),
        pytest.param(f"{RUN} -o f.pvd", ["f.0001.vtu"], id="grids"),
        pytest.param("render film.usdc --size 64x64 --samples 1 --device cpu", ["film.png"], id="render"),
        pytest.param(f"{BATCH} {DATA}", ["box_batch/table.csv", "data/manifest.json"], id="batch"),
        pytest.param("scenes squirrel_tether -o mine.toml", ["mine.toml", "squirrel.obj"], id="scenes"),
        pytest.param("remesh cube.obj -o q.obj --cells 6", ["q.mtl"], id="remesh"),
    ],
)
def test_what_the_program_made_is_replaced_and_all_else_by_force(words: str, made: list[str], own_folder: Path) -> None:
    for _ in range(2):
        assert status_of(*words.split()) == 0
    for name in made:
        (own_folder / name).write_text("MINE\n")
    assert status_of(*words.split(), "--force") == 0
    assert all((own_folder / name).read_bytes() != b"MINE\n" for name in made)


def test_a_scene_is_ours_until_it_is_edited(tmp_path: Path) -> None:
    path = tmp_path / "box.toml"
    write_obj(tmp_path / "box.obj", cube())
    scene = load_scene(tmp_path / "box.obj")
    write_scene(scene, path)
    assert is_ours(path)
    write_scene(scene, path)
    path.write_text(path.read_text() + "# a thought\n")
    with pytest.raises(InputError, match=r"box\.toml: .*edited it"):
        write_scene(scene, path)
    with replacing_any():
        write_scene(scene, path)
    assert load_scene(path) == scene


def test_an_edited_scene_and_a_target_in_the_folder_of_a_design_stay(tmp_path: Path) -> None:
    write_obj(tmp_path / "balloon.obj", cube())
    (tmp_path / "report.json").write_text(json.dumps({"written_by": "Balloon Warp"}))
    with pytest.raises(InputError, match=r"balloon\.obj: is an input of the design"):
        design(tmp_path / "balloon.obj", folder=tmp_path, device="cpu")
    (tmp_path / "balloon.toml").write_text("frames = 7\n")
    with pytest.raises(InputError, match=r"balloon\.toml: .*edited it"):
        design(cube(), folder=tmp_path, device="cpu")
    assert (tmp_path / "balloon.toml").read_text() == "frames = 7\n"


def test_a_file_in_place_of_a_journal_stays(tmp_path: Path) -> None:
    path = tmp_path / "points.progress"
    path.write_text("MINE")
    with pytest.raises(InputError, match=r"points\.progress: another program wrote it"):
        Journal(path, {}, resume=False)
    assert path.read_text() == "MINE"
    path.unlink()
    for resume in (False, False, True):
        Journal(path, {"bounds": 1}, resume).close(done=False)


def test_a_texture_that_was_painted_over_stays(own_folder: Path) -> None:
    scene = load_scene(own_folder / "cube.obj", {"frames": 1})
    animate(scene, own_folder / "out.usdc", device="cpu")
    (image,) = (own_folder / "textures").iterdir()
    Image.new("RGB", (8, 8)).save(image)
    painted = image.read_bytes()
    with pytest.raises(InputError, match=r"textures.*: was edited"):
        animate(scene, own_folder / "out.usdc", device="cpu", on_frame=lambda _: pytest.fail("simulates"))
    assert image.read_bytes() == painted
    with replacing_any():
        animate(scene, own_folder / "out.usdc", device="cpu")
    assert image.read_bytes() != painted


INPUTS = {"box.usdc": "mesh", "box.png": "print", "tiles.usdc": "mesh"}


@pytest.mark.parametrize("output", INPUTS)
def test_an_output_is_no_input(output: str, own_folder: Path, made_stage: Path) -> None:
    for name in INPUTS:
        (own_folder / name).write_bytes(made_stage.read_bytes())
    balloon = Balloon(mesh=own_folder / "box.usdc", print=own_folder / "box.png")
    scene = Scene(balloon=[balloon], obstacle=[Obstacle(shape="mesh", mesh=own_folder / "tiles.usdc")], frames=1)
    wanted = (
        RequestedOutputs(own_folder / "out.usdc", own_folder / output)
        if output == "box.png"
        else RequestedOutputs(own_folder / output)
    )
    with pytest.raises(InputError, match=f"{output}: is the scene's {INPUTS[output]}; "):
        wanted.checked(scene)


def test_names_that_nobody_gave_are_no_inputs(own_folder: Path) -> None:
    """A texture and a mesh that stand where a picture and a stage usually go."""
    write_obj_cube(own_folder, "newmtl paint\nmap_Kd cube.png\n")
    atlas().save(own_folder / "cube.png")
    (own_folder / "film.toml").write_text('frames = 1\n[[balloon]]\nmesh = "film.usdc"\n')
    inputs = contents(own_folder)
    assert status_of("run", "cube.obj", "--frames", "1", "--picture", "--device", "cpu") == 0
    assert status_of("run", "film.toml", "--device", "cpu") == 0
    assert contents(own_folder).items() > inputs.items()
    assert is_ours(own_folder / "cube_balloon.png")
    assert is_ours(own_folder / "film_balloon.usdc")


def test_an_output_has_one_writer(tmp_path: Path) -> None:
    path, named = tmp_path / "out.usdc", tmp_path / "out.png"
    with sole_writer(path), sole_writer(path, None, named), ThreadPoolExecutor(1) as other:
        simulates = {"device": "cpu", "on_frame": lambda _: pytest.fail("simulates")}
        refusal = other.submit(animate, BOX, path, **simulates).exception()
    assert isinstance(refusal, InputError)
    assert "out.usdc: process " in str(refusal)
    assert "is writing it; wait for its end, or give another name, with -o" in str(refusal)
    assert list(tmp_path.iterdir()) == []
    with sole_writer(tmp_path), ThreadPoolExecutor(1) as other, pytest.raises(InputError, match="is writing it"):
        other.submit(run_batch, BOX, tmp_path, 2, device="cpu").result()
    with sole_writer(path):
        pass


def press(interrupts: Interrupts) -> None:
    os.kill(os.getpid(), signal.SIGINT)
    assert interrupts.pending


def done_of(work: list[Callable[[Interrupts], None]], message: str) -> int:
    """Return the number of work items done with Ctrl-C deferred, until it is raised with a message."""
    done = 0

    def run() -> None:
        nonlocal done
        with Interrupts() as interrupts:
            for step in work:
                step(interrupts)
                done += 1

    with pytest.raises(KeyboardInterrupt, match=f"^{message}$"):
        run()
    return done


def test_ctrl_c_waits_until_it_is_delivered_but_for_the_second():
    assert done_of([press, lambda _: None, lambda interrupts: interrupts.deliver("so far")], "so far") == 2
    assert done_of([press, lambda _: None], "") == 2
    assert done_of([press, press, lambda _: None], "") == 1


def test_ctrl_c_while_the_program_loads_is_a_word_too(tmp_path):
    """Ctrl-C during the program's import gives the message, too; a module that is imported first sends it, as a real
    one would have to meet a few tenths of a second."""
    (tmp_path / "typer.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]])}
    command = [sys.executable, "-m", "balloon_warp", "scenes"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "error: interrupted before the start\n")


def test_what_is_ignored_stays_ignored(monkeypatch, capsys):
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        monkeypatch.setattr("balloon_warp.cli.app._list_scenes", lambda: os.kill(os.getpid(), signal.SIGINT))
        assert status_of("scenes") == 0
        assert capsys.readouterr().err == ""
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.full
def test_a_picture_that_is_stopped_leaves_the_stage_and_says_so(tmp_path, monkeypatch):
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    scene = load_scene(tmp_path / "ball.obj", {"frames": 1})

    monkeypatch.setattr(render, "render_stage", Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt, match=r"/ball\.usda is written, .*/ball\.png is not$"):
        animate(scene, tmp_path / "ball.usda", picture=tmp_path / "ball.png", device="cpu", schedule="scatter")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.obj", "ball.usda"]


def test_a_failed_job_takes_what_is_behind_it_along():
    done: list[int] = []
    gate = threading.Event()

    def fail() -> None:
        gate.wait()
        raise OSError("disk full")

    def run() -> None:
        with Background() as background:
            background.submit(fail)
            background.submit(done.append, 1)
            gate.set()

    with pytest.raises(OSError, match="disk full"):
        run()
    assert done == []


def test_each_gpu_has_a_worker_that_sees_it_alone(monkeypatch):
    monkeypatch.setattr(wp, "get_cuda_device_count", lambda: 3)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "5,6,7")
    environments = worker_environments(Cluster(gpus=2))
    assert [each["CUDA_VISIBLE_DEVICES"] for each in environments] == ["5", "6"]
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES")
    assert worker_environments(Cluster(gpus=1)) == [{"CUDA_VISIBLE_DEVICES": "0"}]
    process, connection = start_child(tell_surroundings, environments[1])
    assert connection.recv() == ("6", signal.SIG_IGN)  # a terminal sends Ctrl-C to workers, too
    process.join()


def tell_surroundings(connection: Connection) -> None:
    connection.send((os.environ["CUDA_VISIBLE_DEVICES"], signal.getsignal(signal.SIGINT)))


def test_a_fork_server_leaves_ctrl_c_to_its_parent():
    """A fork server does not hear a terminal's Ctrl-C while it loads: it would print a traceback."""
    begin_children()
    status = Path(f"/proc/{forkserver._forkserver._forkserver_pid}/status").read_text()  # pyright: ignore
    blocked = int(re.search(r"^SigBlk:\s*(\w+)", status, re.M)[1], 16)  # pyright: ignore[reportOptionalSubscript]
    assert blocked & 1 << signal.SIGINT - 1
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SCM = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools_scm"]
CHANGES = (ROOT / "CHANGELOG.md").read_text()


def test_the_citation_and_versions_without_git_are_those_of_the_changelog():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    versions = re.findall(r"^## (\d+\.\d+\.\d+)(, not yet released)?$", CHANGES, re.MULTILINE)
    (latest, unreleased), released = versions[0], [version for version, coming in versions if not coming]
    assert SCM["fallback_version"] == (f"{latest}.dev0" if unreleased else latest)
    assert citation["version"] == (released or [latest])[0]
    assert citation["license"] == PROJECT["license"]
    assert {"cff-version", "title", "message", "authors"} <= citation.keys()


def test_the_papers_references_and_pages_for_language_models_exist():
    paper, references = ((ROOT / "docs/paper" / name).read_text() for name in ("paper.md", "paper.bib"))
    cited = set(re.findall(r"@([a-z_0-9]+)", paper.partition("# Summary")[2]))
    assert cited == set(re.findall(r"^@\w+\{(\w+),", references, re.MULTILINE))
    pages = re.findall(r"\(([A-Z]+)\.html\)", (ROOT / "docs/llms.txt").read_text())
    assert len(pages) > 8
    assert [page for page in pages if not (ROOT / "docs" / f"{page}.md").exists()] == []


@pytest.mark.parametrize("name", ["Containerfile", "balloon-warp.def"])
def test_images_install_extras_and_warm_up_scenes_that_there_are(name: str):
    recipe = (ROOT / "docs/container" / name).read_text()
    extras = re.findall(r"\[([a-z,]+)\]\"", recipe)[0].split(",")
    assert set(extras) <= PROJECT["optional-dependencies"].keys()
    assert all((ROOT / "scenes" / f"{scene}.toml").exists() for scene in re.findall(r"warm-up (\w+)", recipe))

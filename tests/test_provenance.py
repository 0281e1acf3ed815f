"""Provenance in a stage and in the manifest of a batch, and a batch repeated from it."""

import hashlib
import json
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from commands import status_of
from meshes import quad_sphere
from pxr import Sdf, Usd

from balloon_warp.errors import InputError
from balloon_warp.mesh.obj import write_obj
from balloon_warp.provenance import describe_scene, without_folders
from balloon_warp.scene import Balloon, Material, Scene
from balloon_warp.sweep.batch import run_batch
from balloon_warp.sweep.repeat import repeat_batch

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
    assert said["meshes"] == {"balloon.0.mesh": hashlib.sha256((tmp_path / "ball.obj").read_bytes()).hexdigest()}
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
    described = without_folders(
        {"scene": describe_scene(Scene(balloon=balloons)), "meshes": {str(files["ball.obj"]): "a hash"}}
    )
    assert "home" not in json.dumps(described)
    assert all(name in json.dumps(described["scene"]) for name in files)
    assert described["meshes"] == {"balloon.0.mesh": "a hash", "balloon.1.mesh": "a hash"}


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
BATCH_COMMAND += [
    "--vary",
    "balloon.inflation.k_normal=0:8",
    "--vary",
    "balloon.mesh=ball.obj,other.obj",
    "--device",
    "cpu",
]


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
    assert (said["command"], said["folder"], said["seed"]) == (BATCH_COMMAND, str(folder), 5)
    assert (said["worlds"], said["export"], said["device"], said["schedule"]) == (9, [2, 8], "cpu", "lanes")
    assert said["versions"]["warp-lang"] == metadata.version("warp-lang")
    assert said["scene"]["gravity"] == 9.81
    assert len(set(said["vary"]["balloon.inflation.k_normal"])) == 9
    said = manifest(folder / "first")
    assert set(said["outputs"]) == {"table.npz", "table.csv", "worlds.npz", "worlds.csv", "worlds.usdc"}
    for place, hashes in ((folder / "first", said["outputs"]), (folder, said["meshes"])):
        for name, expected in hashes.items():
            assert hashlib.sha256((place / name).read_bytes()).hexdigest() == expected


@pytest.mark.full
def test_hashes_are_those_of_a_repeated_batch_and_of_no_other(folder: Path):
    (folder / "ball.toml").unlink()
    summary = repeat_batch(folder / "first" / "manifest.json", folder / "again")
    said, again = (manifest(folder / name) for name in ("first", "again"))
    assert again["outputs"] == said["outputs"]
    assert summary.manifest == str(folder / "again" / "manifest.json")
    repeat_batch(folder / "again" / "manifest.json", folder / "third")
    assert manifest(folder / "third")["outputs"] == said["outputs"]
    said = manifest(folder / "first")
    said["vary"]["balloon.inflation.k_normal"][7] += 0.1
    (folder / "changed.json").write_text(json.dumps(said))
    repeat_batch(folder / "changed.json", folder / "again")
    again = manifest(folder / "again")["outputs"]
    assert all(again[name] != said["outputs"][name] for name in ("table.npz", "table.csv"))


def test_its_command_has_the_same_hashes(folder: Path):
    said = manifest(folder / "first")
    (folder / "first").rename(folder / "moved")
    assert status_of(*said["command"][1:]) == 0
    assert manifest(folder / "first") == said


def test_what_cannot_be_repeated_is_told(folder: Path):
    path = folder / "first" / "manifest.json"

    def refused(complaint: str) -> None:
        with pytest.raises(InputError, match=complaint):
            repeat_batch(path, folder / "again")

    write_obj(folder / "other.obj", quad_sphere(4))
    refused(r"other\.obj: has changed since the batch: its SHA-256 is ")
    (folder / "other.obj").unlink()
    refused(r"its mesh other\.obj is missing")
    for text in ("[]", "{}", "{", "\x00"):
        path.write_text(text)
        refused("manifest")
    assert not (folder / "again").exists()


def test_a_mesh_from_python_is_named_and_hashed(tmp_path):
    hashes = []
    for cells in (2, 2, 3):
        run_batch(Scene(frames=1, balloon=[Balloon(mesh=quad_sphere(cells))]), tmp_path / "out", 2, device="cpu")
        hashes += manifest(tmp_path / "out")["meshes"].values()
    assert hashes[0] == hashes[1] != hashes[2]
    with pytest.raises(InputError, match="is missing; expected the file"):
        repeat_batch(tmp_path / "out" / "manifest.json", tmp_path / "again")

"""Provenance in a stage and in the manifest of a batch, and a batch repeated from it."""

import csv
import hashlib
import json
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from commands import status_of
from meshes import cube, quad_sphere
from pxr import Sdf, Usd

from balloon_warp import Balloon, InputError, Material, Scene, repeat_batch, run_batch
from balloon_warp.mesh.obj import write_obj
from balloon_warp.run import provenance
from balloon_warp.run.provenance import hash_of_file

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
    described = provenance.without_folders({"scene": provenance.describe_scene(Scene(balloon=balloons)), "files": {}})
    assert "home" not in json.dumps(described)
    assert all(name in json.dumps(described["scene"]) for name in files)
    assert provenance.named_files(described["scene"]).keys() == {
        *("balloon.0.mesh", "balloon.0.print", "balloon.0.material.rest_mesh", "balloon.1.mesh", "balloon.1.springs")
    }


def test_all_files_of_a_scene_have_hashes(tmp_path):
    files = {name: tmp_path / name for name in ("ball.obj", "print.png")}
    for name, file in files.items():
        file.write_text(name)
    hashes = provenance.hash_files(Scene(balloon=[Balloon(mesh=files["ball.obj"], print=files["print.png"])]))
    assert hashes == {
        "balloon.0.mesh": hashlib.sha256(b"ball.obj").hexdigest(),
        "balloon.0.print": hashlib.sha256(b"print.png").hexdigest(),
    }
    spheres = [quad_sphere(2), quad_sphere(3)]  # of the same name
    assert len(set(provenance.hash_files(Scene(balloon=[Balloon(mesh=sphere) for sphere in spheres])).values())) == 2


@pytest.mark.parametrize(
    ("word", "left"),
    [
        ("/home/me/my scene.toml", "my scene.toml"),
        ("balloon.mesh=/home/me/a.obj,/b.obj,c.obj", "balloon.mesh=a.obj,b.obj,c.obj"),
        ("~/a.obj", "a.obj"),
        ("data/a.obj", "data/a.obj"),
        ("--vary", "--vary"),
        ("balloon.name='a b'", "balloon.name='a b'"),
    ],
)
def test_a_command_without_folders_has_no_absolute_path(word: str, left: str):
    assert provenance.command_without_folders([word]) == [left]


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
    "--device",
    "cpu",
    "--vary",
    "balloon.inflation.k_normal=0:8",
    "--vary",
    "balloon.mesh=ball.obj,other.obj",
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
    refused(r"its file other\.obj is missing")
    for text in ("[]", "{}", "{", "\x00"):
        path.write_text(text)
        refused("manifest")
    assert not (folder / "again").exists()


def test_a_mesh_from_python_is_named_and_hashed(tmp_path):
    hashes = []
    for cells in (2, 2, 3):
        run_batch(Scene(frames=1, balloon=[Balloon(mesh=quad_sphere(cells))]), tmp_path / "out", 2, device="cpu")
        hashes += manifest(tmp_path / "out")["files"].values()
    assert hashes[0] == hashes[1] != hashes[2]
    with pytest.raises(InputError, match="is missing; expected it"):
        repeat_batch(tmp_path / "out" / "manifest.json", tmp_path / "again")

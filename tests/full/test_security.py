"""Promises of SECURITY.md about commands: the files and addresses that they open, write, connect to and start."""

import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import quad_sphere

import balloon_warp
from balloon_warp.mesh.obj import write_obj
from balloon_warp.system.files import LOCK, PREFIX

HERE = Path(__file__).parents[1]
DECOYS = ("beside.mtl", "beside.png", "other.obj", "other.toml", ".env")
"""named by the mesh and by the stage, or by nobody"""
TEXTURED = """#usda 1.0
def Mesh "face"
{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    rel material:binding = </painted>
}
def Material "painted"
{
    token outputs:surface.connect = </painted/surface.outputs:surface>
    def Shader "surface"
    {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </painted/texture.outputs:rgb>
        token outputs:surface
    }
    def Shader "texture"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @beside.png@
        float3 outputs:rgb
    }
}
"""
DRAWN = """<?xml version="1.0"?>
<!DOCTYPE svg [<!ENTITY beside SYSTEM "beside.mtl">]>
<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">
  <style>@import url("beside.css"); path { fill: url("beside.svg#paint") }</style>
  <image xlink:href="beside.png" width="9" height="9"/>
  <use xlink:href="beside.svg#part"/>
  <path d="M50 90C10 60 0 20 30 15Q45 15 50 30Q55 15 70 15C100 20 90 60 50 90z"/>
</svg>
"""
ON_CPU = ["--device", "cpu"]
BALL = ["ball.obj", "beside.mtl", "beside.png"]
"""the mesh, its library of materials and the texture that this names"""
PAINTED = ["textured.usda", "beside.png"]
"""a stage and the texture that its material names"""
BATCH = ["batch", "scene.toml", "--worlds", "3", "--vary", "gravity=1:9", "--export", "1", "-o", "out", *ON_CPU]
TABLES = [f"out/{name}" for name in ("table.npz", "table.csv", "worlds.npz", "worlds.csv", "worlds.usdc")]
BOTH = ["compare", "scene.toml", "--vary", "gravity=1,9", "-o", "both.png", *ON_CPU]
COMMANDS = {
    "inspect": (["inspect", "ball.obj"], BALL, []),
    "run": (["run", "scene.toml", "--picture", *ON_CPU], ["scene.toml", *BALL], ["scene.usdc", "scene.png"]),
    "batch": (BATCH, ["scene.toml", *BALL], [*TABLES, "out/manifest.json"]),
    "compare": (BOTH, ["scene.toml", *BALL], ["both.png"]),
    "render": (["render", "textured.usda", "-o", "face.png"], PAINTED, ["face.png"]),
    "convert": (["convert", "textured.usda", "-o", "face.glb"], PAINTED, ["face.glb"]),
    "remesh": (["remesh", "ball.obj", "-o", "quads.obj", "--cells", "6"], BALL, ["quads.obj"]),
    "foil": (["foil", "heart.svg", "-o", "heart.obj"], ["heart.svg"], ["heart.obj"]),
}
"""each with the files that it is given, and those that it is to write"""
STARTED = ("subprocess.Popen ('uname', ",)
"""programs that are no harm: Warp asks for the kind of processor"""


@pytest.fixture(scope="module")
def told(tmp_path_factory) -> tuple[Path, dict[str, dict]]:
    """Return the actions of each command, in one process: see watched.py."""
    if not sys.platform.startswith("linux"):
        pytest.skip("needs inotify")
    folder = tmp_path_factory.mktemp("watched")
    ball = quad_sphere(3)
    places = np.zeros((len(ball.face_vertex_indices), 2), np.float32)
    write_obj(folder / "ball.obj", replace(ball, texture_coordinates=places))
    mesh = (folder / "ball.obj").read_text()
    (folder / "ball.obj").write_text(f"mtllib beside.mtl\nusemtl painted\n{mesh}")
    (folder / "scene.toml").write_text('frames = 2\n[[balloon]]\nmesh = "ball.obj"\n')
    (folder / "textured.usda").write_text(TEXTURED)
    (folder / "heart.svg").write_text(DRAWN)
    (folder / "out").mkdir()
    for decoy in DECOYS:
        (folder / decoy).write_text("newmtl painted\nmap_Kd beside.png\n")
    return folder, dict(zip(COMMANDS, run_watched(folder, [words for words, _, _ in COMMANDS.values()]), strict=True))


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_opens_and_writes_what_it_is_given_alone(command: str, told: tuple[Path, dict]):
    folder, done = told[0], told[1][command]
    _, given, written = COMMANDS[command]
    assert done["status"] in (None, 0)
    opened = {name for kind, name in done["happened"] if kind == "opened" and not is_temporary(name)}
    changed = {name for kind, name in done["happened"] if kind == "changed" and not is_temporary(name)}
    assert set(given) <= opened <= {*given, *written}
    assert changed == set(written)
    assert not [path for path in folder.rglob(".*") if path.name not in DECOYS]


def is_lock(path: str) -> bool:
    """Return whether a file marks a folder in which another process is at work."""
    return Path(path).name.startswith(PREFIX) and path.endswith(LOCK)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_opens_nothing_elsewhere_but_its_programs(command: str, told: tuple[Path, dict]):
    """Temporary files are gone in the end. Locks of other processes are read to see whether they live."""
    folder, done = told[0], told[1]
    package = Path(balloon_warp.__path__[0]).resolve().parent
    places = [folder, package, sys.prefix, sys.base_prefix, done["inspect"]["cache"], "/dev/null", "/proc", "/sys"]
    if sys.pycache_prefix:  # PYTHONPYCACHEPREFIX: where Python keeps its bytecode, else beside its modules
        places.append(sys.pycache_prefix)
    elsewhere = [path for path in done[command]["opened"] if not is_within(path, places)]
    temporary = [path for path in elsewhere if is_within(path, [tempfile.gettempdir()])]
    assert not set(elsewhere) - set(temporary)
    assert [path for path in temporary if Path(path).exists() and not is_lock(path)] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_is_fetched_listened_to_or_started(command: str, told: tuple[Path, dict]):
    assert [call for call in told[1][command]["called"] if not call.startswith(STARTED)] == []


def test_what_is_watched_is_seen(tmp_path):
    (tmp_path / "work").mkdir()
    write_obj(tmp_path / "away.obj", quad_sphere(2))
    (tmp_path / "work/scene.toml").write_text('frames = 1\n[[balloon]]\nmesh = "../away.obj"\n')
    (tmp_path / "work/textured.usda").write_text(TEXTURED)
    by_hand = "import socket, pxr.Sdf; pxr.Sdf.Layer.FindOrOpen('textured.usda'); socket.socket().bind(('', 0))"
    inspected, done = run_watched(tmp_path / "work", [["inspect", "scene.toml"], ["python", by_hand]])
    assert str(tmp_path / "away.obj") in inspected["opened"]
    assert ["opened", "textured.usda"] in done["happened"]
    assert done["called"] == ["socket.bind (('', 0),)"]


def run_watched(folder: Path, commands: list[list[str]]) -> list[dict]:
    """Return the actions of each command: see watched.py."""
    watched = [sys.executable, str(HERE / "watched.py"), str(folder), json.dumps(commands)]
    done = subprocess.run(watched, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def is_temporary(name: str) -> bool:
    return Path(name).name.startswith(".") and name not in DECOYS


def is_within(path: str, places: list) -> bool:
    return any(Path(path).resolve().is_relative_to(Path(place).resolve()) for place in places)

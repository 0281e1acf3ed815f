"""Promises of commands: files they open, memory they take, garbage, kernels compiled ahead, the same bytes again."""

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from meshes import assert_closed_quads, cube, quad_sphere
from numpy.typing import NDArray
from small_batch import struck

import balloon_warp
from balloon_warp import (
    Balloon,
    Ground,
    Inflation,
    InputError,
    Material,
    Obstacle,
    PolygonMesh,
    Scene,
    Simulator,
    Sphere,
    String,
    Touch,
    Water,
    animate,
    remesh,
    run_batch,
)
from balloon_warp.benchmarks.long_run import CASES, QUICK, Growth, measure
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.surface_nets import surface_nets
from balloon_warp.model import Model, world_bytes
from balloon_warp.schedules import SCHEDULES
from balloon_warp.schedules.choose import schedule_named
from balloon_warp.schedules.one_launch import SearchedSchedule
from balloon_warp.system.files import LOCK, PREFIX
from balloon_warp.tools.remesh import handle_count

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
def test_a_command_opens_fetches_and_starts_nothing_elsewhere_but_its_programs(command: str, told: tuple[Path, dict]):
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
    assert [call for call in done[command]["called"] if not call.startswith(STARTED)] == []


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


FEW, MANY = 16, 48
"""worlds; eight divide both, so that lanes has none to fill up"""


def scene() -> Scene:
    """Return a scene with a thing of each kind."""
    spheres = [Sphere(position=(x, 3.0, 0.0)) for x in (0.0, 1.0)]
    things = {"sphere": spheres, "string": [String(anchor=(0.0, -2.0, 0.0))], "ground": Ground(height=-3.0)}
    balloons = [Balloon(mesh=quad_sphere(4)), Balloon(mesh=cube(), position=(3.0, 0.0, 0.0))]
    return Scene(balloon=balloons, faces=False, touch=False, **things)


def arrays_in(thing: Any, seen: frozenset[int] = frozenset()) -> dict[int, wp.array]:
    """Return every reachable device array by its address, without visiting an object twice."""
    if id(thing) in seen:
        return {}
    seen |= {id(thing)}
    if isinstance(thing, wp.array):
        return {thing.ptr: thing} if thing.ptr else {}
    if isinstance(thing, list | tuple):
        parts = thing
    elif isinstance(thing, dict):
        parts = thing.values()
    elif hasattr(thing, "_cls"):  # an instance of a Warp struct
        parts = [getattr(thing, name) for name in thing._cls.vars]
    elif type(thing).__module__.startswith("balloon_warp") and not isinstance(thing, Model):
        parts = vars(thing).values()
    else:
        return {}
    return {address: array for part in parts for address, array in arrays_in(part, seen).items()}


def bytes_taken(simulator: Simulator) -> int:
    return sum(array.capacity for array in arrays_in(simulator).values())


@pytest.mark.parametrize("water", [None, Water(level=-9.0)])
@pytest.mark.parametrize("schedule", SCHEDULES)
def test_the_estimate_is_what_is_allocated(schedule: str, water: Water | None, device: str):
    if schedule in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{schedule} is for the CPU")
    if schedule == "octets" and water:
        pytest.skip("octets has no water")
    wet = scene().model_copy(update={"water": water})
    few, many = (Simulator(wet, device, worlds, schedule=schedule) for worlds in (FEW, MANY))
    taken = (bytes_taken(many) - bytes_taken(few)) / (MANY - FEW)
    estimate = world_bytes(many.model) + schedule_named(schedule, many.model).world_bytes(many.model)
    assert estimate == pytest.approx(taken, rel=0.005)


def test_the_estimate_is_what_is_allocated_where_balloons_touch_themselves(device: str):
    """Lists of contacts have most of the memory: the rest is counted to a hundred bytes."""
    rubber = Material(kind="neo_hookean", shear_modulus=1e6, thickness=5e-4, softening=0.5)
    balloon = Balloon(mesh=quad_sphere(2), material=rubber, inflation=Inflation(pressure=9.0))
    wall = Obstacle(position=(0.0, -9.0, 0.0))
    folded = Scene(balloon=[balloon], obstacle=[wall], faces=False, touch=Touch(itself=True), substeps=64)
    few, many = (Simulator(folded, device, worlds, schedule="block") for worlds in (FEW, MANY))
    assert isinstance(many.schedule, SearchedSchedule)
    taken = (bytes_taken(many) - bytes_taken(few)) / (MANY - FEW)
    assert world_bytes(many.model) + many.schedule.world_bytes(many.model) == pytest.approx(taken, abs=100)


LARGEST = QUICK[-1]


@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.name)
def test_memory_does_not_grow(case):
    growth = measure(case)
    assert growth.marks[-1][0] == case.frames
    assert growth.is_bounded, f"{growth.slope:.2f} MiB in {case.units}"


def test_frames_that_are_kept_are_seen():
    growth = measure(replace(LARGEST, save_bytes=1 << 40))
    assert not growth.is_bounded
    assert growth.slope == pytest.approx(3.5, abs=1.0)  # 36 bytes of each of 1,016 particles


@pytest.mark.parametrize(("per_thousand", "bounded"), [(0.0, True), (0.7, True), (1.5, False), (20.0, False)])
def test_a_slope_is_found_beside_the_rise_and_fall_of_what_is_saved(per_thousand: float, bounded: bool):
    """A leak of more than 1 MiB in 1,000 frames is found beside 64 MiB that rise and fall each 2,700 frames."""
    frames = range(0, 10_001, 50)
    marks = [(frame, 90.0 + frame % 2700 / 2700 * 64.0 + per_thousand * frame / 1000) for frame in frames]
    growth = Growth(CASES[1], marks, 0.0)
    # The highest marks are 2,700 frames apart, of stretches of 3,000.
    assert growth.slope == pytest.approx(per_thousand, rel=0.15, abs=0.01)
    assert growth.is_bounded is bounded


COMMAND = """
import warp as wp
from balloon_warp.__main__ import main
wp.config.optimization_level = 0
main()
"""
"""balloon-warp, with kernels that stay as they are written: it is about which are compiled"""


def test_a_command_compiles_nothing_after_it(tmp_path: Path):
    write_obj(tmp_path / "ball.obj", quad_sphere(3))
    assert printed_by(tmp_path, "warm-up", "ball.obj", "--worlds", "9").startswith("ball: ")
    compiled = kernels(tmp_path)
    assert compiled
    later = "batch ball.obj --frames 3 --worlds 12 --vary balloon.mass=1:3 --export all"
    printed_by(tmp_path, *later.split())
    assert kernels(tmp_path) == compiled


def printed_by(folder: Path, *arguments: str) -> str:
    words = [sys.executable, "-c", COMMAND, *arguments, "--device", "cpu"]
    environment = {**os.environ, "WARP_CACHE_PATH": str(folder / "kernels")}
    done = subprocess.run(words, env=environment, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def kernels(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in (folder / "kernels").rglob("*.o")}


@pytest.mark.parametrize("way", ["gather", "octets", "lanes", "block", "projective"])
def test_a_run_and_a_batch_have_the_same_bytes_again(way: str, device: str, tmp_path: Path):
    if device != "cpu" and way in ("octets", "lanes"):
        pytest.skip("simulates on the CPU")
    solver, schedule = ("projective", "auto") if way == "projective" else ("symplectic_euler", way)
    scene, vary = struck(frames=4, solver=solver), {"gravity": [9.0 + 0.1 * world for world in range(9)]}

    def written(folder: Path, **changes: float) -> dict[str, bytes]:
        run_batch(scene, folder, 9, vary, export=[0, 8], device=device, schedule=schedule)
        animate(scene.model_copy(update=changes), folder / "run.usdc", device=device, schedule=schedule)
        return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "manifest.json"}

    first = written(tmp_path / "first")
    assert len(first) == 6
    assert written(tmp_path / "again") == first
    assert written(tmp_path / "other", gravity=9.0)["run.usdc"] != first["run.usdc"]


def statue(hole: float, handle: float = 0.08) -> PolygonMesh:
    """Return a flat body with a hole of that radius through it, and a round handle on its side: genus 2."""

    def distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = points.T
        body = 0.3 * (np.sqrt(x**2 + (y / 0.7) ** 2 + (z / 0.3) ** 2) - 1.0)
        ring = np.hypot(np.hypot(x - 1.0, y) - 0.3, z) - handle
        return np.minimum(np.maximum(body, hole - np.hypot(x + 0.3, y)), ring)

    return surface_nets(distance, [-1.1, -0.8, -0.4], [1.5, 0.8, 0.4], cell=min(0.05, 0.6 * hole))


@pytest.fixture(scope="module")
def narrow() -> PolygonMesh:
    """Return a statue whose hole takes some 30 cells."""
    return statue(0.05)


@pytest.mark.parametrize("cells", [16, 24, 40, 64])
def test_a_clean_statue_of_genus_2_keeps_its_handles(narrow: PolygonMesh, cells: int) -> None:
    assert handle_count(narrow) == 2
    made = remesh(narrow, cells)
    assert_closed_quads(made, holes_through=2)
    more = [warning for warning in made.warnings if "were used" in warning]
    assert len(more) == (cells < 30)
    if more:
        assert more[0].startswith(f"With {cells} cells 1 of its 2 handles, or holes through it, is lost: ")


def test_a_number_that_one_has_to_ask_for_is_named(narrow: PolygonMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("balloon_warp.tools.remesh.MOST_BY_ITSELF", 0)
    with pytest.raises(InputError) as refused:
        remesh(narrow, 24)
    said = str(refused.value)
    assert said.startswith("mesh: with 24 cells 1 of its 2 handles, or holes through it, is lost; expected --cells ")
    cells = int(said.split("--cells ")[1].split(",")[0])
    assert_closed_quads(remesh(narrow, cells), holes_through=2)


def test_a_hole_that_no_cells_keep_is_closed_and_that_is_said(narrow: PolygonMesh, monkeypatch) -> None:
    """Handles of a scan, whose surface came too near to itself. The ring on the side is a cell thick: fitted whole
    its quads cross each other in 108 places, so a part stays thick."""
    monkeypatch.setattr("balloon_warp.tools.remesh.MAX_CELLS", 24)
    made = remesh(narrow, 16)
    assert_closed_quads(made, holes_through=1)
    assert made.warnings == (
        "Open parts became 1.5 cells thick (0.223), as did thin parts without room; more cells make them thinner.",
        "With 16 cells 1 of its 2 handles, or holes through it, is lost: no number of cells keeps the handles.",
    )

"""Benchmarks: their cases, peers and command; figures of the paper; the fuzzer; and stages in other simulators."""

import ast
import itertools
import json
import re
import shlex
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from commands import status_of
from exported import BALL, scene
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation

from balloon_warp import animate, load_scene
from balloon_warp.benchmarks import auto, crowd_rate, fuzz, health, measure, reading
from balloon_warp.benchmarks.bad_meshes import MESH_CASES, MeshCase
from balloon_warp.benchmarks.cases import CPU_CASES, GPU_CASES, Case, ExportCase, ReadingCase
from balloon_warp.benchmarks.crowd import CrowdCase
from balloon_warp.benchmarks.result import Result
from balloon_warp.benchmarks.run import run_case
from balloon_warp.cli import main as command
from balloon_warp.errors import InputError
from balloon_warp.mesh.topology import triangulate
from balloon_warp.model import Model, State, build_model, initial_state
from balloon_warp.scene import bundled_scenes
from balloon_warp.schedules import SCHEDULES, make_schedule

SCHEDULE_CASES = [case for case in CPU_CASES + GPU_CASES if isinstance(case, Case)]


@pytest.mark.parametrize("case", {case.cells: case for case in SCHEDULE_CASES if case.cells < 100}.values())
def test_the_cases_can_be_built(case):
    model = build_model(case.scene(), "cpu")
    assert model.particle_count == 6 * case.cells**2 + 2
    assert all(case.schedule in (*SCHEDULES, "auto") for case in SCHEDULE_CASES)


MEASURED = {
    "batch": (Case("two balloons", "lanes", 2, cells=2), {"schedule": "lanes", "worlds": 2, "particles": 26}),
    "export": (ExportCase("", 3, cells=2, frames=4), {"worlds": 3, "particles": 26, "peer": None}),
    "reading": (ReadingCase("", 2, "two_balloons"), {"worlds": 2, "particles": 820, "peer": "not read"}),
}


@pytest.mark.parametrize("name", MEASURED)
def test_a_case_is_measured_and_has_the_promised_keys(name: str, monkeypatch):
    for module, count in ((measure, "FRAMES"), (reading, "FRAMES"), (reading, "REPEATS")):
        monkeypatch.setattr(module, count, 2)
    case, expected = MEASURED[name]
    result = run_case(case, wp.get_device("cpu"))
    names = "case device schedule worlds particles rate peer peer_rate ratio bound_fraction overlap peer_overlap"
    assert list(result.as_json()) == names.split()
    assert expected.items() <= {**result.as_json(), "peer": result.peer}.items()
    assert result.rate > 0.0
    assert result.ratio == (result.rate / result.peer_rate if result.peer_rate else None)


@pytest.mark.parametrize("normals", ["cached", "fresh"])
def test_newton_gives_the_same_trajectory(normals, device):
    """Newton's trajectory agrees over three frames to float32's rounding: both have the same forces and integrator."""
    pytest.importorskip("newton")
    from balloon_warp.benchmarks.newton_peer import NewtonPeer

    model = build_model(Case("", "scatter", 2, cells=4, normals=normals).scene(), device, 2)
    state, unused = initial_state(model), initial_state(model)
    scatter, peer = make_schedule(model, "scatter"), NewtonPeer(model)
    start = state.points.numpy().copy()
    for _ in range(3):
        scatter.advance_frame(state)
        unused.frame.assign(state.frame.numpy() - 1)
        peer.advance_frame(unused)
    assert np.abs(state.points.numpy() - start).max() > 1e-2
    np.testing.assert_allclose(peer.points.numpy(), state.points.numpy(), rtol=0, atol=2e-5)


def test_blender_simulates_the_same_balloon():
    pytest.importorskip("bpy")
    from balloon_warp.benchmarks.blender_peer import BlenderPeer
    from balloon_warp.benchmarks.cases import RealTimeCase

    model = build_model(RealTimeCase("", cells=4).scene(), "cpu")
    peer, unused = BlenderPeer(model), initial_state(model)
    start = peer.points
    np.testing.assert_allclose(start, model.initial_points.numpy(), atol=1e-6)
    for _ in range(5):
        peer.advance_frame(unused)
    moved = peer.points
    assert 1e-4 < np.abs(moved - start).max() < 0.5
    assert np.linalg.norm(moved - moved.mean(axis=0), axis=1).min() > 0.4


@pytest.mark.parametrize(("look", "status"), [(0.004, 0), (0.011, 1)])
def test_looking_after_worlds_at_too_high_a_cost_is_the_status(look: float, status: int, monkeypatch):
    monkeypatch.setattr(health, "cost_of", lambda case, _: health.Cost(case.name, 1.0, look * (case.worlds > 1), 0.002))
    assert status_of("cpu", main=health.main) == status


RESULTS = [Result("1 balloon", "cpu", "gather", 1, 488, 2.0e8), Result("[s]", "cpu", "lanes", 8, 26, 3.0, "peer", 2.0)]


@pytest.fixture(autouse=True)
def measured(monkeypatch) -> None:
    monkeypatch.setattr("balloon_warp.benchmarks.run.run_cases", lambda device, quick: iter(RESULTS))


def bench(*words: str) -> int:
    return status_of("bench", *words)


def test_a_table_is_printed_and_the_json_written_or_json_alone(capsys, tmp_path):
    assert bench("--device", "cpu", "--json") == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == [result.as_json() for result in RESULTS]
    assert said.err.splitlines() == ["1 balloon (gather): 2e+08", "[s] (lanes): 3"]
    assert bench("--device", "cpu", "-o", str(tmp_path / "results.json")) == 0
    cases = [line.split("|")[1].strip() for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert [case for case in cases if not case.startswith("-")] == ["case", "1 balloon", "[s]"]
    assert json.loads((tmp_path / "results.json").read_text()) == [result.as_json() for result in RESULTS]


def test_variants_of_scenes_can_be_built_and_two_sets_at_once_are_refused(capsys):
    for source, overrides in auto.VARIANTS.values():
        assert load_scene(source, overrides) != load_scene(source)
    assert bench("--scenes", "--quick") == 2
    assert capsys.readouterr().err == "error: --quick, --scenes, and --gpus or --workers: expected only one of them\n"


CASE = CrowdCase("", "newton", cells=4)
CROWD_FRAMES = 20


def after_crowding(model: Model) -> State:
    state, schedule = initial_state(model), make_schedule(model)
    for _ in range(CROWD_FRAMES):
        schedule.advance_frame(state)
    return state


def parts_of(points: np.ndarray, model: Model) -> list[np.ndarray]:
    return [points[begin:end].astype(np.float64) for begin, end in pairwise(model.particle_offsets)]


def widths(points: np.ndarray, model: Model) -> np.ndarray:
    """Return the mean distance of each balloon's particles from their middle, over the radius at the start."""
    parts = parts_of(points, model)
    return np.array([np.linalg.norm(part - part.mean(axis=0), axis=1).mean() for part in parts]) / CASE.radius


def check_motion(peer: Any, model: Model, frames: int) -> np.ndarray:
    """Return a peer's final points, and require that the same balloons get wider while fixed particles stay."""
    np.testing.assert_allclose(peer.points, model.initial_points.numpy(), atol=1e-6)
    held = model.particle_mass_share.numpy() == 0.0
    assert 8 <= held.sum() < model.particle_count // 4
    unused = initial_state(model)
    for _ in range(frames):
        peer.advance_frame(unused)
    points = np.asarray(peer.points)
    assert np.isfinite(points).all()
    np.testing.assert_allclose(points[held], model.initial_points.numpy()[held], atol=1e-5)
    return points


def test_newton_blows_them_up_alike():
    """Agreement within a few percent, with the same springs and pressure, though by implicit steps."""
    pytest.importorskip("newton")
    from balloon_warp.benchmarks.newton_crowd import NewtonCrowd

    model = build_model(CASE.scene(), "cpu")
    points = check_motion(NewtonCrowd(model), model, CROWD_FRAMES)
    assert crowd_rate._overlap(points, model) < 0.02 * CASE.radius
    np.testing.assert_allclose(widths(points, model), widths(after_crowding(model).points.numpy()[0], model), rtol=0.05)


def test_blender_blows_them_up_alike():
    """Blender's balloons get a seventh wider, as ours, on the measured mesh, for which its pressure was chosen."""
    pytest.importorskip("bpy")
    from balloon_warp.benchmarks.blender_peer import BlenderPeer

    model = build_model(replace(CASE, cells=8).scene(), "cpu")
    points = check_motion(BlenderPeer(model, crowd_rate.BLENDER_PRESSURE), model, CROWD_FRAMES)
    np.testing.assert_allclose(widths(points, model), 8 / 7, rtol=0.03)


def test_newton_gives_the_same_gradient():
    """Derivatives through the same springs agree to 1e-3 of the largest: both are float32, over 32 substeps."""
    pytest.importorskip("newton")
    from balloon_warp.benchmarks.newton_gradients import Case

    case = Case("springs", 1, 1, "cpu")
    ours, its = case.ours().gradient(), case.newton().gradient()
    assert np.abs(ours).max() > 0.0
    np.testing.assert_allclose(its, ours, rtol=1e-3, atol=1e-3 * np.abs(ours).max())


ROOT = Path(__file__).parents[2]
FIGURES = (ROOT / "docs" / "FIGURES.md").read_text(encoding="utf-8")
ROWS = [line for line in FIGURES.splitlines() if re.match(r"\| .*`balloon-warp", line)]
COMMANDS = [shlex.split(command) for row in ROWS for command in re.findall(r"`balloon-warp (.*?)`", row)]
NUMBERS = {*range(1, 27)}


def figures(row: str) -> list[int]:
    """Return the numbers in a row's first cell; none for a claim."""
    first = row.split("|")[1].strip()
    return [int(number) for number in first.split(",")] if re.fullmatch(r"[\d, ]+", first) else []


def test_every_figure_has_a_row():
    assert {number for row in ROWS for number in figures(row)} == NUMBERS


@pytest.mark.parametrize("row", ROWS, ids=[row.split("|")[1].strip() for row in ROWS])
def test_the_test_of_each_row_exists(row: str):
    for name, link in re.findall(r"\[(test_\w+)\]\(([^)]+)\)", row):
        tree = ast.parse((ROOT / "docs" / link).read_text(encoding="utf-8"))
        assert name in [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert "[test_" in row


def short(arguments: list[str]) -> list[str]:
    """Return the command for two frames, with small pictures or none: they take longer than all the rest."""
    if arguments[0] == "inspect":
        return arguments
    kept = [re.sub("(?<=^picture_frame=).*", "0,1,2", argument) for argument in arguments if argument != "--picture"]
    small = ["--size", "64x64"] if arguments[0] == "compare" else []
    return [*kept, *small, "--set", "frames=2", "--device", "cpu"]


@pytest.mark.parametrize("arguments", COMMANDS, ids=[" ".join(arguments) for arguments in COMMANDS])
def test_each_command_runs(arguments: list[str], tmp_path, monkeypatch, capsys):
    assert arguments[1] in bundled_scenes()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["balloon-warp", *short(arguments)])
    with pytest.raises(SystemExit) as ended:
        command()
    said = capsys.readouterr()
    assert (ended.value.code or 0) == 0
    assert all(", schedule " in line for line in said.err.splitlines()), said.err  # the first of each run's log
    assert "refused" not in said.out
    assert "blew up" not in said.out
    if arguments[0] != "inspect":
        assert [path.name in said.out for path in tmp_path.iterdir()] == [True]


@pytest.mark.parametrize("read", [fuzz.fuzz_meshes, fuzz.fuzz_scenes])
def test_mutated_files_are_taken_or_refused(read, tmp_path: Path) -> None:
    count: fuzz.Count = Counter()
    read(tmp_path, 100, 0, count)
    assert count.total() >= 100
    assert min(count["accepted"], count["refused"]) >= 10


@pytest.mark.parametrize(
    ("fault", "found"),
    [(ZeroDivisionError("planted"), "planted"), (InputError("no\nsentence: "), "a refusal of more than a line")],
)
def test_a_fault_is_found(fault: Exception, found: str, tmp_path, monkeypatch) -> None:
    def fail(path: Path) -> None:
        raise fault

    monkeypatch.setattr(fuzz, "load_mesh", fail)
    with pytest.raises(type(fault) if isinstance(fault, ZeroDivisionError) else AssertionError, match=found):
        fuzz.fuzz_meshes(tmp_path, 5, 0, Counter())


@pytest.mark.parametrize(("hang", "patience"), [(lambda: None, 1e9), (lambda: time.sleep(0.01), 1.0)])
def test_a_hang_is_found(hang: Callable[[], None], patience: float, tmp_path, monkeypatch) -> None:

    def read(path: Path) -> None:
        while True:
            hang()

    monkeypatch.setattr(fuzz, "LONGEST", 0.02)
    monkeypatch.setattr(fuzz, "PATIENCE", patience)
    monkeypatch.setattr(fuzz, "load_mesh", read)
    with pytest.raises(TimeoutError, match=r"a file took more than 0\.02 s"):
        fuzz.fuzz_meshes(tmp_path, 1, 0, Counter())


def test_the_table_is_held_to(tmp_path: Path) -> None:
    plain = next(case for case in MESH_CASES if case.name == "plain")
    assert fuzz.try_case(plain, tmp_path) is None
    wrong = MeshCase("plain", plain.content, "refused", "is wrong")
    assert fuzz.try_case(wrong, tmp_path) == "plain: expected to be refused, was accepted ()"


@pytest.mark.parametrize(
    ("take", "complaint"),
    [
        (lambda: [time.sleep(0.01) for _ in itertools.count()], "plain: TimeoutError a file took more than"),
        (lambda: bytearray(2 * fuzz.MOST_MEMORY), "plain: MemoryError"),
    ],
)
def test_the_table_has_bounded_time_and_memory(
    take: Callable[[], object], complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzz, "MESH_CASES", [case for case in MESH_CASES if case.name == "plain"])
    monkeypatch.setattr(fuzz, "LONGEST", 0.02)
    monkeypatch.setattr(fuzz, "PATIENCE", 1.0)
    monkeypatch.setattr(fuzz, "_plan", lambda *_: take())
    _, [wrong] = fuzz.try_table(tmp_path)
    assert wrong.startswith(complaint)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stage") / "out.usdc"
    animate(scene(frames=2), path, device="cpu")
    return path


def test_a_balloon_is_a_surface_deformable(written: Path):
    stage = Usd.Stage.Open(str(written))
    prim = stage.GetPrimAtPath("/World/ball")
    applied = prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    assert {"PhysicsDeformableBodyAPI", "PhysicsSurfaceDeformableSimAPI", "PhysicsCollisionAPI"} <= set(applied)
    start = UsdGeom.Mesh(prim).GetPointsAttr().Get(0)
    np.testing.assert_allclose(prim.GetAttribute("physics:restShapePoints").Get(), start, atol=1e-6)
    np.testing.assert_allclose(UsdGeom.Mesh(prim).GetPointsAttr().Get(), start, atol=1e-6)
    np.testing.assert_array_equal(prim.GetAttribute("physics:restTriVertexIndices").Get(), triangulate(BALL)[0])
    assert prim.GetAttribute("physics:mass").Get() == pytest.approx(scene().balloon[0].mass)
    gravity = UsdPhysics.Scene(stage.GetPrimAtPath("/World/Physics"))
    assert tuple(gravity.GetGravityDirectionAttr().Get()) == (0.0, -1.0, 0.0)
    assert gravity.GetGravityMagnitudeAttr().Get() == pytest.approx(abs(scene().gravity))


def test_the_extra_brings_what_is_imported_here():
    """The extra installs the packages that these tests import, which would otherwise be skipped everywhere."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (others,) = (each for each in extras["test"] if each.startswith("balloon-warp["))
    brought = extras["test"] + [each for name in extras if name in others for each in extras[name]]
    assert {"newton", "newton-usd-schemas", "MaterialX"} <= {each.partition(">=")[0] for each in brought}


def test_every_mesh_has_points_without_a_time_too(written: Path):
    """Every mesh has points at the default time: Newton refuses a stage with one that has none."""
    stage = Usd.Stage.Open(str(written))
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert any(mesh.GetPath().name.startswith("String") for mesh in meshes)
    for mesh in meshes:
        assert len(mesh.GetPointsAttr().Get()), mesh.GetPath()


def test_latex_is_a_variant_that_validators_need_not_know(written: Path):
    stage = Usd.Stage.Open(str(written))
    material = UsdShade.Material(stage.GetPrimAtPath("/World/Looks/ball"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert not UsdValidation.ValidationContext(validators).Validate(stage)
    assert material.ComputeSurfaceSource("mtlx")[0].GetIdAttr().Get() == "UsdPreviewSurface"
    material.GetPrim().GetVariantSet("surface").SetVariantSelection("openpbr")
    latex = material.ComputeSurfaceSource("mtlx")[0]
    assert latex.GetIdAttr().Get() == "ND_open_pbr_surface_surfaceshader"
    assert latex.GetInput("geometry_thin_walled").Get() is True
    assert latex.GetInput("base_color").Get() == material.ComputeSurfaceSource()[0].GetInput("diffuseColor").Get()
    assert material.ComputeSurfaceSource()[0].GetIdAttr().Get() == "UsdPreviewSurface"


def test_openpbr_has_the_inputs_that_latex_sets(written: Path):
    materialx = pytest.importorskip("MaterialX")
    library = materialx.createDocument()
    folders = materialx.getDefaultDataLibraryFolders()
    materialx.loadLibraries(folders, materialx.getDefaultDataSearchPath(), library)
    kinds = {"color3f": "color3", "float": "float", "bool": "boolean"}
    definition = library.getNodeDef("ND_open_pbr_surface_surfaceshader")
    known = {each.getName(): each.getType() for each in definition.getInputs()}
    stage = Usd.Stage.Open(str(written))
    material = UsdShade.Material(stage.GetPrimAtPath("/World/Looks/ball"))
    material.GetPrim().GetVariantSet("surface").SetVariantSelection("openpbr")
    for each in material.ComputeSurfaceSource("mtlx")[0].GetInputs():
        assert known[each.GetBaseName()] == kinds[str(each.GetTypeName())]

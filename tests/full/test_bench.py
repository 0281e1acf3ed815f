"""Benchmarks: their cases, peers and command; figures of the paper; the fuzzer; and stages in other simulators."""

import ast
import itertools
import json
import re
import shlex
import subprocess
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
from conserved import advanced
from exported import BALL, scene
from meshes import quad_sphere as looped_quad_sphere
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation

from balloon_warp import Simulator, animate, load_scene
from balloon_warp.benchmarks import auto, crowd_rate, export, first_frame, fuzz, health, measure, reading, solvers
from balloon_warp.benchmarks.bad_meshes import MESH_CASES, MeshCase
from balloon_warp.benchmarks.bound import GATHER_INSTRUCTIONS, bound, gather_bound
from balloon_warp.benchmarks.cases import CPU_CASES, GPU_CASES, Case, ExportCase, FirstFrameCase, ReadingCase, beside
from balloon_warp.benchmarks.crowd import CrowdCase
from balloon_warp.benchmarks.lines import KINDS, folders, house, kinds_of
from balloon_warp.benchmarks.measure import FRAMES, REPEATS, seconds_a_frame
from balloon_warp.benchmarks.result import Result
from balloon_warp.benchmarks.rubber import RADIUS, rubber_cases
from balloon_warp.benchmarks.run import run_case
from balloon_warp.blow_ups import KEPT_FRAMES
from balloon_warp.cli import main as command
from balloon_warp.errors import InputError
from balloon_warp.mesh.topology import quad_sphere, signed_volume, triangulate
from balloon_warp.model import Model, State, build_model, initial_state, lay_out, plan_model
from balloon_warp.scene import bundled_scenes
from balloon_warp.schedules import SCHEDULES, make_schedule
from balloon_warp.schedules.choose import fastest_schedule
from balloon_warp.system.warp_threads import pick_device


def test_the_mesh_is_the_quad_sphere_of_the_other_tests():
    found, expected = quad_sphere(4, 0.5), looped_quad_sphere(4, 0.5)
    assert found.vertex_count == expected.vertex_count == 6 * 16 + 2
    assert found.face_count == expected.face_count == 6 * 16
    np.testing.assert_allclose(np.sort(found.points, axis=0), np.sort(expected.points, axis=0), atol=1e-12)
    np.testing.assert_allclose(signed_volume(found), signed_volume(expected), rtol=1e-12)  # winds outward


SCHEDULE_CASES = [case for case in CPU_CASES + GPU_CASES if isinstance(case, Case)]


@pytest.mark.parametrize("case", {case.cells: case for case in SCHEDULE_CASES if case.cells < 100}.values())
def test_the_cases_can_be_built(case):
    model = build_model(case.scene(), "cpu")
    assert model.particle_count == 6 * case.cells**2 + 2
    assert all(case.schedule in (*SCHEDULES, "auto") for case in SCHEDULE_CASES)


@pytest.mark.parametrize("case", list(rubber_cases("octets", 1)), ids=lambda case: case.law)
def test_rubber_of_the_cases_is_stretched(case):
    simulator = Simulator(case.scene(), "cpu", schedule=case.schedule)
    points = advanced(simulator, 60).points[0]
    stretch = np.linalg.norm(points - points.mean(axis=0), axis=1).mean() / RADIUS
    assert 1.4 < stretch < 1.7
    masses = [build_model(scene, "cpu").parameters["mass"].numpy()[0, 0] for scene in (case.scene(), case.without())]
    assert masses[0] == pytest.approx(masses[1], rel=0.05)  # rubbers have not quite the same density


@pytest.mark.parametrize("spheres", [1, 8])
def test_spheres_of_the_cases_touch_the_balloon_and_nothing_blows_up(spheres):
    model = build_model(Case("", "lanes", 1, spheres=spheres, ground=True).scene(), "cpu")
    state = initial_state(model)
    schedule = make_schedule(model, "lanes")
    touched = np.zeros(spheres, dtype=bool)
    for _ in range(1 + FRAMES * (1 + REPEATS)):
        schedule.advance_frame(state)
        touched |= (state.sphere_forces.numpy()[0] != 0.0).any(axis=1)
    assert touched.all()
    assert np.isfinite(state.points.numpy()).all()


def test_every_frame_that_is_timed_is_simulated(monkeypatch):
    """Each contender runs a warm-up, its repeat, and the repeats that count; recorded frames are replayed."""
    states: list[State] = []
    monkeypatch.setattr(measure, "initial_state", lambda model: states.append(initial_state(model)) or states[-1])
    model = build_model(Case("", "gather", 1, cells=2).scene(), "cpu")
    assert min(seconds_a_frame([make_schedule(model, name) for name in ("gather", "lanes")])) > 0.0
    assert [state.frame.numpy()[0] for state in states] == [1 + FRAMES * (1 + REPEATS)] * 2


def test_growing_cases_change_one_thing_and_keep_the_particles():
    base = CPU_CASES[0]
    assert isinstance(base, Case)
    finer, coarser = beside(base, cells=(18, 2))
    assert (finer.particles, finer.worlds, coarser.particles, coarser.worlds) == (1946, 16, 26, 1200)
    (spheres,) = beside(base, spheres=(4,))
    assert spheres == replace(base, spheres=4, peer="base", quick=False, name="64 balloons, but 4 spheres")
    assert len(spheres.scene().sphere) == 4


def test_a_growing_case_is_measured_beside_its_base(monkeypatch):
    monkeypatch.setattr(
        "balloon_warp.benchmarks.rate.seconds_a_frame", lambda contenders, states: [0.5] * len(contenders)
    )
    (case,) = beside(Case("64 balloons", "lanes", 64), substeps=(8,))
    result = run_case(case, wp.get_device("cpu"))
    assert (result.peer, result.peer_rate, result.rate) == ("64 balloons", 64 * 488 * 32 / 0.5, 64 * 488 * 8 / 0.5)
    assert result.ratio == 0.25


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


def test_an_export_is_of_every_frame_and_of_worlds_that_differ(tmp_path):
    case = ExportCase("", 3, cells=2, frames=4)
    plan = plan_model(case.scene(), 3, {"balloon.inflation.k_normal": [0.1, 0.2, 0.3]})
    simulator = Simulator.of_model(lay_out(plan, "cpu"))
    export._batch_writer(simulator, plan)(tmp_path / "batch.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "batch.usdc"))
    assert stage.GetEndTimeCode() == 4
    points = [UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/World_{n}/balloon")).GetPointsAttr().Get(4) for n in range(3)]
    assert points[0] != points[1] != points[2] != points[0]
    export._world_writer(Simulator(case.scene(), "cpu"))(tmp_path / "world.usdc")
    assert Usd.Stage.Open(str(tmp_path / "world.usdc")).GetEndTimeCode() == 4


@pytest.mark.parametrize("cold", [True, False])
def test_a_cold_first_frame_has_no_kernels_and_a_warm_one_has_them(cold: bool, monkeypatch):
    found = []

    def process(case: FirstFrameCase, device: wp.Device, cache: str) -> tuple[float, str]:
        found.append(sorted(path.name for path in Path(cache).glob("*")) if Path(cache).exists() else [])
        Path(cache).mkdir(exist_ok=True)
        (Path(cache) / "kernel").touch()
        return len(found), "gather 26"

    monkeypatch.setattr(first_frame, "_simulate", process)
    result = run_case(FirstFrameCase("", cold), wp.get_device("cpu"))
    timed = found[-first_frame.REPEATS :]
    assert timed == [[] if cold else ["kernel"]] * first_frame.REPEATS
    assert (result.schedule, result.particles) == ("gather", 26)
    assert result.rate == len(found) - first_frame.REPEATS // 2  # the median of the last


def test_a_process_simulates_a_first_frame_or_says_that_it_does_not(tmp_path):
    wp.init()
    cache = Path(str(wp.config.kernel_cache_dir)).parent  # Warp adds its version
    seconds, said = first_frame._simulate(FirstFrameCase("", cold=False), wp.get_device("cpu"), str(cache))
    assert seconds > 0.0
    schedule, particles = said.split()
    assert schedule in SCHEDULES
    assert int(particles) == 2494
    with pytest.raises(subprocess.CalledProcessError):
        first_frame._simulate(FirstFrameCase("", cold=False, scene="none"), wp.get_device("cpu"), str(tmp_path))


def test_gathers_bound_is_the_launch_for_few_particles_and_issue_or_bytes_for_many():
    assert gather_bound(10, 132, 1.5e-6, obstacles=False) == pytest.approx(10 / 1.5e-6, rel=1e-3)
    issue = 132 * 128 * 1.98e9 / GATHER_INSTRUCTIONS
    assert gather_bound(10**8, 132, 1.5e-6, obstacles=False) == pytest.approx(issue, rel=1e-3)
    assert gather_bound(10**8, 10**4, 1.5e-6, obstacles=False) == pytest.approx(10.1376e12 / 172, rel=1e-3)
    with_sphere = gather_bound(10**8, 132, 1.5e-6, obstacles=True)
    assert with_sphere < gather_bound(10**8, 132, 1.5e-6, obstacles=False)
    model = build_model(Case("", "gather", 1, cells=2).scene(), "cpu")
    assert bound(model, "gather") is None


def test_gather_on_a_gpu_stays_below_its_bound(device):
    if device == "cpu":
        pytest.skip("needs a GPU")
    result = run_case(Case("", "gather", 1, cells=40), wp.get_device(device))
    assert result.bound_fraction is not None
    assert 0.01 < result.bound_fraction < 1.0


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


def test_explicit_and_implicit_steps_are_measured_on_the_same_motion(monkeypatch):
    monkeypatch.setattr(solvers, "STIFFNESS", (1.0,))
    monkeypatch.setattr(solvers, "STEPS", ((1, 4), (8, 4)))
    monkeypatch.setattr(solvers, "WORLDS", {"cpu": (1,)})
    monkeypatch.setattr(solvers, "FRAMES", 4)
    explicit, large, small = solvers.measure_solvers(wp.get_device("cpu"))
    assert (large.method, large.substeps, large.iterations) == ("projective", 1, 4)
    assert 0.0 < explicit.error < small.error < 0.5 * large.error


def test_what_it_costs_to_look_after_worlds_is_measured_beside_their_frame(monkeypatch):
    cpu, tiny = wp.get_device("cpu"), Case("tiny", "gather", 1, cells=2, substeps=4)
    measured = health.cost_of(tiny, cpu)
    assert min(measured.frame, measured.copy) > 0.0  # the look is a difference, lost in the noise of so few particles
    monkeypatch.setattr(health, "seconds_a_frame", lambda schedules, _: (2.0, 1.5, 9.0, 4.0, 0.4))
    cases = tiny, replace(tiny, worlds=3), replace(tiny, schedule="block", worlds=3)
    alone, batch, block = (health.cost_of(case, cpu) for case in cases)
    assert alone.look == batch.look == 5.0 / health.REPEATS / 2.0
    assert block.look == 0.25
    assert (alone.copy, batch.copy) == (0.4 / KEPT_FRAMES / 2.0, 0.0)


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


def test_bundled_scenes_are_measured_in_each_schedule_beside_auto(monkeypatch, capsys):
    monkeypatch.setattr(auto, "measured_scenes", lambda: ["two_balloons"])
    monkeypatch.setattr(auto, "WORLDS", (1, 2))
    monkeypatch.setattr(auto, "FRAME_SECONDS", 0.0)  # one at a time
    measured = list(auto.scene_results(pick_device("cpu"), auto.WORLDS))
    assert [(each.schedule, each.worlds) for each in measured] == [(name, n) for n in (1, 2) for name in auto.ON_CPU]
    for each in measured:
        assert (each.case, each.particles, each.rate > 0.0) == ("two_balloons", 820, True)
        taken = fastest_schedule(build_model(load_scene("two_balloons"), "cpu", each.worlds), each.worlds)
        assert each.peer == f"auto: {taken}"
        assert each.peer_rate is not None
        assert each.ratio == pytest.approx(each.rate / each.peer_rate)
        assert each.schedule != taken or each.ratio == 1.0
    monkeypatch.setattr(auto, "scene_results", lambda device: measured)
    assert bench("--device", "cpu", "--scenes", "--json") == 0
    assert json.loads(capsys.readouterr().out) == [result.as_json() for result in measured]


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


def test_the_balloons_are_apart_at_first_and_press_each_other_then():
    model = build_model(CASE.scene(), "cpu")
    assert crowd_rate._overlap(initial_state(model).points.numpy()[0], model) == 0.0
    state = after_crowding(model)
    ended = state.points.numpy()[0]
    assert (state.holds.numpy()[0, :, 3] != 0.0).sum() >= 24  # four pairs in each direction, two sides each
    assert 1.05 < widths(ended, model).min() < widths(ended, model).max() < 1.3
    assert crowd_rate._overlap(ended, model) < 0.02 * CASE.radius
    alone = build_model(CASE.scene().model_copy(update={"touch": False}), "cpu")
    assert (
        crowd_rate._overlap(after_crowding(alone).points.numpy()[0], alone) > 0.1 * CASE.radius
    )  # else there is nothing to do


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


class Mover:
    """Peer whose second balloon ends a tenth of its radius in the first."""

    def __init__(self, model: Model):
        self.model = model
        parts = parts_of(model.initial_points.numpy(), model)
        apart = parts[1].mean(axis=0) - parts[0].mean(axis=0)
        parts[1] = parts[1] - apart * (1.0 - 1.9 * CASE.radius / np.linalg.norm(apart))
        self.points = np.concatenate(parts)


def test_ratio_and_overlaps_are_of_the_same_run(monkeypatch):
    asked = []

    def seconds(contenders: list[Any], frames: int, states: list[State]) -> list[float]:
        asked.append((frames, len(contenders), len(states)))
        return [0.5, 1.0]

    monkeypatch.setattr(crowd_rate, "seconds_a_frame", seconds)
    monkeypatch.setattr(crowd_rate, "peers_of", lambda case, model: [Mover(model)])
    result = run_case(CASE, wp.get_device("cpu"))
    assert asked == [(CASE.frames, 2, 2)]
    assert (result.rate, result.peer, result.peer_rate, result.ratio) == (2 / 24, "newton", 1 / 24, 2.0)
    assert (result.worlds, result.particles, result.overlap) == (1, 8 * 98, 0.0)
    assert result.peer_overlap == pytest.approx(0.1, abs=0.02)  # a vertex of the mesh is not quite the deepest


def test_newton_gives_the_same_gradient():
    """Derivatives through the same springs agree to 1e-3 of the largest: both are float32, over 32 substeps."""
    pytest.importorskip("newton")
    from balloon_warp.benchmarks.newton_gradients import Case

    case = Case("springs", 1, 1, "cpu")
    ours, its = case.ours().gradient(), case.newton().gradient()
    assert np.abs(ours).max() > 0.0
    np.testing.assert_allclose(its, ours, rtol=1e-3, atol=1e-3 * np.abs(ours).max())


TEXT = '''"""A file.

Of two functions.
"""

import math


# A comment.
@decorated
def first(
    a: int,
) -> float:
    """Return a root."""
    import cmath  # late

    # Another comment.
    return math.sqrt(a)


def second():
    return 2
'''


def test_each_line_is_of_one_kind_in_all_folders():
    found = kinds_of(TEXT)
    assert found["lines"] == len(TEXT.splitlines()) == sum(found[kind] for kind in KINDS)
    assert [found[kind] for kind in KINDS] == [2, 5, 2, 5, 2, 6]
    assert found["functions"] == 2
    found = folders()
    assert {"laws", "phases", "schedules", "adjoints"} <= found.keys()
    assert all(counts["lines"] == sum(counts[kind] for kind in KINDS) for counts in found.values())


def test_the_size_of_the_house_is_counted():
    found = house()
    assert 0 < found["of which closures"] < found["functions of Warp"]
    assert (
        found["lines of kernels"]
        < found["lines of the core, with kernels"]
        < sum(found[f"lines of {part}"] for part in ("kernels", "the package"))
    )
    assert 100 < found["our modules in a run of two frames"] < found["files of the package"] + found["files of kernels"]


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

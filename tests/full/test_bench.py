"""Peer of the benchmark simulates the same balloons, and its cases are what they say."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere as looped_quad_sphere
from pxr import Usd, UsdGeom

from balloon_warp.benchmarks import bound, export, first_frame, measure, rate, reading
from balloon_warp.benchmarks.cases import (
    CPU_CASES,
    GPU_CASES,
    Case,
    ExportCase,
    FirstFrameCase,
    ReadingCase,
    RealTimeCase,
    beside,
)
from balloon_warp.benchmarks.measure import FRAMES, REPEATS, seconds_a_frame
from balloon_warp.benchmarks.rubber import RADIUS, rubber_cases
from balloon_warp.benchmarks.run import run_case
from balloon_warp.blow_ups import KEPT_FRAMES
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.quad_sphere import quad_sphere
from balloon_warp.model import Model, State, build_model, initial_state, lay_out, plan_model
from balloon_warp.schedules import SCHEDULES, make_schedule
from balloon_warp.simulator import Simulator


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
    """Rubber of a case is stretched to half as large again as at rest, and as heavy as its peer without rubber."""
    simulator = Simulator(case.scene(), "cpu", schedule=case.schedule)
    for _ in range(60):
        simulator.step()
    points = simulator.state.points.numpy()[0]
    stretch = np.linalg.norm(points - points.mean(axis=0), axis=1).mean() / RADIUS
    assert 1.4 < stretch < 1.7
    masses = [build_model(scene, "cpu").parameters["mass"].numpy()[0, 0] for scene in (case.scene(), case.without())]
    assert masses[0] == pytest.approx(masses[1], rel=0.05)  # rubbers have not quite the same density


@pytest.mark.parametrize("spheres", [1, 8])
def test_spheres_of_the_cases_touch_the_balloon_and_nothing_blows_up(spheres):
    """Spheres touch the balloon in the timed frames, and all points stay finite."""
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
    states = []

    def kept_state(model: Model) -> State:
        states.append(initial_state(model))
        return states[-1]

    monkeypatch.setattr(measure, "initial_state", kept_state)
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
    """Rates follow the particle-substeps where all frames take the same time."""
    monkeypatch.setattr(rate, "seconds_a_frame", lambda contenders, states: [0.5] * len(contenders))
    (case,) = beside(Case("64 balloons", "lanes", 64), substeps=(8,))
    result = run_case(case, wp.get_device("cpu"))
    assert (result.peer, result.peer_rate, result.rate) == ("64 balloons", 64 * 488 * 32 / 0.5, 64 * 488 * 8 / 0.5)
    assert result.ratio == 0.25


def test_a_case_gives_the_promised_keys(monkeypatch):
    monkeypatch.setattr(measure, "FRAMES", 2)
    result = run_case(Case("two balloons", "lanes", 2, cells=2), wp.get_device("cpu")).as_json()
    names = "case device schedule worlds particles rate peer peer_rate ratio bound_fraction overlap peer_overlap"
    assert list(result) == names.split()
    said = {name: result[name] for name in names.split()[:5]}
    assert said == {"case": "two balloons", "device": "cpu", "schedule": "lanes", "worlds": 2, "particles": 26}
    assert result["rate"] > 0.0


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
    result = run_case(case, wp.get_device("cpu"))
    assert (result.worlds, result.particles, result.peer) == (3, 26, None)
    assert result.rate > 0.0


@pytest.mark.parametrize("cold", [True, False])
def test_a_cold_first_frame_has_no_kernels_and_a_warm_one_has_them(cold: bool, monkeypatch):
    """The first process finds an empty kernel cache and the second a filled one, as a stand-in process reports."""
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


def test_frames_are_read_beside_as_many_that_are_not(monkeypatch):
    monkeypatch.setattr(reading, "FRAMES", 2)
    monkeypatch.setattr(reading, "REPEATS", 1)
    result = run_case(ReadingCase("", 2, "two_balloons"), wp.get_device("cpu"))
    assert (result.worlds, result.particles, result.peer) == (2, 820, "not read")
    assert result.peer_rate
    assert result.ratio == result.rate / result.peer_rate


def test_a_process_simulates_a_first_frame():
    wp.init()
    cache = Path(str(wp.config.kernel_cache_dir)).parent  # Warp adds its version
    seconds, said = first_frame._simulate(FirstFrameCase("", cold=False), wp.get_device("cpu"), str(cache))
    assert seconds > 0.0
    schedule, particles = said.split()
    assert schedule in SCHEDULES
    assert int(particles) == 2494


def test_a_process_without_a_frame_is_told(tmp_path):
    with pytest.raises(subprocess.CalledProcessError):
        first_frame._simulate(FirstFrameCase("", cold=False, scene="none"), wp.get_device("cpu"), str(tmp_path))


def test_gathers_bound_is_the_launch_for_few_particles_and_issue_or_bytes_for_many():
    """Roofline bounds on 132 multiprocessors are worked out by hand, from the docstring's instructions and bytes."""
    assert bound.gather_bound(10, 132, 1.5e-6, obstacles=False) == pytest.approx(10 / 1.5e-6, rel=1e-3)
    issue = 132 * 128 * 1.98e9 / bound.GATHER_INSTRUCTIONS
    assert bound.gather_bound(10**8, 132, 1.5e-6, obstacles=False) == pytest.approx(issue, rel=1e-3)
    assert bound.gather_bound(10**8, 10**4, 1.5e-6, obstacles=False) == pytest.approx(10.1376e12 / 172, rel=1e-3)
    with_sphere = bound.gather_bound(10**8, 132, 1.5e-6, obstacles=True)
    assert with_sphere < bound.gather_bound(10**8, 132, 1.5e-6, obstacles=False)


def test_the_bound_is_for_gpus():
    model = build_model(Case("", "gather", 1, cells=2).scene(), "cpu")
    assert bound.bound(model, "gather") is None


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
    """Blender simulates the same mesh under pressure frame by frame, and it stays a balloon."""
    pytest.importorskip("bpy")
    from balloon_warp.benchmarks.blender_peer import BlenderPeer

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
    """Smaller steps come closer to the reference, by either method; a row each."""
    from balloon_warp.benchmarks import solvers

    monkeypatch.setattr(solvers, "STIFFNESS", (1.0,))
    monkeypatch.setattr(solvers, "STEPS", ((1, 4), (8, 4)))
    monkeypatch.setattr(solvers, "WORLDS", {"cpu": (1,)})
    monkeypatch.setattr(solvers, "FRAMES", 4)
    explicit, large, small = solvers.measure_solvers(wp.get_device("cpu"))
    assert (large.method, large.substeps, large.iterations) == ("projective", 1, 4)
    assert 0.0 < explicit.error < small.error < 0.5 * large.error


def test_what_it_costs_to_look_after_worlds_is_measured_beside_their_frame(monkeypatch):
    """Cost of the health check is the difference to a schedule without it; a batch keeps no states."""
    from balloon_warp.benchmarks import health

    cpu, tiny = wp.get_device("cpu"), Case("tiny", "gather", 1, cells=2, substeps=4)
    measured = health.cost_of(tiny, cpu)
    assert min(measured.frame, measured.copy) > 0.0  # the look is a difference, lost in the noise of so few particles
    monkeypatch.setattr(health, "seconds_a_frame", lambda schedules, _: (2.0, 1.5, 9.0, 4.0, 0.4))
    alone, batch, block = (
        health.cost_of(case, cpu) for case in (tiny, replace(tiny, worlds=3), replace(tiny, schedule="block", worlds=3))
    )
    assert alone.look == batch.look == 5.0 / health.REPEATS / 2.0
    assert block.look == 0.25
    assert (alone.copy, batch.copy) == (0.4 / KEPT_FRAMES / 2.0, 0.0)


@pytest.mark.parametrize(("look", "status"), [(0.004, 0), (0.011, 1)])
def test_looking_after_worlds_at_too_high_a_cost_is_the_status(look: float, status: int, monkeypatch):
    from balloon_warp.benchmarks import health

    monkeypatch.setattr(sys, "argv", ["health", "cpu"])
    monkeypatch.setattr(health, "cost_of", lambda case, _: health.Cost(case.name, 1.0, look * (case.worlds > 1), 0.002))
    with pytest.raises(SystemExit) as end:
        health.main()
    assert end.value.code == status

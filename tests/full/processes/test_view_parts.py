"""Parts of the page, without a browser: changes to a running simulation, and the scene that replays them."""

import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conserved import advanced
from costs import nightly_but
from exported import assert_valid
from meshes import cube, quad_sphere
from method_scenes import some_bundled_scenes
from pxr import Usd, UsdGeom
from strangers import ball
from strangers import wait_until as until

from balloon_warp import (
    Balloon,
    BlowUpError,
    Change,
    Ground,
    Inflation,
    InputError,
    Material,
    Scene,
    Simulator,
    Sphere,
    String,
)
from balloon_warp.mesh.topology import triangulate
from balloon_warp.scene import load_scene
from balloon_warp.scene.load import bundled_scenes
from balloon_warp.studio.page import playground as journal
from balloon_warp.studio.page.drawings import Drawing, Smooth, ground_distance, hit_distance, throw_at
from balloon_warp.studio.page.playground import MOST_THROWN, Playground
from balloon_warp.studio.page.session import MOST_ASKED, MOST_BEHIND, Pace, Session

UP = (0.0, 1.0, 0.0)


def play(pace: Pace, cost: float, seconds: float, speed: float = 1.0) -> tuple[float, float]:
    """Return the simulated and the elapsed time of frames of 1/60 s that each cost some time on a clock of our own."""
    pace.speed, now, simulated = speed, 100.0, 0.0
    while now < 100.0 + seconds:
        now += pace.wait(now, 1 / 60) + cost
        simulated += 1 / 60
        pace.passed(now, 1 / 60)
    return simulated, now - 100.0


@pytest.mark.parametrize("speed", [0.25, 1.0, 2.0])
def test_pace_keeps_real_time_where_the_machine_can(speed):
    pace = Pace()
    simulated, seconds = play(pace, 0.005, 10.0, speed)
    assert simulated == pytest.approx(speed * seconds, abs=2 / 60)
    assert pace.rate == pytest.approx(speed, rel=0.02)


def test_pace_slows_down_where_the_machine_cannot_and_does_not_catch_up_on_a_long_stop():
    pace = Pace()
    simulated, seconds = play(pace, 1 / 30, 10.0)
    assert simulated == pytest.approx(0.5 * seconds, rel=0.02)
    assert pace.rate == pytest.approx(0.5, rel=0.02)
    pace = Pace()
    play(pace, 0.001, 1.0)
    now, frames = 102.0, 0
    while pace.wait(now, 1 / 60) == 0.0:
        frames += 1
    assert frames <= MOST_BEHIND * 60 + 1


def test_rays_hit_the_nearest_side_of_a_cube_and_the_ground_from_above_only():
    mesh = cube()
    triangles, _ = triangulate(mesh)
    assert hit_distance((0.3, 0.4, -2.0), (0.0, 0.0, 1.0), mesh.points, triangles) == pytest.approx(2.0)
    assert hit_distance((0.3, 0.4, 0.5), (0.0, 0.0, 1.0), mesh.points, triangles) == pytest.approx(0.5)
    assert hit_distance((1.3, 0.4, -2.0), (0.0, 0.0, 1.0), mesh.points, triangles) is None
    assert hit_distance((0.3, 0.4, -2.0), (0.0, 0.0, -1.0), mesh.points, triangles) is None
    down = np.array([3.0, -4.0, 0.0]) / 5.0
    assert ground_distance((0.0, 5.0, 0.0), down, UP, 1.0) == pytest.approx(5.0)
    assert ground_distance((0.0, 5.0, 0.0), -down, UP, 1.0) is None
    assert ground_distance((0.0, 0.0, 0.0), down, UP, 1.0) is None


def test_a_thrown_body_arrives():
    start, target = np.array([1.0, 2.0, 3.0]), np.array([-2.0, 2.5, 7.0])
    velocity = throw_at(target, start, 6.0, 9.81, UP)
    seconds = np.linalg.norm(target - start) / 6.0
    arrived = start + velocity * seconds - 0.5 * 9.81 * seconds**2 * np.array(UP)
    np.testing.assert_allclose(arrived, target, atol=1e-12)


@pytest.fixture
def session(tmp_path):
    session = Session("ball", ball(), "cpu", tmp_path)
    session.watched = True
    session.start()
    yield session
    session.stop()


def test_strain_and_measures_are_those_of_the_shape(session):
    """A balloon inflated to 1.25 times its size is in the band from 1.15 to 1.4 all over."""
    picture, drawing, measures = session.picture, Drawing(session.picture.model), []
    for size in (1.0, 2.0, 1.25):
        points = size * picture.model.shapes[0].mesh.points.astype(np.float32)
        object.__setattr__(picture.frame, "points", [points])
        measures.append(drawing.measures(picture))
    bands = drawing.strain_bands(picture, 0)
    assert [len(band) > 0 for band in bands] == [False, False, False, False, True, False, False]
    assert measures[1]["volume"] == pytest.approx(8.0 * measures[0]["volume"], rel=1e-5)
    assert measures[0]["stretch"] == pytest.approx(1.0, abs=1e-5)
    assert measures[1]["stretch"] == pytest.approx(2.0, abs=1e-5)


def test_the_surface_that_is_drawn_is_catmull_and_clarks():
    """The limit surface of a cube (1978) has corners at 5/9, edges' middles at 3/4 of the way out, and faces' where
    they were."""
    mesh = cube()
    surface = Smooth(mesh)
    middle = mesh.points.mean(axis=0)
    drawn = surface.points(mesh.points.astype(np.float32)) - middle
    reach = np.abs(drawn).max(axis=1) / np.abs(mesh.points - middle).max()
    np.testing.assert_allclose(reach, [5 / 9] * 8 + [3 / 4] * 12 + [1.0] * 6, rtol=1e-6)
    solid = trimesh.Trimesh(drawn, surface.triangles, process=False)
    assert solid.is_watertight
    assert solid.volume > 0.0
    assert np.bincount(surface.triangle_faces).tolist() == [8] * 6
    moved = surface.points(2.0 * mesh.points.astype(np.float32) + 1.0)
    np.testing.assert_allclose(moved, 2.0 * (drawn + middle) + 1.0, rtol=1e-5)


def goes_on(session: Session, frames: int = 2) -> None:
    number = session.picture.frame.number
    until(lambda: session.picture.frame.number > number + frames, "time goes on")


OUT_OF_BOUNDS = np.array([0.0, 1e13, 0.0])
WRONG: dict[str, tuple[Callable[[Session], None], str]] = {
    **{
        str(value): (lambda session, value=value: session.set("balloon.mass", value), r"balloon\.0\.mass: must be ")
        for value in ("wide", None, float("nan"), float("inf"), [1, 2], {"a": 1}, -1.0)
    },
    "a sphere that is too fast": (
        lambda session: session.ask(lambda playground: playground.throw(np.zeros(3), OUT_OF_BOUNDS, 0.2, 1.0)),
        r"^sphere\.velocity\.1: must be less than 1000000000000 \(got 10000000000000\.0\)$",
    ),
    "a fault": (lambda session: session.ask(lambda playground: 1 / 0), ""),
}
"""What a page may ask for by mistake, and what it is told"""


@pytest.mark.parametrize("name", WRONG)
def test_what_goes_wrong_does_not_stop_the_simulation(name: str, session, capsys):
    ask, said = WRONG[name]
    ask(session)
    until(lambda: session.notices, "it is said")
    assert re.search(said, session.notices[0])
    goes_on(session)
    assert session.picture.scene.balloon[0].mass == 0.1
    assert ("ZeroDivisionError" in capsys.readouterr().err) == (name == "a fault")


def test_wishes_do_not_pile_up(session):
    hold, busy, free = [], threading.Event(), threading.Event()
    session.ask(lambda playground: busy.set() or free.wait())
    busy.wait()
    for value in range(100):
        session.set("gravity", float(value))
    for _ in range(2 * MOST_ASKED):
        session.ask(lambda playground: hold.append(1))
    free.set()
    until(lambda: session.picture.scene.gravity == 99.0, "the last value")
    assert len(hold) < MOST_ASKED


def test_who_asks_for_much_does_not_stop_time(session):
    frames = []

    def wish(playground) -> None:
        time.sleep(0.02)
        frames.append(playground.frame)

    for _ in range(50):
        session.ask(wish)
    until(lambda: len(frames) == 50, "all are granted")
    assert len(set(frames)) > 3


def test_a_recording_is_a_valid_stage(session, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "balloon_warp.studio.page.session.write_recording", lambda *_: pytest.fail("it is written here")
    )
    until(lambda: session.picture.frame.number > 3, "some frames")
    session.record(True)
    session.ask(lambda playground: playground.throw(np.array([0, 1.5, 0]), np.array([0, -5, 0]), 0.2, 1.0))
    session.set("balloon.helium", 12.0)
    goes_on(session, 20)
    session.record(False)
    until(lambda: session.recording is None, "it ends")
    until(lambda: any("wrote" in notice for notice in session.notices), "it is written")
    stage = Usd.Stage.Open(str(tmp_path / "ball_1.usdc"))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/World/mesh")).GetPointsAttr()
    times = points.GetTimeSamples()
    assert times[0] == stage.GetStartTimeCode() == 0
    assert_valid(stage)
    said = stage.GetRootLayer().customLayerData["balloonWarp"]
    assert {"scene", "files", "substeps", "versions"} <= set(said)
    assert said["firstFrame"] > 3
    session.run(False)


def test_a_recorded_scene_file_replays_its_stage(tmp_path):
    session = Session("squirrel", load_scene("squirrel_tether"), "cpu", tmp_path)
    session.watched = True
    session.start()
    session.record(True)
    session.set("gravity", 5.0)
    until(lambda: session.picture.frame.number > 8, "it records")
    session.stop()  # which saves it
    stage = Usd.Stage.Open(str(tmp_path / "squirrel_1.usdc"))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/World/squirrel")).GetPointsAttr()
    first = stage.GetRootLayer().customLayerData["balloonWarp"]["firstFrame"]
    frames = list(Simulator(load_scene(tmp_path / "squirrel_1.toml"), "cpu").run())
    kept = [frame for frame in frames if frame.number - first in points.GetTimeSamples()]
    for frame in kept:
        np.testing.assert_array_equal(np.array(points.Get(frame.number - first)), frame.points[0])
    assert len(kept) > 5


PAGE = """
import sys, time
import numpy as np
import warp as wp
from browsing import tethered
from balloon_warp.studio.page.playground import KernelPrecompiler
from balloon_warp.studio.page.playground import Playground

wp.config.optimization_level = 0
playground, ahead = Playground(tethered(), "cpu"), KernelPrecompiler()
playground.step()
ahead.begin(playground.start, "cpu")
print("process", ahead._process and ahead._process.pid, flush=True)
"""
"""start of the page, with kernels that stay as they are written: it is about which are compiled"""
PLAYED = (
    PAGE
    + """
while ahead.busy:
    time.sleep(0.05)
from pathlib import Path
kernels = lambda: {path for path in Path(sys.argv[1]).rglob("*.o")}
before = kernels()
playground.throw(playground.points.mean(axis=0) + [0.0, 2.0, 0.0], np.zeros(3), 0.2, 1.0)
playground.step()
playground.grab("hand", 5, playground.points[5] + [0.0, 0.2, 0.0])
playground.step()
playground.keep_stable = False
playground.inflate(1e9)
print(playground.step()())
print("compiled", sorted(map(str, kernels() - before)))
ahead.end()
"""
)


def page(folder: Path, script: str) -> subprocess.Popen:
    """Start a process with a kernel cache of its own, in a folder."""
    found = {**os.environ, "WARP_CACHE_PATH": str(folder), "PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "-c", script, str(folder)]
    return subprocess.Popen(command, env=found, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def is_there(process: int) -> bool:
    """Return whether a process lives: one that ended and waits to be noticed does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_first_touch_compiles_nothing(tmp_path):
    said, wrong = page(tmp_path, PLAYED).communicate(timeout=600)
    assert "compiled []" in said, wrong
    assert "the simulation blew up in frame 4" in said
    assert list(tmp_path.rglob("balloon_warp_ahead_*"))
    said, wrong = page(tmp_path, PLAYED).communicate(timeout=600)
    assert "process None" in said, wrong


@pytest.mark.parametrize("killed", [False, True])
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks /proc")
def test_the_process_ends_with_the_page(killed: bool, tmp_path):
    process = page(tmp_path, PAGE + ("time.sleep(600)" if killed else "time.sleep(4.0); ahead.end()"))
    assert process.stdout
    ahead = int(process.stdout.readline().split()[1])
    assert is_there(ahead)
    time.sleep(3.0)  # it compiles
    if killed:
        process.kill()
    process.communicate(timeout=60)
    until(lambda: not is_there(ahead), "it ends, too")
    assert list(tmp_path.rglob(f"*_p{ahead}_*")) == []


def on_a_string(**fields) -> Scene:
    fields = {"ground": Ground(height=-1.0), "normals": "cached"} | fields
    inflation = Inflation(k_normal=[(0.0, 0.2), (9.0, 1.0)])
    ball = Balloon(mesh=quad_sphere(4, 0.5), helium=10.0, inflation=inflation)
    return Scene(balloon=[ball], string=[String(anchor=(0.0, -1.0, 0.0))], **fields)


def steps(playground: Playground, count: int) -> None:
    for _ in range(count):
        if find_reason := playground.step():
            raise BlowUpError(find_reason())


def replayed(playground: Playground) -> Simulator:
    """Return the journal's scene, simulated from its start to the playground's frame."""
    simulator = Simulator(playground.journal.scene(playground.frame), str(playground.simulator.model.device))
    advanced(simulator, playground.frame)
    return simulator


def volume(playground: Playground) -> float:
    return float(np.linalg.norm(playground.points - playground.points.mean(axis=0), axis=1).mean() ** 3)


def play_with_all(playground: Playground) -> None:
    """Play with everything that a hand can do, in some order."""
    steps(playground, 3)
    playground.set("balloon.inflation.k_normal", 0.8)
    playground.set("balloon.helium", 12.0)
    steps(playground, 2)
    playground.throw(np.array([0.0, 1.5, 0.0]), np.array([0.0, -6.0, 0.0]), 0.2, 1.0)
    steps(playground, 4)
    playground.grab("left", 7, playground.points[7] + [0.3, 0.0, 0.0])
    steps(playground, 2)
    playground.pull("left", playground.points[7] + [0.6, 0.1, 0.0])
    playground.set("balloon.stiffness.structural", 90.0)
    steps(playground, 3)
    playground.release("left")
    playground.cut_all()
    playground.set("normals", "fresh")
    steps(playground, 3)
    playground.tie(3, playground.points[3] - [0.0, 0.4, 0.0])
    for number in range(MOST_THROWN + 1):
        playground.throw(np.array([2.0, 1.5 + number, 0.0]), np.zeros(3), 0.1, 1.0)
    steps(playground, 3)


def assert_replayed(device, replay, played):
    """Require the same bits; on a GPU, where kernels depend on the number of spheres, the same up to rounding."""
    np.testing.assert_allclose(replay, played, rtol=0, atol=0 if device == "cpu" else 1e-4 * np.abs(played).max())


def test_the_journal_replays(device):
    playground = Playground(on_a_string(), device)
    play_with_all(playground)
    again = replayed(playground)
    assert_replayed(device, again.state.points.numpy()[0], playground.points)
    assert_replayed(device, again.state.velocities.numpy(), playground.simulator.state.velocities.numpy())


def test_the_default_pressure_is_a_number_that_stays(device):
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(4, 0.5))], frames_per_second=4.0)
    playground = Playground(scene, device)
    steps(playground, 4)
    risen = playground.inflation
    assert risen == pytest.approx(playground.start.balloon[0].inflation.keyframes[-1][1])
    assert risen > 0.0
    playground.set("balloon.stiffness.structural", 35.0)
    steps(playground, 2)
    assert playground.inflation == risen
    np.testing.assert_array_equal(replayed(playground).state.points.numpy()[0], playground.points)
    playground.inflate(0.5 * risen)
    assert playground.inflation == pytest.approx(0.5 * risen)


@pytest.mark.parametrize("touched", [0, 4])
def test_touching_ends_what_was_planned(device, touched):
    planned = [Change(time=2 / 60, set={"gravity": 3.0}), Change(time=6 / 60, set={"gravity": 50.0})]
    late = [Sphere(position=(0.0, 0.0, 0.0), radius=0.6, start=7 / 60), Sphere(position=(0, 5, 0), end=8 / 60)]
    playground = Playground(on_a_string(change=planned, sphere=late), device)
    steps(playground, touched)
    playground.set("balloon.helium", 9.0)
    gravity = 3.0 if touched else 9.81
    assert playground.live.gravity == gravity
    assert len(playground.live.sphere) == 1
    steps(playground, 10 - touched)
    assert float(playground.simulator.model.parameters["gravity"].numpy()[0]) == pytest.approx(gravity)
    assert_replayed(device, replayed(playground).state.points.numpy()[0], playground.points)


def test_a_hand_pulls_the_balloon(device):
    playground = Playground(on_a_string(ground=None), device)
    playground.cut_all()
    still = Playground(on_a_string(ground=None), device)
    still.cut_all()
    playground.grab("hand", 0, playground.points[0] + [1.0, 0.0, 0.0])
    for each in (playground, still):
        steps(each, 20)
    assert playground.points[:, 0].mean() > still.points[:, 0].mean() + 0.05
    playground.release("hand")
    assert (playground.live.string, playground.hands) == ([], {})


def test_a_moment_brings_everything_back(device):
    playground = Playground(on_a_string(), device)
    steps(playground, 3)
    playground.throw(np.array([0.0, 1.5, 0.0]), np.array([0.0, -6.0, 0.0]), 0.2, 1.0)
    steps(playground, 5)
    moment = playground.moment()
    steps(playground, 4)
    expected = playground.points.copy()
    playground.set("balloon.inflation.k_normal", 5.0)
    playground.throw(np.array([3.0, 1.5, 0.0]), np.zeros(3), 0.2, 1.0)
    steps(playground, 4)
    playground.return_to(moment)
    assert playground.frame == 8
    steps(playground, 4)
    assert_replayed(device, playground.points, expected)
    assert_replayed(device, replayed(playground).state.points.numpy()[0], expected)


def test_stiffer_springs_get_more_substeps_unless_told_not_to():
    playground = Playground(on_a_string(), "cpu")
    few = playground.simulator.model.substeps
    playground.set("balloon.stiffness.structural", 2000.0)
    assert playground.simulator.model.substeps > few
    steps(playground, 30)
    playground.reset()
    playground.keep_stable = False
    playground.set("balloon.stiffness.structural", 1e6)
    assert playground.simulator.model.substeps == few
    moment = playground.moment()
    with pytest.raises(BlowUpError, match="blew up"):
        steps(playground, 60)
    playground.return_to(moment)
    playground.set("balloon.stiffness.structural", 20.0)
    steps(playground, 30)
    assert np.isfinite(playground.points).all()


def test_what_takes_too_many_substeps_is_refused_unless_they_stay():
    playground = Playground(on_a_string(), "cpu")
    with pytest.raises(InputError, match=r"^a stable step needs [0-9,]+ substeps a frame, too many for real time"):
        playground.set("balloon.stiffness.structural", 1e7)
    playground.step()
    playground.keep_stable = False
    playground.set("balloon.stiffness.structural", 1e7)


def test_a_journal_does_not_grow_forever(monkeypatch):
    monkeypatch.setattr(journal, "LONGEST", 5)
    playground = Playground(on_a_string(), "cpu")
    for value in range(9):
        playground.set("gravity", float(value))
        playground.step()
    assert len(playground.journal.changes) == 5
    with pytest.raises(InputError, match="the journal of changes is full, at 5 entries"):
        playground.journal.scene(9)


SLOW = ("airbag", "balloon_pit", "bunch_in_wind", "letter_slot", "press")
QUICK = [name for name in bundled_scenes() if name not in SLOW]


def test_foil_keeps_the_modulus_that_it_was_planned_with():
    """Strain is bounded at the largest pressure of the scene, whatever a slider says as a ball is thrown."""
    blown = Inflation(pressure=[(0.0, 0.0), (1.0, 50.0)])
    foil = Balloon(mesh=quad_sphere(4), material=Material(preset="foil"), inflation=blown)
    playground = Playground(Scene(balloon=[foil], touch=False), "cpu")
    steps(playground, 1)
    model = playground.simulator.model
    playground.inflate(2.0)
    playground.throw(np.array([0.0, 3.0, 0.0]), np.zeros(3), 0.1, 1.0)
    steps(playground, 1)
    again = playground.simulator.model
    assert again.parameters["shear_modulus"].numpy() == model.parameters["shear_modulus"].numpy()
    np.testing.assert_array_equal(replayed(playground).state.points.numpy()[0], playground.points)


@pytest.mark.parametrize("name", nightly_but(QUICK, bundled_scenes()))
def test_bundled_scenes_can_be_played_with(name):
    if name not in some_bundled_scenes():
        pytest.skip("has nothing that others do not have")
    playground = Playground(load_scene(name), "cpu")
    steps(playground, 2)
    playground.inflate(0.5 * playground.inflation + 0.001)
    center = playground.points.mean(axis=0)
    playground.throw(center + [0.0, 2.0 * playground.size, 0.0], np.zeros(3), 0.1 * playground.size, 1.0)
    for hand, particle in (("left", 5), ("right", 9)):
        playground.grab(hand, particle, playground.points[particle] + [0.0, 0.1 * playground.size, 0.0])
    steps(playground, 2)
    playground.release("left")  # with no hand left, other kernels would be compiled
    steps(playground, 1)
    assert np.isfinite(playground.points).all()
    np.testing.assert_array_equal(replayed(playground).state.points.numpy()[0], playground.points)

"""Changes to a running simulation, and the scene that replays them."""

from pathlib import Path

import numpy as np
import pytest
from conserved import advanced
from costs import nightly_but
from features import some_bundled_scenes
from meshes import quad_sphere

from balloon_warp import Balloon, BlowUpError, Change, Ground, Inflation, InputError, Scene, Sphere, String, load_scene
from balloon_warp.scene.load import bundled_scenes
from balloon_warp.scene.write import scene_toml
from balloon_warp.simulator import Simulator
from balloon_warp.studio.page import playground as journal
from balloon_warp.studio.page.playground import MOST_THROWN, Playground


def on_a_string(**fields) -> Scene:
    fields = {"ground": Ground(height=-1.0), "normals": "cached"} | fields
    inflation = Inflation(k_normal=[(0.0, 0.2), (9.0, 1.0)])
    ball = Balloon(mesh=quad_sphere(4, 0.5), helium=10.0, inflation=inflation)
    return Scene(balloon=[ball], string=[String(anchor=(0.0, -1.0, 0.0))], **fields)


def steps(playground: Playground, count: int) -> None:
    for _ in range(count):
        playground.step()


def replayed(playground: Playground) -> Simulator:
    """Return the journal's scene, simulated from its start to the playground's frame."""
    simulator = Simulator(playground.journal.scene(playground.frame), str(playground.simulator.model.device))
    advanced(simulator, playground.frame)
    return simulator


def volume(playground: Playground) -> float:
    return float(np.linalg.norm(playground.points - playground.points.mean(axis=0), axis=1).mean() ** 3)


def play(playground: Playground) -> None:
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


def rewritten(scene: Scene, folder: Path) -> Scene:
    """Return a scene, written to a file and read again."""
    path = folder / "again.toml"
    path.write_text(scene_toml(scene, folder), encoding="utf-8")
    return load_scene(path)


def assert_replayed(device, replay, played):
    """Require the same bits; on a GPU, where kernels depend on the number of spheres, the same up to rounding."""
    np.testing.assert_allclose(replay, played, rtol=0, atol=0 if device == "cpu" else 1e-4 * np.abs(played).max())


def test_the_journal_replays(device):
    playground = Playground(on_a_string(), device)
    play(playground)
    again = replayed(playground)
    assert_replayed(device, again.state.points.numpy()[0], playground.points)
    assert_replayed(device, again.state.velocities.numpy(), playground.simulator.state.velocities.numpy())


def test_the_journal_replays_from_its_file(device, tmp_path):
    playground = Playground(load_scene("squirrel_tether"), device)
    steps(playground, 2)
    playground.set("gravity", 1.0 / 3.0)
    playground.grab("hand", 100, playground.points[100] + [0.1, 0.0, 0.0])
    steps(playground, 2)
    again = advanced(Simulator(rewritten(playground.journal.scene(4), tmp_path), device), 4)
    assert_replayed(device, again.points[0], playground.points)


@pytest.mark.parametrize("name", bundled_scenes())
def test_a_scene_survives_being_written(name, tmp_path):
    assert rewritten(load_scene(name), tmp_path) == load_scene(name)


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


def test_odd_texts_survive_being_written(tmp_path):
    mesh = Path(bundled_scenes()["squirrel_inflate"]).parent / "squirrel.obj"
    scene = Scene(description='"quoted" \\ \n \u0007 é', balloon=[Balloon(mesh=mesh)])
    assert rewritten(scene, tmp_path) == scene


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


def test_an_untouched_scene_is_played_as_planned(device):
    later, late = [Change(time=2 / 60, set={"gravity": 50.0})], [Sphere(position=(0, 0, 0), start=3 / 60)]
    playground = Playground(on_a_string(change=later, sphere=late), device)
    steps(playground, 6)
    np.testing.assert_array_equal(replayed(playground).state.points.numpy()[0], playground.points)
    assert playground.simulator.model.parameters["gravity"].numpy() == 50.0


def test_a_thrown_sphere_dents_the_balloon(device):
    playground = Playground(on_a_string(), device)
    steps(playground, 10)
    before = volume(playground)
    top = playground.points[:, 1].max()
    playground.throw(np.array([0.0, top + 0.3, 0.0]), np.array([0.0, -4.0, 0.0]), 0.25, 2.0)
    steps(playground, 10)
    assert playground.points[:, 1].max() < top - 0.1
    assert volume(playground) != before


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


def test_reset_goes_back_to_the_start(device):
    playground = Playground(on_a_string(), device)
    start = playground.moment()
    play(playground)
    playground.reset()
    assert playground.frame == 0
    assert playground.live is playground.start
    for name, values in playground.moment().state.items():
        np.testing.assert_array_equal(values, start.state[name], err_msg=name)


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


def test_every_solver_and_correction_replays(device):
    playground = Playground(on_a_string(), device)
    for field, values in (("solver", ("projective", "symplectic_euler")), ("correction", ("provot", "none"))):
        for value in values:
            playground.set(field, value)
            steps(playground, 2)
            playground.throw(np.array([2.0, 1.5, 0.0]), np.zeros(3), 0.1, 1.0)
            steps(playground, 2)
    assert_replayed(device, replayed(playground).state.points.numpy()[0], playground.points)


@pytest.mark.parametrize(("path", "value"), [("balloon.mass", -1.0), ("balloon.helium", "a lot"), ("nonsense", 1.0)])
def test_a_wrong_value_changes_nothing(path, value):
    playground = Playground(on_a_string(), "cpu")
    with pytest.raises(InputError):
        playground.set(path, value)
    assert playground.live is playground.start
    playground.step()


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


def test_wind_carries_a_balloon_along(device):
    playground = Playground(on_a_string(ground=None), device)
    steps(playground, 2)
    was = playground.points[:, 0].mean()
    playground.blow([5.0, 0.0, 0.0])
    steps(playground, 20)
    assert playground.points[:, 0].mean() > was + 0.05

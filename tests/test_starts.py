"""Worlds that begin anew, by a mask or by themselves; a balloon's default inflation, placement, springs and strings."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from feature_sets import SETS, feature_set
from meshes import cube, joined, mesh_of, open_cube, quad_sphere
from trajectories import shape_at, stepped

from balloon_warp import Inflation, InputError, Simulator, Stiffness
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import Vary, plan_model
from balloon_warp.model.starts import start_velocities
from balloon_warp.scene import Balloon, Body, Change, Ground, Material, Neck, Obstacle, Scene, Sphere, String
from balloon_warp.system.files import write_npz

BALL = Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(pressure=5.0), velocity=(0.0, -1.0, 0.0))
GAS = Balloon(mesh=quad_sphere(3, 0.4), position=(0.0, 1.1, 0.0), inflation=Inflation(kind="gas"))
TOUCHING = Scene(
    balloon=[BALL, GAS],
    sphere=[Sphere(position=(0.0, -0.9, 0.0), radius=0.35)],
    body=[Body(shape="box", size=(0.2, 0.2, 0.2), position=(2.0, 1.0, 0.0))],
    ground=Ground(height=-1.3),
    contacts=True,
)
ALONE = Scene(balloon=[BALL], substeps=24)


def arrays(simulator: Simulator) -> dict[str, np.ndarray]:
    return {name: array.numpy().copy() for name, array in simulator.state.arrays.items() if name != "frame"}


def begun_anew(scene: Scene, schedule: str, resets: tuple[int, ...], frames: int) -> tuple[Simulator, ...]:
    """Require that a world that begins anew is, bit for bit, as one that begins, while the other goes on.

    Args:
        resets: Frames before each of the times that the second world begins anew.
        frames: Those after the last.

    Returns: Two worlds that only went on, two of which the second began anew, and one that only began."""
    whole, masked = (Simulator(scene, "cpu", 2, schedule=schedule) for _ in range(2))
    stepped(whole, sum(resets) + frames)
    for before in resets:
        stepped(masked, before).reset([0, 1])
    stepped(masked, frames)
    fresh = stepped(Simulator(scene, "cpu", 1, schedule=schedule), frames)
    require_same(masked, fresh, slice(1, 2))
    require_same(masked, whole, slice(0, 1), slice(0, 1))
    return whole, masked, fresh


def require_same(found: Simulator, expected: Simulator, of: slice = slice(None), like: slice = slice(None)) -> None:
    """Require the same states, bit for bit, of some worlds of one simulator and another."""
    other = arrays(expected)
    for name, array in arrays(found).items():
        np.testing.assert_array_equal(array[of], other[name][like], err_msg=name)


MISTAKES = {
    "a name": (("balloon.mas", 0.0, 1.0), r"balloon\.mas: cannot change"),
    "a kind": (("balloon.damping", 0.0, 1.0, "even"), r"damping: kind must be one of uniform, log_uniform, normal"),
    "no number": (("balloon.damping", 0.0, np.nan), r"damping: must be drawn by finite numbers \(got 0\.0 and nan\)"),
    "an order": (("balloon.damping", 2.0, 1.0), r"damping: must be drawn from the least to the largest"),
    "a logarithm": (("balloon.damping", 0.0, 1.0, "log_uniform"), r"damping: must be above 0 where its logarithm"),
    "a rotation": (("balloon.rotation", 0.0, 1.0), r"balloon\.rotation: cannot be drawn on the device"),
    "late": (("sphere.1.position", 0.0, 1.0), r"sphere\.1\.position: cannot be drawn for a sphere that appears"),
    "a gas": (("balloon.1.position", 0.0, 1.0), r"balloon\.1\.position: cannot be drawn for a balloon of gas"),
}


def test_a_world_that_begins_anew_is_as_one_that_begins(schedule: str):
    scene = TOUCHING if schedule == "gather" else TOUCHING.model_copy(update={"contacts": False, "body": []})
    begun_anew(scene, schedule, (5,), 3)


def test_rows_that_do_not_fill_words_begin_anew_beside_those_that_do():
    """The state of 138 particles has rows of bytes, 138 long, and of words: all are as at the start, to the bit."""
    simulator = Simulator(feature_set("touch"), "cpu", 2, schedule="octets")
    assert simulator.state.deep.shape == (2, 138)
    began = {name: array.copy() for name, array in arrays(simulator).items()}
    stepped(simulator, 8)
    simulator.reset(np.array([True, False]))
    for name, array in arrays(simulator).items():
        if array.shape[:1] == (2,):
            np.testing.assert_array_equal(array[0], began[name][0], err_msg=name)


def test_the_fastest_world_bounds_how_fast_particles_begin():
    scene = Scene(balloon=[Balloon(mesh=cube())])
    vary = {"balloon.0.velocity.1": [0.0, -4.0, 1.0], "balloon.0.angular_velocity.0": [2.0, 0.0, 0.0]}
    plan = plan_model(scene, 3, vary)
    (fastest,) = start_velocities(plan.shapes, plan.parameters) or []
    arms = np.linalg.norm(plan.shapes[0].mesh.points - plan.shapes[0].mesh.points.mean(axis=0), axis=1)
    np.testing.assert_allclose(np.linalg.norm(fastest, axis=1), 4.0 + 2.0 * arms)


@pytest.mark.full
def test_what_varies_between_worlds_begins_as_it_began():
    vary = {"balloon.0.velocity.1": [-1.0, -2.0, -3.0], "balloon.1.inflation.start_pressure": [0.0, 50.0, 90.0]}
    simulator = Simulator(TOUCHING, "cpu", 3, vary)
    began = arrays(simulator)
    stepped(simulator, 2).reset(np.array([True, True, True]))
    for name, array in arrays(simulator).items():
        np.testing.assert_array_equal(array, began[name], err_msg=name)


def drawing(world_count: int, seed: int = 0) -> Simulator:
    simulator = Simulator(ALONE, "cpu", world_count)
    simulator.starts.seed = seed
    simulator.starts.draw("balloon.inflation.pressure", 3.0, 7.0)
    simulator.starts.draw("balloon.mass", 0.1, 0.4, "log_uniform")
    simulator.starts.draw("balloon.position", -0.2, 0.2)
    simulator.starts.draw("balloon.velocity.0", 1.0, 0.5, "normal")
    return simulator


def drawn(simulator: Simulator) -> dict[str, np.ndarray]:
    return {
        "pressure": simulator.controls["balloon.inflation.pressure"].numpy().copy(),
        "mass": simulator.controls["balloon.mass"].numpy().copy(),
        "center": simulator.observations["centers"].numpy()[:, 0].copy(),
        "velocity": simulator.observations["velocities"].numpy()[:, 0].copy(),
    }


def test_values_follow_from_the_seed_the_world_and_the_episode():
    many, few, other = drawing(64), drawing(3), drawing(3, seed=1)
    episodes = []
    for _ in range(2):
        for simulator in (many, few, other):
            simulator.reset(np.ones(simulator.model.world_count))
        episodes.append(drawn(many))
        for name, values in drawn(few).items():
            np.testing.assert_array_equal(values, episodes[-1][name][:3])
            assert not np.array_equal(values, drawn(other)[name])
    assert all(not np.array_equal(values, episodes[1][name]) for name, values in episodes[0].items())
    assert few.starts.episodes.numpy().tolist() == [2, 2, 2]


def test_values_have_the_distribution_that_is_asked():
    """Means are within four of their standard errors, of 256 worlds."""
    simulator = drawing(256)
    simulator.reset(np.ones(256))
    found = drawn(simulator)
    error = 4.0 / np.sqrt(256)
    assert abs(found["pressure"].mean() - 5.0) < error * 4.0 / np.sqrt(12.0)
    assert abs(np.log(found["mass"]).mean() - np.log(0.2)) < error * np.log(4.0) / np.sqrt(12.0)
    assert abs(found["velocity"][:, 0].mean() - 1.0) < error * 0.5
    assert found["pressure"].min() >= 3.0
    assert found["mass"].max() <= np.float32(0.4)
    assert (np.abs(found["center"] - found["center"].mean(axis=0)) < 0.21).all()
    assert abs(np.corrcoef(found["center"].T)[0, 1]) < error


def test_worlds_are_what_the_values_say():
    simulator = drawing(4)
    simulator.reset(np.ones(4))
    found = drawn(simulator)
    vary = {
        "balloon.inflation.pressure": found["pressure"],
        "balloon.mass": found["mass"],
        "balloon.velocity.0": found["velocity"][:, 0],
    }
    alike = Simulator(ALONE, "cpu", 4, vary)
    moved = stepped(simulator, 1).state.points.numpy() - stepped(alike, 1).state.points.numpy()
    np.testing.assert_allclose(moved, np.broadcast_to(moved[:, :1], moved.shape), atol=2e-6)


@pytest.mark.full
@pytest.mark.parametrize("case", MISTAKES)
def test_what_cannot_be_drawn_is_refused(case: str):
    told, sentence = MISTAKES[case]
    late = Sphere(position=(3.0, 0.0, 0.0), radius=0.1, start=0.5)
    simulator = Simulator(TOUCHING.model_copy(update={"sphere": [*TOUCHING.sphere, late]}), "cpu", 2)
    with pytest.raises(InputError, match=sentence):
        simulator.starts.draw(*told)


@pytest.mark.full
def test_observations_are_what_frames_say():
    simulator = Simulator(TOUCHING, "cpu", 2, {"balloon.0.mass": [0.1, 0.2]})
    names = ("centers", "velocities", "volumes", "pressures", "contact_forces", "sphere_positions", "body_positions")
    seen = {name: simulator.observations[name] for name in names}
    chosen = simulator.observations.particles([3, 60])
    for frame_number in range(4):
        frame = simulator.read_frame(1)
        centers = [points.mean(axis=0) for points in frame.points]
        np.testing.assert_allclose(seen["centers"].numpy()[1], centers, atol=1e-6)
        np.testing.assert_allclose(seen["velocities"].numpy()[1], [v.mean(axis=0) for v in frame.velocities], atol=1e-6)
        volumes = [signed_volume(shape_at(simulator.model, frame, number)) for number in range(2)]
        np.testing.assert_allclose(seen["volumes"].numpy()[1], volumes, rtol=1e-5)
        np.testing.assert_array_equal(seen["pressures"].numpy()[1], frame.pressures)
        np.testing.assert_array_equal(chosen.numpy()[1], np.concatenate(frame.points)[[3, 60]])
        assert all(simulator.observations[name] is array for name, array in seen.items())
        if frame_number == 2:
            simulator.reset()
        else:
            stepped(simulator, 3)


def test_contact_forces_on_particles_add_up_to_those_on_the_balloon():
    wall = Obstacle(shape="plane", position=(-0.5, 0.0, 0.0), rotation=(0.0, 0.0, -90.0))
    ball = BALL.model_copy(update={"position": (0.0, 0.5, 0.0), "velocity": (-1.0, -1.0, 0.0)})
    scene = Scene(balloon=[ball], obstacle=[wall], ground=Ground(), contacts=True)
    simulator = Simulator(scene, "cpu", 2, {"balloon.mass": [0.1, 0.3]})
    forces, of_pairs = (simulator.observations[name] for name in ("particle_contact_forces", "contact_forces"))
    net = np.zeros(0)
    for _ in range(4):
        stepped(simulator, 1)
        net = of_pairs.numpy()[:, 0].sum(axis=1)
        np.testing.assert_allclose(forces.numpy().sum(axis=1), net, rtol=1e-5, atol=1e-5 * np.abs(net).max())
    touching = np.abs(forces.numpy()).sum(axis=-1) > 0.0
    assert 0.0 < touching.mean() < 0.5
    points = simulator.state.points.numpy()[touching]
    assert ((points[:, 0] < -0.3) | (points[:, 1] < 0.2)).all()
    assert (of_pairs.numpy()[:, 0].sum(axis=1)[:, :2] > 0.0).all()


NOT_THERE: list[tuple[Callable[[Simulator], Any], str]] = [
    (lambda of: of.observations["center"], r"center: no such observation; known are centers, velocities, turns, vol"),
    (lambda of: of.observations["contact_forces"], r"contact_forces: needs contacts = true in the scene"),
    *(
        (lambda of, numbers=numbers: of.observations.particles(numbers), r"particles: must be numbers from 0 to 55")
        for numbers in ([56], [], [0.5])
    ),
    *(
        (lambda of, mask=mask: of.reset(mask), r"reset: expected a (value|number) for each world")
        for mask in ([1], "all", [0, 1, 0])
    ),
]


@pytest.mark.parametrize(("ask", "sentence"), NOT_THERE)
def test_what_is_not_there_is_neither_observed_nor_begun_anew(ask: Callable[[Simulator], Any], sentence: str):
    with pytest.raises(InputError, match=sentence):
        ask(Simulator(ALONE, "cpu", 2))


def test_a_cube_has_its_volume():
    still = Balloon(mesh=cube(), position=(100.0, 0.0, 0.0), inflation=Inflation(pressure=0.0))
    simulator = Simulator(Scene(balloon=[still], touch=False), "cpu")
    expected = signed_volume(cube())
    np.testing.assert_allclose(simulator.observations["volumes"].numpy(), [[expected]], rtol=1e-5)


@pytest.mark.full
def test_only_worlds_that_begin_anew_are_observed_again(device: str):
    simulator = Simulator(TOUCHING, device, 3)
    names = ("centers", "velocities", "volumes", "stretches", "turns", "pressures", "points", "particle_contact_forces")
    seen = {name: simulator.observations[name] for name in (*names, "obstacle_positions", "first_bad")}
    seen["chosen"] = simulator.observations.particles([3, 60])
    camera = simulator.observations.camera((0.0, 1.0, 4.0), (0.0, 0.5, 0.0), 16, 12)
    seen |= {"depth": camera.depth, "color": camera.color}
    began = {name: np.array(array.numpy()) for name, array in seen.items()}
    stepped(simulator, 3)
    for array in seen.values():
        array.fill_(7)
    simulator.reset([0, 1, 0])
    for name, array in seen.items():
        np.testing.assert_array_equal(array.numpy()[1], began[name][1], err_msg=name)
        assert (array.numpy()[::2] == 7).all(), name


def test_a_saved_simulator_draws_next_what_it_would_have_drawn():

    def drawn(simulator: Simulator) -> wp.array:
        simulator.starts.draw("balloon.damping", 0.1, 0.9)
        return simulator.starts.value("goal", 0.0, 1.0)

    simulator, other = (Simulator(ALONE, "cpu", 2) for _ in range(2))
    goals = {id(each): drawn(each) for each in (simulator, other)}
    simulator.starts.seed = 7
    for mask in ([1, 1], [0, 1], [0, 1]):
        simulator.step_unread()
        simulator.reset(mask)
    saved = simulator.save()
    kept = goals[id(simulator)].numpy().copy()

    def next_of(each: Simulator) -> tuple[np.ndarray, np.ndarray]:
        each.step_unread()
        each.reset([1, 1])
        return each.controls["balloon.damping"].numpy().copy(), goals[id(each)].numpy().copy()

    told = next_of(simulator)
    for each in (other, simulator):
        each.restore(saved)
        np.testing.assert_array_equal(goals[id(each)].numpy(), kept)
        np.testing.assert_array_equal(next_of(each), told)
    assert len(np.unique([*kept, *told[1]])) == 4


SAVED_FRAMES, SAVED_AT, WORLDS = 6, 3, 3
SECONDS = 1 / 60
"""of a frame"""
TIED = Scene(
    balloon=[Balloon(mesh=quad_sphere(3), position=(0.0, 1.2, 0.0), inflation=Inflation(k_normal=0.2))],
    normals="cached",
    string=[String(anchor=(0.0, 0.0, 0.0), length=0.1)],
    ground=Ground(),
)
CHANGES = [
    Change(time=SECONDS, set={"gravity": 3.0}),
    Change(time=2 * SECONDS, set={"normals": "fresh"}),
    Change(time=SAVED_AT * SECONDS, set={"balloon.damping": 0.5}),
]
TO_PROJECTIVE = Change(time=2 * SECONDS, set={"solver": "projective", "substeps": 4})
CHANGING = {
    "changes": TIED.model_copy(update={"change": CHANGES}),
    "changes of solver": TIED.model_copy(update={"change": [TO_PROJECTIVE]}),
    "projective": TIED.model_copy(update={"solver": "projective"}),
}
WAYS = [(name, "auto") for name in (*SETS, *CHANGING)]
WAYS += [(name, by) for name in ("paper", "all", "changes") for by in ("gather", "lanes", "block")]
"""Sets or scenes that change, and schedules"""


def simulators(way: tuple[str, str], device: str) -> list[Simulator]:
    name, schedule = way
    if device != "cpu" and schedule == "lanes":
        pytest.skip("simulates on the CPU")
    vary: Vary = {"balloon.0.velocity.1": 0.1 * np.arange(WORLDS)}
    of = CHANGING[name] if name in CHANGING else feature_set(name)
    return [Simulator(of, device, WORLDS, vary, schedule) for _ in range(2)]


def bytes_of(simulator: Simulator) -> dict[str, bytes]:
    return {name: array.numpy().tobytes() for name, array in simulator.state.arrays.items()}


@pytest.mark.full
@pytest.mark.parametrize("way", WAYS, ids="-".join)
def test_the_same_bits_follow(way: tuple[str, str], device: str, tmp_path):
    left, restored = simulators(way, device)
    stepped(left, SAVED_AT)
    scene_then = left.model.scene
    write_npz(tmp_path / "state.npz", ((name, array.numpy()) for name, array in left.state.arrays.items()))
    stepped(left, SAVED_FRAMES - SAVED_AT)
    with np.load(tmp_path / "state.npz") as saved:
        restored.restore(saved)
    assert restored.frame_number == SAVED_AT
    assert restored.model.scene == scene_then
    assert bytes_of(restored) != bytes_of(left)
    stepped(restored, SAVED_FRAMES - SAVED_AT)
    assert bytes_of(restored) == bytes_of(left)
    assert restored.frame_number == SAVED_FRAMES


def test_a_world_that_blew_up_is_still_known(device: str):
    bad = Scene(balloon=[Balloon(mesh=cube(), inflation=Inflation(pressure=0.2))])
    vary: Vary = {"balloon.inflation.pressure": [0.2, 9e11]}
    left, restored = (Simulator(bad, device, 2, vary) for _ in range(2))
    for _ in range(3):
        left.advance()
    restored.restore({name: array.numpy() for name, array in left.state.arrays.items()})
    np.testing.assert_array_equal(restored.state.first_bad.numpy(), left.state.first_bad.numpy())
    assert restored.state.first_bad.numpy()[0] != restored.state.first_bad.numpy()[1]


def test_what_a_scene_does_not_have_need_not_be_saved():
    """A checkpoint is such from before balloons could touch."""
    simulator = stepped(Simulator("squirrel_tether", "cpu"), 1)
    saved = {name: array.numpy() for name, array in simulator.state.arrays.items() if array.size}
    assert "holds" not in saved
    again = Simulator("squirrel_tether", "cpu")
    again.restore(saved)
    np.testing.assert_array_equal(again.read_frame().points[0], simulator.read_frame().points[0])


PLANNED = ALONE.model_copy(
    update={
        "change": [
            Change(time=2 / 60, set={"gravity": 1.0, "balloon.inflation.pressure": 8.0}),
            Change(time=4 / 60, set={"gravity": 4.0, "atmosphere.wind": [1.0, 0.0, 2.0], "balloon.damping": 0.4}),
        ]
    }
)


def test_planned_changes_come_in_a_worlds_own_time(schedule: str) -> None:
    _, masked, fresh = begun_anew(PLANNED, schedule, (3, 1), 6)
    masked.reset()
    require_same(stepped(masked, 6), fresh, slice(0, 1))


def test_worlds_of_different_times_are_saved_and_restored() -> None:
    simulator = stepped(Simulator(PLANNED, "cpu", 2), 3)
    simulator.reset([0, 1])
    saved = stepped(simulator, 1).save()
    stepped(simulator, 4)
    other = Simulator(PLANNED, "cpu", 2)
    for each in (other, simulator):
        each.restore(saved)
        require_same(stepped(each, 4), simulator if each is other else other)


def test_a_control_of_ones_own_hears_of_what_is_planned() -> None:
    simulator = Simulator(PLANNED, "cpu", 2)
    pressure = simulator.controls.open("balloon.inflation.pressure", 0.0, 9.0)
    stepped(simulator, 1).reset([0, 1])
    stepped(simulator, 1)
    assert pressure.numpy().tolist() == [5.0, 5.0]
    stepped(simulator, 1)
    assert pressure.numpy().tolist() == [8.0, 5.0]
    pressure.fill_(6.0)
    stepped(simulator, 1)
    assert pressure.numpy().tolist() == [6.0, 8.0]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"substeps": 30}, r"change\.0\.set: substeps: changes in all worlds at once"),
        ({"balloon.stiffness": {"shear": 3.0}}, r"change\.0\.set: balloon\.stiffness: must be a number or three"),
        ({"balloon.friction": 0.3}, r"change: balloon\.friction: cannot be written on the device"),
    ],
)
def test_what_cannot_change_in_a_world_by_itself_is_refused(change: dict[str, Any], sentence: str) -> None:
    scene = ALONE.model_copy(update={"change": [Change(time=1.0, set=change)], "ground": Ground(height=-2.0)})
    simulator = Simulator(scene, "cpu", 2)
    with pytest.raises(InputError, match=r"reset: some worlds cannot begin anew by themselves: " + sentence):
        simulator.reset([0, 1])


ROPE = String(particle=0, anchor=(0.5, 1.5, 0.0), length=0.01, stiffness=200.0, start=1 / 60, end=5 / 60)
APPEARING = ALONE.model_copy(
    update={
        "sphere": [
            Sphere(position=(0.0, -0.4, 0.0), radius=0.2, velocity=(0.0, 1.0, 0.0), start=2 / 60, end=6 / 60),
            Sphere(position=(0.0, 0.7, 0.0), radius=0.15, end=4 / 60),
        ],
        "string": [ROPE, ROPE.model_copy(update={"particle": 9, "start": 0.0, "end": None})],
    }
)


@pytest.mark.full
def test_things_appear_and_end_in_a_worlds_own_time(schedule: str) -> None:
    """Also in a world that is saved and restored."""
    _, masked, fresh = begun_anew(APPEARING, schedule, (3, 1), 7)
    masked.reset([0, 1])
    saved = stepped(masked, 3).save()
    stepped(masked, 4).restore(saved)
    require_same(stepped(masked, 4), fresh, slice(1, 2))


def test_a_default_pressure_rises_anew_in_a_world_that_begins_anew() -> None:
    begun_anew(Scene(balloon=[Balloon(mesh=quad_sphere(3))], gravity=0.0), "octets", (5,), 2)


@pytest.mark.full
@pytest.mark.parametrize("name", ["paper", "obstacles"])
def test_keyframes_and_obstacles_follow_a_worlds_own_time(name: str, schedule: str) -> None:
    whole, masked, fresh = begun_anew(feature_set(name), schedule, (3, 1), 4)
    seen = masked.observations["obstacle_positions"].numpy()
    for world, frame in enumerate((whole.read_frame(), fresh.read_frame())):
        np.testing.assert_array_equal(masked.read_frame(world).obstacle_poses, frame.obstacle_poses)
        np.testing.assert_array_equal(seen[world], frame.obstacle_poses[:, :3].astype(np.float32))
    masked.reset()
    require_same(stepped(masked, 4), fresh, slice(0, 1))


@pytest.mark.full
def test_obstacles_of_ones_own_control_do_not_know_the_time(schedule: str) -> None:
    plate = Obstacle(size=(1.5, 0.2, 1.5), position=(0.0, -0.8, 0.0))
    scene = ALONE.model_copy(update={"obstacle": [plate]})
    late, fresh = (Simulator(scene, "cpu", 2, schedule=schedule) for _ in range(2))
    for simulator in (late, fresh):
        simulator.controls.open("obstacle.0.velocity", -2.0, 2.0)
    stepped(late, 37).reset([1, 1])
    for frame in range(8):
        for simulator in (late, fresh):
            simulator.controls["obstacle.0.velocity"] = np.full((2, 3), [0.1, 2.0 * np.cos(0.3 * frame), 0.2])
            stepped(simulator, 1)
    require_same(late, fresh)


BLOWN = Inflation(kind="gas", litres=1.0)
NEEDLE = Material(preset="latex", strength=1e7, needle_time=0.2)
LATE = {
    "a neck that opens or closes": {"balloon": [GAS.model_copy(update={"neck": Neck(diameter=0.01, opens=0.2)})]},
    "gas that is blown in for a time": {"balloon": [GAS.model_copy(update={"inflation": BLOWN})]},
    'strings that appear or end, and solver = "projective"': {
        "balloon": [BALL.model_copy(update={"inflation": Inflation(k_normal=1.0)})],
        **{"string": [ROPE], "solver": "projective"},
    },
    "a needle_time": {"balloon": [GAS.model_copy(update={"material": NEEDLE})]},
}


@pytest.mark.parametrize("reason", LATE)
def test_worlds_of_one_clock_do_not_begin_anew_by_themselves(reason: str) -> None:
    simulator = Simulator(ALONE.model_copy(update=LATE[reason]), "cpu", 2)
    clock = f"reset: some worlds cannot begin anew where the scene has {reason}: the clock"
    with pytest.raises(InputError, match=clock):
        simulator.reset([0, 1])


STRETCH = 1.0 + Inflation().stretch


def pressure_of(balloon: Balloon, **fields) -> float:
    """Return the pressure that it rises to [Pa]."""
    return float(plan_model(Scene(balloon=[balloon], **fields)).parameters["keyframe_values"][0, 0, -1])


@pytest.mark.parametrize(
    ("given", "kind"),
    [
        ({}, "pressure"),
        ({"k_normal": 3.0}, "normal_force"),
        ({"start_pressure": 3.0}, "gas"),
        ({"pump": [(0.0, 1.0), (1.0, 0.0)]}, "gas"),
        ({"kind": "normal_force"}, "normal_force"),
    ],
)
def test_the_kind_of_inflation_is_that_of_what_is_given(given: dict, kind: str):
    assert Inflation(**given).kind == kind


def test_its_pressure_is_in_balance_with_a_round_balloon_stretched_by_a_quarter():
    """The pressure balances the virtual work of all springs, scaled alike: sum k L^2 (s - 1) s = 3 p V s^3."""
    mesh = quad_sphere(8, radius=0.3)
    stiffness = Stiffness(structural=30.0, shear=7.0, flexion=3.0)
    plan = plan_model(Scene(balloon=[Balloon(mesh=mesh, stiffness=stiffness)]))
    springs = plan.shapes[0].springs
    pull = np.array([30.0, 7.0, 3.0])[springs.kind] @ springs.rest_lengths**2
    expected = pull * (STRETCH - 1.0) / (3.0 * signed_volume(mesh) * STRETCH**2)
    # of a polyhedron as fine as this the volume is 1.2% less than that of the sphere of its area
    assert plan.parameters["keyframe_values"][0, 0].tolist() == [0.0, pytest.approx(expected, rel=0.02)]


def test_worlds_get_the_pressure_of_their_own_springs():
    given = Balloon(mesh=cube(), inflation=Inflation(pressure=7.0))
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3)), given, Balloon(mesh=open_cube())])
    constants = {"structural": 9.0, "shear": 5.0, "flexion": 1.0}
    vary = {f"balloon.stiffness.{kind}": [k, 2.0 * k, 2.0 * k] for kind, k in constants.items()}
    vary["balloon.stiffness.structural"][2] = 9.0
    pressures = plan_model(scene, 3, vary).parameters["keyframe_values"][:, :, 1]
    alone = Balloon(mesh=quad_sphere(3), stiffness=Stiffness(**constants))
    assert pressures[:2, 0] == pytest.approx(pressure_of(alone) * np.array([1.0, 2.0]))
    assert pressures[0, 0] < pressures[2, 0] < pressures[1, 0]
    np.testing.assert_array_equal(pressures[:, 1:], [[7.0, 0.0]] * 3)


def test_an_open_balloon_is_inflated_where_its_border_is_held_and_else_says_that_it_is_not():
    """Held by one corner it would be driven around."""
    for fixed, inflates in (([], False), ([1], False), ([1, 3, 5, 7], True)):
        plan = plan_model(Scene(balloon=[Balloon(mesh=open_cube(), fixed=fixed)]))
        assert (plan.parameters["keyframe_values"][0, 0, -1] > 0.0) == inflates
        assert any("its border is not pinned" in warning for warning in plan.warnings) != inflates


def test_the_largest_part_says_how_much_all_are_inflated():
    ball, small = quad_sphere(4), quad_sphere(4, radius=0.3)
    both = joined(ball, replace(small, points=small.points + (3.0, 0.0, 0.0)))
    assert pressure_of(Balloon(mesh=both)) == pytest.approx(pressure_of(Balloon(mesh=ball)), rel=1e-6)


def test_without_springs_or_area_there_is_no_pressure():
    none = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
    assert pressure_of(Balloon(mesh=quad_sphere(3), stiffness=none)) == 0.0
    flat = mesh_of([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [[0, 1, 2]])
    assert pressure_of(Balloon(mesh=flat, fixed=[0])) == 0.0


def test_a_slow_frame_takes_the_default_too():
    """A default ramp may be shorter than a frame, where the scene's own keyframes must be a frame apart."""
    assert pressure_of(Balloon(mesh=cube()), frames_per_second=0.5) > 0.0


def test_a_pressure_cannot_be_left_to_us_later():
    late = [Change(time=1.0, set={"balloon.inflation.pressure": "auto"})]
    scene = Scene(balloon=[Balloon(mesh=cube(), inflation=Inflation(pressure=3.0))], change=late)
    with pytest.raises(InputError, match=r"change\.0\.set: balloon\.inflation\.pressure: must be a number or keyf"):
        plan_model(scene)

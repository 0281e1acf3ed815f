"""Worlds that begin anew by themselves: planned changes come in each world's own time."""

from typing import Any

import numpy as np
import pytest
from beginning_worlds import ALONE, BALL, GAS, TOUCHING, begun_anew, require_same
from trajectories import stepped

from balloon_warp import Change, Ground, Inflation, InputError, Material, Neck, Obstacle, Simulator, Sphere, String

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
    pressure = simulator.controls["balloon.inflation.pressure"]
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


PUMPED = Inflation(pressure=[(0.0, 2.0), (0.05, 9.0), (0.12, 4.0)])
LIFTING: list[Any] = [
    (0.0, (0.0, -0.1, 0.0)),
    (0.04, (0.05, 0.05, 0.0), (0.0, 0.0, 10.0)),
    (0.11, (0.0, 0.02, 0.1), (0.0, 5.0, 40.0)),
]
MOVED = TOUCHING.model_copy(
    update={
        "balloon": [BALL.model_copy(update={"inflation": PUMPED})],
        "obstacle": [Obstacle(size=(1.5, 0.2, 1.5), position=(0.0, -0.7, 0.0), motion=LIFTING)],
        "sphere": [Sphere(position=(0.0, 0.75, 0.0), radius=0.2)],
        "ground": None,
    }
)


@pytest.mark.full
def test_keyframes_and_obstacles_follow_a_worlds_own_time(schedule: str) -> None:
    scene = MOVED if schedule == "gather" else MOVED.model_copy(update={"contacts": False, "body": []})
    whole, masked, fresh = begun_anew(scene, schedule, (5, 1), 6)
    seen = masked.observations["obstacle_positions"].numpy()
    for world, frame in enumerate((whole.read_frame(), fresh.read_frame())):
        np.testing.assert_array_equal(masked.read_frame(world).obstacle_poses, frame.obstacle_poses)
        np.testing.assert_array_equal(seen[world], frame.obstacle_poses[:, :3].astype(np.float32))
    masked.reset()
    require_same(stepped(masked, 6), fresh, slice(0, 1))


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


@pytest.mark.full
def test_a_camera_sees_obstacles_where_they_are_in_each_world() -> None:
    whole, masked = (Simulator(MOVED, "cpu", 2) for _ in range(2))
    cameras = [each.observations.camera((0.0, 0.5, 4.0), (0.0, -0.5, 0.0), 16, 12) for each in (whole, masked)]
    stepped(masked, 4).reset([0, 1])
    stepped(masked, 2)
    stepped(whole, 2)
    depths = [camera.depth.numpy() for camera in cameras]
    np.testing.assert_array_equal(depths[1][1], depths[0][1])
    assert not np.array_equal(depths[1][0], depths[0][0])


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

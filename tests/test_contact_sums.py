"""Net forces of pairs on the device, and in the summary of a batch."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from batches import OFTEN, press_ctrl_c_once
from meshes import quad_sphere

from balloon_warp import Balloon, Ground, Inflation, Obstacle, Scene, Touch, run_batch
from balloon_warp.contacts import things_of
from balloon_warp.simulator import Simulator
from balloon_warp.sweep.contacts import pair_columns, pressing_pairs
from balloon_warp.sweep.groups import plan_groups
from balloon_warp.sweep.shares import simulate_share

GRAVITY, FRAMES, WORLDS = 9.81, 40, 3
MASSES = {"balloon.1.mass": [0.1, 0.2, 0.4]}


def ball(name: str, height: float) -> Balloon:
    inflation = Inflation(kind="pressure", pressure=30.0)
    mesh = quad_sphere(4, 0.5)
    return Balloon(mesh=mesh, name=name, position=(0.0, height, 0.0), mass=0.2, damping=4.0, inflation=inflation)


def pile(**given) -> Scene:
    """Return two balls in a well, the upper on the lower."""
    walls = [
        Obstacle(name=name, shape="plane", position=position, rotation=turn, friction=0.0)
        for name, position, turn in (
            ("east", (0.51, 0, 0), (0, 0, 90)), ("west", (-0.51, 0, 0), (0, 0, -90)),
            ("north", (0, 0, 0.51), (-90, 0, 0)), ("south", (0, 0, -0.51), (90, 0, 0)),
        )
    ]  # fmt: skip
    balls = [ball("lower", 0.49), ball("upper", 1.45)]
    given = {"frames": FRAMES, "contacts": True, "touch": Touch(), "ground": Ground()} | given
    return Scene(balloon=balls, obstacle=walls, **given)


def added_up(simulator: Simulator, world: int, balloon: int, thing: int) -> tuple[np.ndarray, np.ndarray]:
    """Return net force and torque of a pair, summed over particles in float64."""
    model, state = simulator.model, simulator.state
    points, pushes = (array.numpy()[world].astype(np.float64) for array in (state.points, state.contact_impulses))
    first = len(things_of(model)) - model.balloon_count
    parts = [(thing, balloon, 1.0)] + ([(first + balloon, thing - first, -1.0)] if thing >= first else [])
    force, torque = np.zeros(3), np.zeros(3)
    own = slice(*model.particle_offsets[balloon : balloon + 2])
    for pushing, pushed, sign in parts:
        rows = slice(*model.particle_offsets[pushed : pushed + 2])
        forces = sign * pushes[pushing, rows, :3] / model.frame_seconds
        force += forces.sum(axis=0)
        torque += np.cross(points[rows] - points[own].mean(axis=0), forces).sum(axis=0)
    return force, torque


@pytest.mark.full
def test_the_device_has_the_net_force_of_each_pair_in_every_world():
    """Net forces on the device equal those of frames; each world is a row, with no copy to the host."""
    simulator = Simulator(pile(), "cpu", WORLDS, MASSES)
    for _ in range(30):
        simulator.step_unread()
    forces, torques = simulator.state.contact_forces, simulator.state.contact_torques
    things = things_of(simulator.model)
    assert forces.shape == (WORLDS, 2, len(things))
    seen = 0
    for world in range(WORLDS):
        contacts = simulator.read_frame(world).contacts
        touched = {(each.number, each.thing) for each in contacts}
        assert touched == set(map(tuple, np.argwhere(simulator.state.contact_areas.numpy()[world] > 0.0).tolist()))
        for each in contacts:
            force, torque = added_up(simulator, world, each.number, each.thing)
            for told, row, exact in ((each.force, forces, force), (each.torque, torques, torque)):
                np.testing.assert_array_equal(told, row.numpy()[world, each.number, each.thing])
                np.testing.assert_allclose(told, exact, atol=1e-5)  # float32, of numbers near 1
            seen += 1
    assert seen >= 3 * WORLDS


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    run_batch(pile(), folder, WORLDS, MASSES, device="cpu")
    return folder


def test_a_batch_says_of_each_pair_how_hard_it_pressed(folder: Path):
    """The summary's mean and maximum are those of the frames of each world simulated alone."""
    with (folder / "worlds.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    simulator = Simulator(pile(), "cpu", WORLDS, MASSES)
    frames = [[simulator.read_frame(world).contacts for world in range(WORLDS)] for _ in _frames(simulator)]
    for world, row in enumerate(rows):
        pressed = [
            next((each for each in frame[world] if (each.balloon, each.other) == ("lower", "upper")), None)
            for frame in frames
        ]
        forces = [np.linalg.norm(each.force) if each else 0.0 for each in pressed]
        torques = [np.linalg.norm(each.torque) if each else 0.0 for each in pressed]
        areas = [each.area if each else 0.0 for each in pressed]
        for name, values in (("force", forces), ("torque", torques), ("area", areas)):
            assert float(row[f"upper_on_lower_{name}_mean"]) == pytest.approx(np.mean(values), rel=1e-4)
            assert float(row[f"upper_on_lower_{name}_max"]) == pytest.approx(max(values), rel=1e-6)
        assert float(row["upper_on_lower_pressure_max"]) == pytest.approx(max(e.pressure for e in pressed if e))
    assert not any("on_upper" in name and "lower" in name for name in rows[0])  # the same pair
    assert not any("ground_on_upper" in name for name in rows[0])  # these never touched


def _frames(simulator: Simulator):
    for number in range(FRAMES):
        simulator.step_unread()
        yield number


def test_the_manifest_says_what_the_columns_of_pairs_are(folder: Path):
    columns = json.loads((folder / "manifest.json").read_text())["columns"]
    assert columns["upper_on_lower_force_max"] == {
        "unit": "N", "meaning": "net force of upper on lower: maximum over all frames",
    }  # fmt: skip
    assert {*np.load(folder / "worlds.npz"), *np.load(folder / "table.npz")} == set(columns)


def test_a_stopped_batch_goes_on_to_the_same_columns(folder: Path, tmp_path: Path):
    how = {"device": "cpu", "checkpoint_seconds": OFTEN, "resume": True}
    with pytest.raises(KeyboardInterrupt):
        run_batch(pile(), tmp_path, WORLDS, MASSES, **how, on_frame=press_ctrl_c_once(lambda frame: frame == 25))
    run_batch(pile(), tmp_path, WORLDS, MASSES, **how)
    assert (tmp_path / "worlds.csv").read_bytes() == (folder / "worlds.csv").read_bytes()


def test_nothing_is_summed_unasked():
    simulator = Simulator(pile(contacts=False), "cpu")
    assert simulator.state.contact_forces.shape == (1, 2, 0)


def test_shares_of_a_cluster_tell_the_same(folder: Path):
    groups = plan_groups(pile(), WORLDS, MASSES)
    share = groups[0].part(np.array([1, 2]))
    result = simulate_share(share, np.array([], dtype=np.int64), "cpu", "auto", WORLDS, "freeze", lambda frame: None)
    told = dict(pair_columns(pressing_pairs(share.plan, result.records[-1].contacts), result.records[-1].contacts))
    worlds = np.load(folder / "worlds.npz")
    for name, values in told.items():
        np.testing.assert_array_equal(values, worlds[name][1:])
    assert all(record.contacts is None for record in result.records[:-1])


@pytest.mark.full
def test_a_world_that_began_again_has_what_it_pressed_then(tmp_path: Path):
    """A restarted world reports the forces of its new episode, and the others are unchanged."""
    vary = {"balloon.1.inflation.pressure": [30.0, 5e6]}
    rows = {}
    for policy in ("freeze", "restart"):
        scene = pile(frames=10, substeps=60)
        run_batch(scene, tmp_path / policy, 2, vary, device="cpu", on_blowup=policy)
        with (tmp_path / policy / "worlds.csv").open(newline="") as file:
            rows[policy] = list(csv.DictReader(file))
    assert [row["health"] for row in rows["restart"]] == ["1", "2"]
    assert rows["restart"][0] == rows["freeze"][0]
    frozen, again = (float(rows[policy][1]["upper_on_lower_force_max"]) for policy in ("freeze", "restart"))
    assert again > 2.0 * frozen

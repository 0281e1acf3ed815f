"""Collision-free frames are simulated without obstacles, and again with them if that was wrong."""

import numpy as np
import pytest
from meshes import mesh_of, quad_sphere

from balloon_warp.kernels.contact.free_frames import BUSY, FREE, HURRIED
from balloon_warp.scene import Balloon, Inflation, Material, Obstacle, Scene, Sphere, Stiffness, Touch
from balloon_warp.schedules import recorded_frame
from balloon_warp.simulator import Simulator

PLATE = Obstacle(size=(4.0, 1e-3, 4.0), position=(0.0, -0.5e-3, 0.0))
FALL = 5000.0
"""a gravity by which what is at rest falls 0.69 m in a frame, where it is believed to move 3 mm [m/s^2]"""


def verdicts(simulator: Simulator) -> list[int]:
    """Return the verdicts on the last frame, by world."""
    return [int(verdict) for verdict in simulator.schedule.busy.outlook.table.verdicts.numpy()]


def free_particles(height: float) -> Balloon:
    """Return four particles without springs and air."""
    corners = [(0.0, height, 0.0), (0.1, height, 0.0), (0.1, height, 0.1), (0.0, height, 0.1)]
    nothing = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
    return Balloon(
        mesh=mesh_of(corners, [[0, 1, 2, 3]]), stiffness=nothing, inflation=Inflation(k_normal=0.0), damping=0.0
    )


@pytest.mark.full
def test_frames_are_free_until_a_balloon_may_meet_an_obstacle(device: str):
    """A ball that falls from 1.5 m is advanced by the kernel without obstacles, then by the one with them."""
    ball = Balloon(mesh=quad_sphere(3, 0.2), position=(0.0, 1.5, 0.0), inflation={"k_normal": 0.5})
    scene = Scene(balloon=[ball], obstacle=[PLATE], frames=60)
    simulator, peer = Simulator(scene, device, schedule="block"), Simulator(scene, device, schedule="gather")
    seen, lowest = [], []
    for _ in range(60):
        simulator.step()
        peer.step()
        seen += verdicts(simulator)
        lowest.append(simulator.read_frame().points[0][:, 1].min())
        # schedules differ by rounding, which contact makes no larger in a second
        np.testing.assert_allclose(simulator.read_frame().points[0], peer.read_frame().points[0], atol=1e-4)
    assert set(seen) == {FREE, BUSY}
    assert seen[0] == FREE
    assert seen[int(np.argmin(lowest))] == BUSY
    assert min(lowest) > -1e-6


def test_what_goes_further_than_was_free_is_stopped_all_the_same(device: str):
    """A particle that reaches 83 m/s in the first frame does not tunnel through a plate of 1 mm, 0.3 m below."""
    scene = Scene(balloon=[free_particles(0.3)], obstacle=[PLATE], gravity=FALL, substeps=16, frames=3)
    simulator = Simulator(scene, device, schedule="block")
    simulator.step()
    assert verdicts(simulator) == [HURRIED]
    assert simulator.read_frame().points[0][:, 1].min() >= -1e-6
    simulator.step()
    assert verdicts(simulator) == [BUSY]


@pytest.mark.full
def test_a_frame_that_is_simulated_again_leaves_nothing_of_the_first_time(device: str):
    """A repeated frame pumps no gas twice, moves no sphere twice and counts once, as in a schedule that does not
    speculate."""
    ball = Balloon(
        mesh=quad_sphere(3, 0.2),
        position=(0.0, 0.5, 0.0),
        inflation=Inflation(kind="gas", amount=1.0, pump=50.0),
    )
    sphere = Sphere(position=(1.0, 2.0, 0.0), radius=0.1, mass=0.1)
    scene = Scene(balloon=[ball], obstacle=[PLATE], sphere=[sphere], gravity=300.0, frames=2, substeps=200)
    simulator, peer = Simulator(scene, device, schedule="block"), Simulator(scene, device, schedule="gather")
    for one in (simulator, peer):
        one.step()
    assert verdicts(simulator) == [HURRIED]
    for name in ("gas_amounts", "free_volumes", "pressures", "sphere_positions", "sphere_velocities", "frame"):
        found, expected = (getattr(one.state, name).numpy() for one in (simulator, peer))
        rounding = 0.05 if name == "pressures" else 0.0  # [Pa], of which the air around has 101,325
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=rounding, err_msg=name)
    np.testing.assert_allclose(simulator.state.points.numpy(), peer.state.points.numpy(), atol=1e-5)


@pytest.mark.full
def test_rubber_remembers_nothing_of_a_frame_that_is_simulated_again(device: str):
    """Softening is not kept from a frame that is simulated again: a ball hangs by its top, and falls so fast that a
    plate stops it; without the plate it is stretched further."""
    mesh = quad_sphere(3, 0.2)
    top = np.flatnonzero(np.asarray(mesh.points)[:, 1] > 0.1).tolist()
    rubber = Material(kind="neo_hookean", shear_modulus=4e5, thickness=3e-4, softening=0.5)
    ball = Balloon(
        mesh=mesh, position=(0.0, 0.4, 0.0), fixed=top, material=rubber, inflation=Inflation(pressure=0.0), damping=0.0
    )
    scene = Scene(balloon=[ball], obstacle=[PLATE], gravity=2.0 * FALL, substeps=400, frames=1)
    simulator, peer = Simulator(scene, device, schedule="block"), Simulator(scene, device, schedule="gather")
    for one in (simulator, peer):
        one.step()
    assert verdicts(simulator) == [HURRIED]
    expected = peer.state.kept["peak"].numpy()
    assert expected.max() > 0.0
    np.testing.assert_allclose(simulator.state.kept["peak"].numpy(), expected, atol=1e-3 * expected.max())


def test_a_world_does_not_feel_how_free_another_is(device: str):
    """Worlds that are hurried, busy and free are bit-identical to each alone."""
    scene = Scene(balloon=[free_particles(0.3)], obstacle=[PLATE], gravity=10.0, substeps=16, frames=1)
    vary = {"gravity": [FALL, 10.0, 10.0], "obstacle.0.position.1": [0.0, 0.299, -0.1]}
    batch = Simulator(scene, device, 3, vary, schedule="block")
    batch.step()
    assert verdicts(batch) == [HURRIED, BUSY, FREE]
    for world in range(3):
        mine = {name: values[world : world + 1] for name, values in vary.items()}
        alone = Simulator(scene, device, 1, mine, schedule="block")
        alone.step()
        np.testing.assert_array_equal(batch.read_frame(world).points[0], alone.read_frame().points[0])


@pytest.mark.parametrize("motion", ["moves", "turns"])
def test_an_obstacle_that_comes_is_seen_in_time(motion: str, device: str):
    """A racket that comes 11 cm nearer in a frame is detected before it hits balloons which hang in the air."""
    keyframes = {
        "moves": [(0.0, (0.0, 0.0, 0.0)), (0.15, (0.0, 1.0, 0.0))],
        "turns": [(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), (0.5, (0.0, 0.0, 0.0), (0.0, 0.0, 60.0))],
    }
    racket = Obstacle(size=(4.0, 1e-3, 4.0), motion=keyframes[motion])
    still = free_particles(0.53).model_copy(update={"position": (1.5, 0.0, 0.0)})
    scene = Scene(balloon=[still], obstacle=[racket], gravity=0.0, substeps=8, frames=30)
    simulator = Simulator(scene, device, schedule="block")
    simulator.step()
    assert verdicts(simulator) == [FREE]
    *_, last = simulator.run()
    assert last.points[0][:, 1].min() > 0.9  # the racket has passed their place, and has taken all along


@pytest.mark.parametrize("schedule", ["block", "lanes", "octets"])
def test_a_balloon_that_hurries_to_another_touches_it(schedule: str, device: str):
    """A balloon that falls 4 cm in the first frame lands on one that is pinned 3 cm below, as in a schedule that does
    not speculate."""
    if schedule != "block" and device != "cpu":
        pytest.skip(f"{schedule} is for the CPU")
    below = free_particles(0.0).model_copy(update={"fixed": [0, 1, 2, 3], "scale": 3.0, "position": (-0.1, 0.0, -0.1)})
    pair = Scene(balloon=[free_particles(0.03), below], touch=Touch(), gravity=300.0, substeps=32, frames=1)
    simulator, peer = Simulator(pair, device, schedule=schedule), Simulator(pair, device, schedule="gather")
    for one in (simulator, peer):
        one.step()
    assert verdicts(simulator) == [HURRIED]
    lowest = simulator.read_frame().points[0][:, 1].min()
    assert lowest > 0.03 - 0.5 * 300.0 / 3600.0 + 0.005  # it would be there if it had not been stopped
    np.testing.assert_allclose(simulator.state.points.numpy(), peer.state.points.numpy(), atol=1e-5)


def test_each_of_two_balloons_may_go_half_of_the_way(device: str):
    """Each of two balloons may move half of their gap freely: each moves 6 cm in a frame, and the gap is 10 cm."""
    low, high = (
        free_particles(height).model_copy(update={"velocity": (0.0, speed, 0.0)})
        for height, speed in ((0.0, 3.5), (0.1, -3.5))
    )
    simulator = Simulator(Scene(balloon=[low, high], touch=Touch(), gravity=0.0, substeps=16), device, schedule="block")
    simulator.step()
    assert verdicts(simulator) != [FREE]


def test_what_is_never_busy_is_not_compiled_and_what_seldom_is_not_recorded(device: str, monkeypatch):
    """A kernel for contact is not compiled before a frame needs it, nor recorded while that is rare. Default contact
    costs the first frame little; a busy frame is the same, recorded or not."""
    if device != "cpu":
        pytest.skip("a GPU's graphs have what busy worlds need")
    low, high = (free_particles(height) for height in (0.0, 0.2))
    pair = Scene(balloon=[low, high.model_copy(update={"velocity": (0, -2, 0)})], gravity=0.0, substeps=16, frames=8)
    ends = {}
    monkeypatch.setattr(recorded_frame, "FEW", 0)
    for rare in (0, 8):
        monkeypatch.setattr(recorded_frame, "RARE", rare)
        simulator = Simulator(pair, device, schedule="octets")
        simulator.step()
        assert verdicts(simulator) == [FREE]
        assert len(simulator._recorded_frame._graphs) == 2  # before busy worlds and after
        *_, last = simulator.run()
        assert verdicts(simulator) == [BUSY]
        assert len(simulator._recorded_frame._graphs) == (2 if rare else 3)
        ends[rare] = np.concatenate(last.points)
    np.testing.assert_array_equal(ends[0], ends[8])


@pytest.mark.parametrize("schedule", ["gather", "octets"])
def test_the_first_frames_are_launched_unrecorded_and_are_the_same(schedule: str, monkeypatch):
    """The first frames are launched without recording, with the same result: recording pays after some frames."""
    scene, ends = Scene(balloon=[free_particles(0.0)], substeps=16), []
    for few in (recorded_frame.FEW, 0):
        monkeypatch.setattr(recorded_frame, "FEW", few)
        simulator = Simulator(scene, "cpu", schedule=schedule)
        for frame in range(6):
            assert bool(simulator._recorded_frame._graphs) == (frame > few)
            simulator.step()
        ends.append(simulator.state.points.numpy().copy())
    np.testing.assert_array_equal(*ends)

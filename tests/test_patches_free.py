"""Patches in frames in which balloons cannot touch, and launches in others."""

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere

from balloon_warp.kernels.contact.free_frames import BUSY, FREE, HURRIED
from balloon_warp.model import build_model, initial_state
from balloon_warp.scene import Balloon, Ground, Inflation, Scene
from balloon_warp.schedules import choose
from balloon_warp.schedules.busy_worlds import BusyWorlds
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.outlook import free_features
from balloon_warp.schedules.patched import PatchedSchedule
from balloon_warp.simulator import Simulator

ROUNDING = 4.0e-5
"""of places [m]: the same sums in another order, for balloons of 2 m"""
CLOSING = "balloon.1.velocity.0"


def ball(**fields) -> Balloon:
    """Return a ball of 1,178 particles and 1 m radius."""
    return Balloon(mesh=quad_sphere(14), mass=3.0, damping=0.1, **fields)


def meeting(inflation: Inflation) -> Scene:
    """Return two balloons 0.3 m apart; what CLOSING says decides when they meet."""
    balls = [ball(inflation=inflation), ball(inflation=inflation, position=(2.3, 0.1, 0.2), velocity=(-3.0, 0.0, 0.0))]
    return Scene(balloon=balls, ground=Ground(height=-1.05), frames=8)


INFLATIONS = {
    "pressure": Inflation(pressure=30.0),
    "gas": Inflation(kind="gas", start_pressure=50.0),
    "normals": Inflation(k_normal=0.5),
}


def verdicts(simulator: Simulator) -> list[int]:
    """Return the verdicts on the last frame, by world."""
    assert isinstance(simulator.schedule, PatchedSchedule)
    assert simulator.schedule.busy
    return [int(verdict) for verdict in simulator.schedule.busy.outlook.table.verdicts.numpy()]


def launched(scene: Scene, gpu: wp.Device, monkeypatch: pytest.MonkeyPatch) -> Simulator:
    """Return a simulator that launches every substep."""
    with monkeypatch.context() as patch:
        patch.setattr(choose, "_in_patches", lambda model: None)
        simulator = Simulator(scene, str(gpu), schedule="gather")
    assert isinstance(simulator.schedule, GatherSchedule)
    return simulator


def test_launches_and_patches_of_free_frames_have_one_working_memory():
    """Masses of gas are found by a launch as a frame begins, where patches read them, and verdicts stand."""
    model = build_model(meeting(INFLATIONS["gas"]), "cpu")
    features = model_features(model)
    busy, state = BusyWorlds(model, features), initial_state(model)
    free = GatherSchedule(model, free_features(features), busy.working)
    free.launches.execute(state, 0, 0.0, (state.points, state.velocities), only=("pump", "weigh"))
    assert (busy.working.gas_masses.numpy() > 0.0).all()


@pytest.mark.parametrize("name", INFLATIONS)
def test_balloons_meet_as_in_launches_on_a_gpu(name: str, gpu: wp.Device, monkeypatch: pytest.MonkeyPatch):
    """Frames are free, then busy; places are those of launches to rounding, which contact makes no larger so soon."""
    scene = meeting(INFLATIONS[name])
    simulator, peer = Simulator(scene, str(gpu)), launched(scene, gpu, monkeypatch)
    seen = []
    for _ in range(scene.frames):
        simulator.step()
        peer.step()
        seen += verdicts(simulator)
        np.testing.assert_allclose(simulator.state.points.numpy(), peer.state.points.numpy(), atol=ROUNDING)
        np.testing.assert_allclose(simulator.state.pressures.numpy(), peer.state.pressures.numpy(), atol=0.5)
    assert seen[0] == FREE
    assert seen[-1] == BUSY
    # The first has been hit: alone it stays at rest to 1e-8 m/s.
    assert simulator.state.velocities.numpy()[0, :1178, 0].mean() < -0.01


def test_a_world_does_not_feel_how_free_another_is_on_a_gpu(gpu: wp.Device):
    """Worlds that are free and busy are bit-identical to each alone, to the end."""
    scene, speeds = meeting(INFLATIONS["gas"]), [-3.0, 0.0, -1.0, -12.0]
    batch, seen = Simulator(scene, str(gpu), 4, {CLOSING: speeds}, schedule="gather"), []
    for _ in range(scene.frames):
        batch.step()
        seen.append(verdicts(batch))
    assert {FREE, BUSY} <= set(np.ravel(seen).tolist())
    assert [row[1] for row in seen] == [FREE] * scene.frames
    for world, speed in enumerate(speeds):
        alone = Simulator(scene, str(gpu), 1, {CLOSING: [speed]}, schedule="gather")
        for _ in range(scene.frames):
            alone.step()
        np.testing.assert_array_equal(batch.read_frame(world).points, alone.read_frame().points)


def test_what_goes_further_than_was_free_touches_all_the_same_on_a_gpu(gpu: wp.Device, monkeypatch: pytest.MonkeyPatch):
    """A ball that falls 8 cm in its first frame lands on one that is pinned 3 cm below."""
    inflation = Inflation(pressure=30.0)
    below = ball(inflation=inflation, fixed=list(range(1178)))
    scene = Scene(balloon=[ball(inflation=inflation, position=(0.0, 2.03, 0.0)), below], gravity=600.0, frames=1)
    simulator, peer = Simulator(scene, str(gpu)), launched(scene, gpu, monkeypatch)
    for each in (simulator, peer):
        each.step()
    assert verdicts(simulator) == [HURRIED]
    np.testing.assert_allclose(simulator.state.points.numpy(), peer.state.points.numpy(), atol=ROUNDING)

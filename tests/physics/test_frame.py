"""Frames that a simulator returns, and its reset."""

import io
from dataclasses import replace

import numpy as np
import pytest
from conserved import advanced
from meshes import cube, quad_sphere
from PIL import Image

from balloon_warp import Balloon, BlowUpError, Change, InputError, Scene, Simulator, Sphere, String

CUBE = Balloon(mesh=cube(), inflation={"kind": "pressure", "pressure": 50.0})
BALL = Balloon(mesh=quad_sphere(3), position=(5.0, 0.0, 0.0), scale=2.0)
LATE = Sphere(position=(0.0, 4.0, 0.0), start=1 / 60)
CHANGES = Change(time=1 / 60, set={"balloon.mass": 0.5}), Change(time=2 / 60, set={"normals": "fresh", "substeps": 100})
TWO = Scene(normals="cached", balloon=[CUBE, BALL], sphere=[LATE], change=list(CHANGES))


def test_a_frame_knows_its_time_and_its_balloons_size():
    simulator = Simulator(TWO, "cpu")
    start = simulator.read_frame()
    assert (start.number, start.time, simulator.time) == (0, 0.0, 0.0)
    assert (start.volumes[0], start.areas[0]) == pytest.approx((1.0, 6.0), rel=1e-12)
    later = advanced(simulator, 3)
    assert later.time == simulator.time == pytest.approx(3 / 60)
    assert later.volumes[0] > 1.0
    # the device sums in float64 the float32 places that the host sums, too
    np.testing.assert_allclose(later.volumes, simulator.mass_properties().volume[0], rtol=1e-9)
    assert later.pressures[0] == 50.0


@pytest.mark.parametrize("change", [TWO.change, []], ids=["planned changes", "nothing changes by itself"])
def test_reset_goes_back_to_the_same_start(change: list[Change]):
    simulator = Simulator(TWO.model_copy(update={"change": change}), "cpu")
    first = advanced(simulator, 4)
    for gravity in (0.0, 1.0):
        simulator.set_parameters({"gravity": gravity})
        simulator.step()
        simulator.reset()
        assert (simulator.frame_number, simulator.model.scene.normals) == (0, "cached")
        assert simulator.model.parameters["gravity"].numpy() == np.float32(9.81)
    frames = list(zip(range(5), simulator.run(), strict=False))
    np.testing.assert_array_equal(frames[4][1].points[1], first.points[1])
    np.testing.assert_array_equal(frames[4][1].sphere_positions, first.sphere_positions)


def test_a_notebook_shows_a_picture(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("balloon_warp.studio.animate.NOTEBOOK_SIZE", (64, 36))
    simulator = Simulator(TWO, "cpu")
    shown = simulator._repr_png_()
    assert shown is not None
    pixels = np.asarray(Image.open(io.BytesIO(shown)).convert("RGB")).astype(int)
    assert pixels.shape == (36, 64, 3)
    assert (pixels[..., 0] - pixels[..., 2] > 80).any()
    assert (pixels[..., 2] - pixels[..., 0] > 40).any()
    frame = simulator.read_frame()
    broken = replace(frame, points=[np.full_like(points, np.nan) for points in frame.points])
    monkeypatch.setattr(simulator, "read_frame", lambda world: broken)
    assert simulator._repr_png_() is None
    with pytest.raises(InputError, match="frame 0: has positions that are not finite"):
        simulator.picture()


def test_a_world_is_read_among_others_as_alone(device: str):
    held = Balloon(mesh=quad_sphere(3), inflation={"k_normal": 0.1})
    scene = Scene(balloon=[held], string=[String(balloon=0, anchor=(0.0, 3.0, 0.0), length=1.0)], net_forces=True)
    vary = {"balloon.inflation.k_normal": [0.1, 0.2, 0.4], "string.length": [1.0, 1.1, 1.2]}
    simulator = Simulator(scene, device, world_count=3, vary=vary, schedule="gather")
    alone = Simulator(scene, device, world_count=1, vary={k: v[2:] for k, v in vary.items()}, schedule="gather")
    for _ in range(3):
        simulator.step()
        others, read, expected = simulator.read_frame(0), simulator.read_frame(2), alone.step()
        for name in ("points", "velocities", "net_forces", "inflation_forces"):
            np.testing.assert_array_equal(getattr(read, name)[0], getattr(expected, name)[0])
            assert (getattr(read, name)[0] != getattr(others, name)[0]).any()
        np.testing.assert_array_equal(read.string_anchors, expected.string_anchors)
    before = simulator.read_frame(2)
    simulator.set_parameters({"keyframe_values": np.full((3, 1, 1), 0.8)})
    simulator.step()
    pushed, until_now = (
        np.linalg.norm(frame.inflation_forces[0], axis=1).sum() for frame in (simulator.read_frame(2), before)
    )
    assert pushed > 1.5 * until_now


def test_frames_that_are_read_while_the_next_is_simulated_are_the_same(device: str):
    scene = TWO.model_copy(update={"frames": 6})
    ahead, simulator = [], Simulator(scene, device)
    for frame in simulator.run(ahead=True):
        ahead.append((simulator.frame_number - frame.number, frame))
    assert [lead for lead, _ in ahead] == [0, 0, 0, 1, 1, 1, 0]  # waits where something changes, and at the end
    for (_, one), other in zip(ahead, Simulator(scene, device).run(), strict=True):
        assert (one.number, one.time) == (other.number, other.time)
        np.testing.assert_array_equal(one.points[1], other.points[1])
        np.testing.assert_array_equal(one.velocities[0], other.velocities[0])
        np.testing.assert_array_equal(one.sphere_positions, other.sphere_positions)
        np.testing.assert_array_equal(one.pressures, other.pressures)


@pytest.mark.parametrize("ahead", [False, True])
def test_a_blow_up_ends_the_frames_after_the_last_good_one(device: str, ahead: bool):
    scene = Scene(balloon=[Balloon(mesh=cube(), inflation={"k_normal": 1e9})], substeps=1, normals="fresh", frames=20)
    frames, numbers = Simulator(scene, device, world_count=2).run(ahead=ahead), []
    with pytest.raises(BlowUpError) as told:
        numbers.extend(frame.number for frame in frames)
    assert numbers == list(range(len(numbers)))
    assert f"in frame {len(numbers)}, world 0" in str(told.value)

"""Trajectories in one call: frames of a simulator, as arrays."""

import numpy as np
import pytest
from meshes import cube, quad_sphere

from balloon_warp import Balloon, BlowUpError, InputError, Scene, Simulator, Sphere, simulate

TWO = Scene(
    frames=5,
    frames_per_second=50.0,
    balloon=[Balloon(mesh=cube()), Balloon(mesh=quad_sphere(3), position=(5.0, 0.0, 0.0))],
    sphere=[Sphere(position=(0.0, 4.0, 0.0))],
)


@pytest.mark.full
def test_arrays_hold_what_the_frames_hold():
    found = simulate(TWO, device="cpu")
    np.testing.assert_allclose(found.times, [0.0, 0.02, 0.04, 0.06, 0.08, 0.1], rtol=1e-12)
    assert [points.shape for points in found.points] == [(6, 8, 3), (6, 56, 3)]
    for frame in Simulator(TWO, "cpu").run():
        for name in ("points", "velocities"):
            for balloon in (0, 1):
                mine, theirs = getattr(found, name)[balloon][frame.number], getattr(frame, name)[balloon]
                np.testing.assert_array_equal(mine, theirs)
        for name in ("pressures", "gas_amounts", "sphere_positions", "sphere_velocities"):
            np.testing.assert_array_equal(getattr(found, name)[frame.number], getattr(frame, name))
        for name in ("volumes", "areas"):  # NumPy adds in an order that hangs on where the numbers lie
            np.testing.assert_allclose(getattr(found, name)[frame.number], getattr(frame, name), rtol=1e-14)
    assert repr(found) == "Trajectories(mesh of 8 particles, mesh of 56 particles; 6 frames, 0 to 0.1 s)"


def test_worlds_come_first_and_frames_may_be_left_out():
    """A sphere falls by g t^2 / 2 in each world's gravity, to the first order of the step: v is a step ahead."""
    gravity = np.array([1.0, 2.0, 9.81])
    found = simulate(TWO, {"frames": 6}, world_count=3, vary={"gravity": gravity}, every=3, device="cpu")
    np.testing.assert_allclose(found.times, [0.0, 0.06, 0.12])
    assert found.points[1].shape == (3, 3, 56, 3)
    assert found.volumes.shape == found.pressures.shape == (3, 3, 2)
    fallen = 4.0 - found.sphere_positions[:, :, 0, 1]
    substep = 0.02 / Simulator(TWO, "cpu").model.substeps
    exact = 0.5 * gravity[:, None] * found.times * (found.times + substep)
    np.testing.assert_allclose(fallen, exact, atol=2e-6)  # float32 at 4 m


@pytest.mark.full
def test_what_cannot_be_told_is_refused():
    with pytest.raises(InputError, match=r"^vary: meshes of different sizes need separate trajectories"):
        simulate(TWO, world_count=2, vary={"balloon.0.mesh": [cube(), quad_sphere(3)]}, device="cpu")
    with pytest.raises(InputError, match=r"^every: must be a whole number, at least 1 \(got 0\)$"):
        simulate(TWO, every=0, device="cpu")
    with pytest.raises(InputError, match=r"^1 worlds do not fit: they need "):
        simulate(TWO, {"frames": 10**9}, device="cpu")
    with pytest.raises(BlowUpError):
        simulate(TWO, {"solver": "forward_euler", "substeps": 1, "balloon.mass": 1e-4, "frames": 60}, device="cpu")

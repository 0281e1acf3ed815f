"""Time in laws is that of the substep, in every schedule."""

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere

import balloon_warp as bw


@wp.func
def sway(time: float, mass_share: float, swaying: float):
    """Return a force that oscillates at 30 Hz."""
    return swaying * mass_share * wp.vec3(wp.sin(188.5 * time), 0.0, 0.0)


SWAY = bw.Law("particle", sway, (bw.Parameter("swaying", "N", default=20.0),))


@pytest.mark.parametrize("kind", ["pressure", "gas"])
def test_a_law_reads_the_time_of_each_substep(kind: str, schedule: str, device: str):
    """A law reads each substep's time, for a sealed gas, too, whose amount is read once a frame."""
    inflation = {"kind": "gas", "start_pressure": 100.0} if kind == "gas" else {"pressure": 100.0}
    ball = bw.Balloon(mesh=quad_sphere(2), mass=0.5, inflation=inflation)
    scene = bw.Scene(balloon=[ball], frames=1, substeps=32, gravity=0.0)
    moved = bw.simulate(scene, device=device, schedule=schedule, laws=(SWAY,))
    step = 1.0 / 60.0 / 32.0
    if kind == "pressure":
        speed = sum(20.0 / 0.5 * step * np.sin(188.5 * step * number) for number in range(32))
        assert moved.velocities[0][-1].mean(axis=0)[0] == pytest.approx(speed, rel=0.02)
    told = bw.simulate(scene, device="cpu", schedule="gather", laws=(SWAY,))
    np.testing.assert_allclose(moved.points[0], told.points[0], atol=2e-6)

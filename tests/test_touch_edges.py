"""Edges against edges: rims that cross."""

from dataclasses import replace

import numpy as np
import pytest
from conserved import motion
from meshes import grid
from touching import SLACK, VACUUM

from balloon_warp.scene import Balloon, Scene, Touch
from balloon_warp.simulator import Simulator


@pytest.mark.xfail(strict=True, reason="only particles meet triangles: see docs/LIMITS.md")
def test_flat_sheets_that_cross_edge_on_stop_each_other(device):
    """One lies, one stands and flies at its rim, between particles: without thickness neither has a particle near a
    face of the other, and they go through each other like two cards with slits."""
    sheet = grid(4, 4)
    lying = replace(sheet, points=0.125 * (sheet.points - np.array([2.0, 2.0, 0.0])))
    standing = replace(lying, points=lying.points[:, [0, 2, 1]])
    still = {"mass": 0.05, "damping": 0.0, "inflation": SLACK}
    balloons = [
        Balloon(mesh=lying, **still),
        Balloon(mesh=standing, position=(0.52, 0.06, 0.06), velocity=(-1.0, 0.0, 0.0), **still),
    ]
    simulator = Simulator(Scene(balloon=balloons, touch=Touch(), **VACUUM), device, schedule="gather")
    for _ in range(60):
        simulator.step()
    points, velocities = motion(simulator)
    assert np.abs(velocities[:25]).max() > 0.0
    assert points[25:, 0].mean() > points[:25, 0].mean()

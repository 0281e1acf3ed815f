"""Balloon between two plates: force against gap."""

import numpy as np
import pytest
from meshes import quad_sphere
from scipy.spatial import ConvexHull

from balloon_warp.frame import Frame
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.scene import Balloon, Obstacle, Scene, Stiffness
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

PRESSURE = 10.0
RADIUS = 0.5


def pressed(gap: float, device: str) -> tuple[PolygonMesh, Frame]:
    """Return a balloon of given pressure at rest between plates without friction, closed to the gap and stopped."""
    soft = Stiffness(structural=20.0, shear=10.0, flexion=0.0)
    filled = {"pressure": [(0.0, 0.0), (0.5, PRESSURE)]}
    ball = Balloon(mesh=quad_sphere(12, RADIUS), mass=0.5, damping=20.0, stiffness=soft, inflation=filled)
    way = 0.62 - 0.5 * gap
    plates = [
        Obstacle(
            size=(3.0, 0.2, 3.0),
            position=(0.0, 0.72 * side, 0.0),
            motion=[(0.0, (0.0, 0.0, 0.0)), (1.0, (0.0, -way * side, 0.0))],
            friction=0.0,
        )
        for side in (1.0, -1.0)
    ]
    scene = Scene(balloon=[ball], obstacle=plates, gravity=0.0, frames=240, net_forces=True)
    simulator = Simulator(scene, device)
    *_, last = simulator.run()
    assert np.abs(last.velocities[0]).max() < 1e-3
    return simulator.model.shapes[0].mesh, last


@pytest.mark.parametrize("gap", [0.8, 0.6])
def test_the_force_on_a_plate_is_the_pressure_times_the_contact(gap: float, device: str):
    """F = p A on a plate: in a cut along the contact's edge, where a membrane leaves the plate along it, only the
    pressure acts across. Net forces leave contacts out, so that at rest those of touching particles are the plate's
    load. The contact ends somewhere between the particles that touch and their neighbors."""
    mesh, last = pressed(gap, device)
    points, ends = last.points[0], mesh_edges(mesh).ends
    forces = []
    for side in (1.0, -1.0):
        touching = points[:, 1] * side > 0.5 * gap - 1e-4
        force = float(last.net_forces[0][touching, 1].sum() * side)
        around = touching.copy()
        around[ends[touching[ends].any(axis=1)]] = True
        least, most = (ConvexHull(points[which][:, [0, 2]]).volume for which in (touching, around))
        assert PRESSURE * least < force < PRESSURE * most
        assert most < 1.7 * least  # or this would say little
        forces.append(force)
    assert forces[0] == pytest.approx(forces[1], rel=1e-3)

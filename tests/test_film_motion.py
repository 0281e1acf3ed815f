"""Membrane faces in a block whose particles move."""

import numpy as np
import pytest
from conserved import put
from lone_films import QUADS, TRIANGLES, latex, measured, moved

from balloon_warp.mesh import PolygonMesh
from balloon_warp.schedules.readout import ForceReader
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics


@pytest.mark.full
@pytest.mark.parametrize("mesh", [QUADS, TRIANGLES], ids=["quads", "triangles"])
def test_viscous_faces_read_velocities_of_their_own_corners(mesh: PolygonMesh) -> None:
    """Viscous faces add to the forces what the force reader, which goes by particles, reports."""
    points = moved(mesh, 1.6)
    velocities = np.random.default_rng(1).normal(size=points.shape).astype(np.float32)
    simulator = Simulator(latex(mesh, "neo_hookean", viscosity=1e4), "cpu")
    shown, read = [], []
    for moving in (velocities, 0.0 * velocities):
        put(simulator, points, moving)
        reader = ForceReader(simulator.model)
        reader.refresh(simulator.state)
        shown.append(reader.net_forces(simulator.state).numpy()[0])
        read.append(measured(mesh, points, 0, "neo_hookean", 1e4, moving)[0])
    added = shown[0] - shown[1]
    assert np.abs(added).max() > 0.1 * np.abs(shown[1]).max()
    np.testing.assert_allclose(read[0] - read[1], added, atol=1e-5 * np.abs(shown[0]).max())

"""Mylar balloon: two flat discs of foil, sewn at the rim and inflated (Paulsen 1994)."""

import numpy as np
import pytest
from conserved import advanced
from meshes import mesh_of, two_discs
from scipy.integrate import quad

from balloon_warp import Balloon, Inflation, Material, Scene, Simulator
from balloon_warp.mesh.topology import signed_volume

pytestmark = [pytest.mark.physics, pytest.mark.nightly]

RADIUS, PRESSURE = 0.3, 40.0
FOIL = Material(kind="neo_hookean", shear_modulus=1.0e7, thickness=2.0e-4, density=1000.0, most_stretch=1.1)
"""stretched by two thousandths, at its center, by this pressure: p r / (2 E h)"""
RINGS = 29
"""of triangles: 5,048 particles"""


def test_it_has_the_rim_the_thickness_and_the_volume_of_the_elliptic_integrals(device: str):
    """Meridian of inextensible foil with wrinkles, z(x) = integral from x to r of t^2 / root(r^4 - t^4)."""
    mesh = two_discs(RINGS, RADIUS)
    balloon = Balloon(mesh=mesh, material=FOIL, inflation=Inflation(pressure=PRESSURE), damping=2.0)
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0), device)
    points = advanced(simulator, 48).points[0].astype(np.float64)
    center = 1 + 3 * RINGS * (RINGS + 1)
    rim = np.linalg.norm(points[center - 6 * RINGS : center, :2], axis=1).mean()
    thickness = np.linalg.norm(points[0] - points[center])
    volume = signed_volume(mesh_of(points, mesh.face_vertex_indices.reshape(-1, 3).tolist()))

    def height(x: float) -> float:
        return quad(lambda t: t * t / np.sqrt(1.0 - t**4), x, 1.0)[0]

    r = RADIUS / quad(lambda t: 1.0 / np.sqrt(1.0 - t**4), 0.0, 1.0)[0]
    found = np.array([rim / r, thickness / (2.0 * r * height(0.0))])
    np.testing.assert_allclose(found, 1.0, atol=0.02)
    expected = 4.0 * np.pi * r**3 * quad(lambda x: x * height(x), 0.0, 1.0)[0]
    np.testing.assert_allclose(volume, expected, rtol=0.02)

"""Thin parts of a balloon: the thickness of a surface, and springs that are softer where it is thin."""

import numpy as np
import pytest
from meshes import cube, joined, mesh_of, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import total_area
from balloon_warp.mesh.thickness import LEAST, relative_thickness
from balloon_warp.model import plan_model
from balloon_warp.scene import Balloon, Scene, Stiffness
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

AROUND = 16
"""corners of each ring"""


def turned(radii: np.ndarray, heights: np.ndarray) -> PolygonMesh:
    """Return a closed surface of rings about the z axis, quads between them and polygons at both ends."""
    angles = 2.0 * np.pi * np.arange(AROUND) / AROUND
    rings = [[r * np.cos(angles), r * np.sin(angles), h + 0.0 * angles] for r, h in zip(radii, heights, strict=True)]
    points = np.array(rings).transpose(0, 2, 1).reshape(-1, 3)
    ring = np.arange(len(radii) * AROUND).reshape(-1, AROUND)
    right = np.roll(ring, -1, axis=1)
    quads = np.stack([ring[:-1], right[:-1], right[1:], ring[1:]], axis=-1).reshape(-1, 4)
    return mesh_of(points, [ring[0, ::-1].tolist(), *quads.tolist(), ring[-1].tolist()])


def ball_with_handle(handle: float, length: float) -> PolygonMesh:
    """Return a ball of radius 1, and a tube upon it of this radius and length."""
    turn = np.linspace(-1.4, np.arccos(handle), 8)  # the quads of both are as long as wide
    edge = 2.0 * np.pi * handle / AROUND
    tube = np.arange(1, int(length / edge) + 1) * edge
    radii = np.concatenate([np.cos(turn), np.full(len(tube), handle), [0.5 * handle]])
    top = np.sin(turn[-1])
    return turned(radii, np.concatenate([np.sin(turn), top + tube, [top + tube[-1] + 0.5 * handle]]))


def tube(radius: float, length: float) -> PolygonMesh:
    heights = np.linspace(0.0, length, 60)
    return turned(np.full(60, radius), heights)


def test_a_sphere_is_as_thick_as_a_sphere_wherever_and_however_divided():
    """The relative thickness of a sphere is 1 however it is divided, within a tenth."""
    for cells in (4, 8, 12):
        thickness = relative_thickness(quad_sphere(cells))
        assert thickness.min() > 0.9
        assert np.ptp(thickness) < 0.06


def test_a_tube_is_thin_in_proportion_to_its_radius():
    """A long tube is 6.4 radii over 2.43 of the radius of the sphere with its area in the middle. Size does not
    matter."""
    for radius in (0.05, 0.1, 0.2):
        mesh = tube(radius, 6.0)
        sphere = np.sqrt(total_area(mesh) / (4.0 * np.pi))
        middle = relative_thickness(mesh)[30 * AROUND]
        assert middle == pytest.approx(6.4 * radius / (2.43 * sphere), rel=0.2)
        mesh.points[:] *= 64.0
        assert relative_thickness(mesh)[30 * AROUND] == pytest.approx(middle, rel=1e-6)


def test_what_cannot_be_measured_counts_as_thick_and_crumbs_as_thin():
    np.testing.assert_array_equal(relative_thickness(cube()), 1.0)  # too coarse
    flat = mesh_of([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [[0, 1, 2]])
    np.testing.assert_array_equal(relative_thickness(flat), 1.0)
    ball, crumb = quad_sphere(5), quad_sphere(2, radius=0.01)
    crumb.points[:] += (3.0, 0.0, 0.0)
    thickness = relative_thickness(joined(ball, crumb))
    np.testing.assert_array_equal(thickness[ball.vertex_count :], LEAST)
    assert thickness[: ball.vertex_count].min() > 0.83


def growth(thin: str) -> tuple[float, float]:
    """Return the growth of the girth at the ball's equator, and half-way along its handle."""
    mesh = ball_with_handle(0.12, 2.0)
    balloon = Balloon(mesh=mesh, damping=2.0, stiffness=Stiffness(structural=5.0, shear=2.5, flexion=0.5, thin=thin))
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, frames_per_second=20.0), "cpu")
    for _ in range(60):
        simulator.step()
    points = simulator.read_frame().points[0].reshape(-1, AROUND, 3).astype(np.float64)
    rest = mesh.points.reshape(-1, AROUND, 3)
    equator = int(np.linalg.norm(rest[..., :2], axis=2).mean(axis=1).argmax())
    girths = [
        np.linalg.norm(np.roll(rings, 1, axis=1) - rings, axis=2).sum(axis=1)[[equator, 28]] for rings in (points, rest)
    ]
    ball, handle = girths[0] / girths[1] - 1.0
    return float(ball), float(handle)


@pytest.mark.full
def test_a_thin_handle_stretches_like_the_ball_it_is_on_where_its_springs_are_softer():
    """A handle with softer springs stretches by 0.6 to 1.6 times as much as the ball. With equal springs it is less
    than a third: the tension around a tube is p r, around a ball p R / 2."""
    ball, handle = growth("alike")
    assert handle < ball / 3.0
    ball, handle = growth("softer")
    assert 0.6 * ball < handle < 1.6 * ball
    assert ball == pytest.approx(0.25, abs=0.1)


def test_softer_springs_change_neither_the_pressure_nor_other_methods_of_stiffness():
    """Default pressure is that of the springs before softening, which multiplies other variations."""
    mesh = ball_with_handle(0.12, 2.0)
    plans = [
        plan_model(
            Scene(balloon=[Balloon(mesh=mesh, stiffness=Stiffness(variation=0.4, gradient=(1.0, 2.0), thin=thin))])
        )
        for thin in ("alike", "softer")
    ]
    pressures = [plan.parameters["keyframe_values"][0, 0, 1] for plan in plans]
    assert pressures[1] == pytest.approx(pressures[0], rel=1e-12)
    alike, softer = (plan.shapes[0] for plan in plans)
    np.testing.assert_allclose(softer.stiffness_scale, alike.stiffness_scale * softer.softness)
    assert (softer.softness.min() < 0.4, softer.softness.max() <= 1.0) == (True, True)

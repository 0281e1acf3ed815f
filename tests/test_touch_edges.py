"""Contact of edges: rims and seams that cross between particles."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from conserved import angular_momentum, masses, momentum, motion
from meshes import grid, mesh_of, quad_sphere
from overlaps import edges_through
from touching import SLACK, VACUUM, quad_box, touching

from balloon_warp.benchmarks.overlap import deepest_overlap
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model.sharp_edges import sharp_edges
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness, Touch
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

FRAMES = 24
SHEET = replace(grid(4, 4), points=0.125 * (grid(4, 4).points - np.array([2.0, 2.0, 0.0])))
"""half a meter wide"""
UPRIGHT = replace(SHEET, points=SHEET.points[:, [0, 2, 1]])


def sheets() -> Scene:
    """Return a sheet that lies, and one that stands and flies at its rim, between particles, and aside. Without
    thickness neither has a particle near a face of the other: they would pass like two cards with slits."""
    still = {"mass": 0.05, "damping": 0.0, "inflation": SLACK}
    balloons = [
        Balloon(mesh=SHEET, **still),
        Balloon(mesh=UPRIGHT, position=(0.52, 0.06, 0.06), velocity=(-1.0, 0.1, 0.2), **still),
    ]
    return Scene(balloon=balloons, touch=Touch(friction=0.5), **VACUUM)


def all_energy(simulator: Simulator) -> float:
    """Return the energy of motion and springs [J]."""
    points, velocities = motion(simulator)
    total = 0.5 * masses(simulator) @ (velocities**2).sum(axis=1)
    stiffness = simulator.model.scene.balloon[0].stiffness
    kinds = np.array([stiffness.structural, stiffness.shear, stiffness.flexion])
    for shape, part in zip(simulator.model.shapes, np.split(points, 2), strict=True):
        first, second = part[shape.springs.pairs].swapaxes(0, 1)
        strain = np.linalg.norm(second - first, axis=1) - shape.springs.rest_lengths
        total += 0.5 * kinds[shape.springs.kind] @ strain**2
    return float(total)


@pytest.fixture
def flown(device: str) -> list[Simulator]:
    return flown_on(device)


@cache
def flown_on(device: str) -> list[Simulator]:
    """Return two worlds, of which the second's sheet is slower, and one that is alone."""
    paths = {"balloon.1.velocity.0": np.array([-1.0, -0.8])}
    simulators = [Simulator(sheets(), device, 2, paths, "gather"), Simulator(sheets(), device, schedule="gather")]
    for simulator in simulators:
        for _ in range(FRAMES):
            simulator.step()
    return simulators


@pytest.mark.full
def test_flat_sheets_that_cross_edge_on_stop_each_other(flown):
    simulator = flown[1]
    points, velocities = motion(simulator)
    assert np.abs(velocities[:25]).max() > 0.1
    assert (points[25:].mean(axis=0) - points[:25].mean(axis=0))[0] > 0.5
    lying, standing = points[:25], points[25:]
    for edge_points, face_points in ((lying, standing), (standing, lying)):
        mesh = replace(SHEET if face_points is lying else UPRIGHT, points=face_points)
        assert not edges_through(edge_points, sharp_edges(SHEET), mesh)


def test_edges_that_meet_keep_what_is_kept(flown, device):
    """Momentum and angular momentum are conserved to float32's rounding of two hundred substeps; and the energy of
    motion and springs never exceeds that at the start."""
    simulator, start = flown[1], Simulator(sheets(), device, schedule="gather")
    for kept in (momentum, angular_momentum):
        assert kept(simulator) == pytest.approx(kept(start), abs=2e-6 * np.abs(kept(start)).max())
    energies, first = [], all_energy(start)
    for _ in range(FRAMES):
        start.step()
        energies.append(all_energy(start))
    assert 0.9 * first < min(energies) <= max(energies) < (1.0 + 1e-6) * first


def test_worlds_do_not_feel_each_other(flown):
    """Worlds are bit-identical to each alone."""
    both, alone = flown
    for name in ("points", "velocities"):
        values = getattr(both.state, name).numpy()
        assert (values[0] == getattr(alone.state, name).numpy()[0]).all()
        assert (values[1] != values[0]).any()


@pytest.mark.parametrize("schedule", ["scatter", "block"])
def test_edges_meet_alike_in_other_schedules(flown, device, schedule):
    """Schedules agree within rounding: edges meet in frame 2, from where on differences grow."""
    simulator, other = Simulator(sheets(), device, schedule="gather"), Simulator(sheets(), device, schedule=schedule)
    for _ in range(6):
        simulator.step()
        other.step()
    assert np.abs(motion(simulator)[1][:25]).max() > 0.1
    assert motion(other)[0] == pytest.approx(motion(simulator)[0], abs=1e-5)


def cushion(cells: int) -> PolygonMesh:
    """Return two flat sheets of 30 cm, joined at their rims."""
    top = grid(cells, cells)
    rim = ((top.points[:, :2] == 0.0) | (top.points[:, :2] == cells)).any(axis=1)
    below = np.where(rim, np.arange(len(rim)), len(rim) + np.cumsum(~rim) - 1)
    faces = top.face_vertex_indices.reshape(-1, 4)
    points = np.concatenate([top.points, top.points[~rim]]) - np.array([cells / 2.0, cells / 2.0, 0.0])
    return mesh_of(0.3 / cells * points, [*faces.tolist(), *below[faces][:, ::-1].tolist()])


def test_foil_cushions_thrown_at_each_other_stay_apart(device):
    """Foil cushions thrown at each other at 2 m/s, one lying, one upright, while they fill, do not interpenetrate: no
    seam cuts into the other, and no particle is deeper than 1 mm, a third of a hundredth of the width. Without contact
    of edges seams were in each other for six frames."""
    mesh = cushion(3)
    upright = replace(mesh, points=mesh.points[:, [0, 2, 1]] * [1.0, -1.0, 1.0])
    foil = {"mass": 0.01, "damping": 0.0, "stiffness": Stiffness(structural=200.0, shear=100.0, flexion=0.0)}
    foil["inflation"] = Inflation(kind="pressure", pressure=[(0.0, 0.0), (0.1, 200.0)])
    balloons = [
        Balloon(mesh=mesh, velocity=(1.0, 0.0, 0.0), **foil),
        Balloon(mesh=upright, position=(0.5, 0.01, 0.02), velocity=(-1.0, 0.0, 0.0), **foil),
    ]
    simulator = Simulator(Scene(balloon=balloons, touch=Touch(), **VACUUM), device, schedule="gather")
    meshes = [shape.mesh for shape in simulator.model.shapes]
    nearest, parts = np.inf, []
    for _ in range(16):
        simulator.step()
        parts = [motion(simulator)[0][begin:end] for begin, end in pairwise(simulator.model.particle_offsets)]
        nearest = min(nearest, parts[1][:, 0].min() - parts[0][:, 0].max())
        assert deepest_overlap(parts, meshes) < 1e-3
        for one, other in ((0, 1), (1, 0)):
            assert not edges_through(parts[one], sharp_edges(mesh), replace(meshes[other], points=parts[other]))
    velocities = motion(simulator)[1]
    assert nearest < 0.01
    assert velocities[: len(parts[0]), 0].mean() < 0.0 < velocities[len(parts[0]) :, 0].mean()  # bounced off


@pytest.mark.parametrize("degrees", [10.0, 20.0, 25.0])
@pytest.mark.parametrize("friction", [0.0, None], ids=["smooth", "as bundled"])
def test_heavy_slack_foil_does_not_come_through(friction: float | None, degrees: float, device):
    """Flat cushions of 0.1 kg and 50 Pa at 4 m/s do not tunnel: no particle is deeper in the other than 3% of the final
    thickness, and they separate again. The thickness at the start is no measure of that. Smooth ones bounce off; where
    skins rub, folds may hold each other until the speed is lost."""
    mesh = cushion(6)
    foil = {"mass": 0.1, "damping": 0.0, "stiffness": Stiffness(structural=50.0, shear=25.0, flexion=0.0)}
    foil["inflation"] = Inflation(kind="pressure", pressure=[(0.0, 0.0), (0.1, 50.0)])
    balloons = [
        Balloon(mesh=mesh, velocity=(2.0, 0.0, 0.0), **foil),
        Balloon(mesh=mesh, position=(0.6, 0.02, 0.03), rotation=(0.0, 0.0, degrees), velocity=(-2.0, 0.0, 0.0), **foil),
    ]
    touch = Touch() if friction is None else Touch(friction=friction)
    simulator = Simulator(Scene(balloon=balloons, touch=touch, **VACUUM), device, schedule="gather")
    deep, apart, thick = 0.0, [], 0.0
    for _ in range(24):
        simulator.step()
        parts = np.split(motion(simulator)[0], 2)
        deep = max(deep, deepest_overlap(parts, [shape.mesh for shape in simulator.model.shapes]))
        thick = max(thick, float(np.ptp(parts[0][:, 2])))
        apart.append((parts[1] - parts[0]).mean(axis=0)[0])
    assert min(apart) > 0.05
    if friction == 0.0:
        assert np.diff(apart)[-1] > 0.0
    assert touching(simulator) == 0
    assert thick > 0.15
    assert deep < 0.03 * thick


def test_which_edges_are_sharp():
    """Sharp edges are rims, the edges of a box, the seam of a cushion; none of what is round."""
    assert len(sharp_edges(SHEET)) == 16
    assert len(sharp_edges(quad_box(3))) == 36
    assert len(sharp_edges(cushion(4))) == 16
    assert len(sharp_edges(quad_sphere(3))) == 0

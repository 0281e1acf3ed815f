"""Contact of edges: rims and seams that cross between particles, and layers of what is folded at the start."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from conserved import after_each, angular_momentum, energy, momentum, motion, put
from meshes import box, grid, mesh_of, quad_sphere
from played import played, shape_at
from touching import SLACK, VACUUM, cushion, edges_through, square, touching, tube

from balloon_warp import Balloon, Ground, Inflation, PolygonMesh, Scene, Simulator, Stiffness, Touch, foil_mesh
from balloon_warp.benchmarks.overlap import deepest_overlap
from balloon_warp.mesh.crossings import find_crossings
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model.meeting_edges import meeting_edges
from balloon_warp.model.shape import shape_balloon
from balloon_warp.model.sharp_edges import sharp_edges
from balloon_warp.scenes.model_airbag import GAP, airbag, airbag_flat

LIMP = Stiffness(structural=50.0, shear=25.0, flexion=0.0)


def crossings(points: np.ndarray, mesh: PolygonMesh) -> int:
    """Return the number of edges that pierce triangles with which they share no corner, in float64."""
    return len(find_crossings(points.astype(np.float64), triangles_of(mesh)).triangles)


def zigzag(folds: int, gap: float) -> PolygonMesh:
    """Return a strip 30 cm wide, folded to and fro, whose layers are closer than its particles."""
    cells = 3
    strip = grid((folds + 1) * (cells + 1) - 1, cells)
    columns = strip.points[:, 0].astype(int)
    layers, within = np.divmod(columns, cells + 1)
    across = np.where(layers % 2 == 0, within, cells - within)
    return replace(strip, points=0.1 * np.column_stack([across, strip.points[:, 1], gap / 0.1 * layers]))


def test_the_airbag_is_folded_without_a_crossing_or_a_stretch():
    mesh, flat = airbag(), airbag_flat()
    assert np.ptp(mesh.points[:, 1]) == pytest.approx(31 * GAP)
    assert crossings(mesh.points, mesh) == 0
    ends = triangle_edges(mesh)
    lengths, sewn = (np.linalg.norm(m.points[ends[:, 0]] - m.points[ends[:, 1]], axis=1) for m in (mesh, flat))
    assert (lengths < 1.001 * sewn).all()


def strip(mesh: PolygonMesh, touch: Touch, **fields: Any) -> Scene:
    """Return a limp folded strip in frames as short as a four-hundred-eightieth of a second."""
    place = {name: fields.pop(name) for name in ("position", "velocity") if name in fields}
    limp = Balloon(mesh=mesh, mass=0.02, stiffness=LIMP, inflation=SLACK, damping=0.0, **place)
    return Scene(balloon=[limp], touch=touch, frames_per_second=480.0, **VACUUM | fields)


def test_layers_of_a_folded_strip_keep_apart(device: str):
    mesh = zigzag(4, 0.004)
    heights = mesh.points[:, 2]
    scene = strip(mesh, Touch(itself=True, thickness=0.002, stiffness=500.0))
    simulator = Simulator(scene, device, schedule="gather")
    velocities = np.zeros_like(mesh.points)
    velocities[:, 2] = -0.5 * np.sign(np.round(heights - heights.mean(), 6))
    put(simulator, velocities=velocities)
    places = [simulator.step().points[0] for _ in range(16)]
    assert [crossings(points, mesh) for points in places] == [0] * 16
    assert min(np.ptp(points[:, 2]) for points in places) < 0.7 * np.ptp(heights)


def test_layers_that_fall_on_the_ground_keep_apart(device: str):
    """What is pushed into the ground, and taken out of it later, would go through what lies on it; with room for 8
    pairs of each edge, at 227 places."""
    mesh = zigzag(6, 0.002)
    flat = replace(mesh, points=mesh.points[:, [0, 2, 1]] * [1.0, 1.0, -1.0])
    falls = {"position": (0.0, 0.001, 0.0), "velocity": (0.0, -4.0, 0.0), "gravity": 9.81, "ground": Ground()}
    scene = strip(flat, Touch(itself=True, thickness=0.001, stiffness=500.0), substeps=12, **falls)
    simulator = Simulator(scene, device, schedule="gather")
    for _ in range(6):
        points = simulator.step().points[0]
        assert crossings(points, flat) == 0
        assert points[:, 1].min() >= 0.0


def test_which_edges_meet():
    """Contact of edges is on for sharp edges, which are rims, seams and the edges of a box, and none of what is round;
    for all of what bends freely and is folded, flat or open, and where balloons touch themselves; for all or none,
    where the scene says so."""
    limp, stiff = (LIMP.model_copy(update={"flexion": flexion}) for flexion in (0.0, 5.0))
    small = square(3, 0.3)
    crate = box((0, 0, 0), (1, 1, 1), (3, 3, 3))
    meshes = [(small, limp), (small, stiff), (quad_sphere(3, 0.3), limp), (crate, stiff), (cushion(4), stiff)]
    balloons = [Balloon(mesh=mesh, stiffness=stiffness) for mesh, stiffness in meshes]
    shapes = [shape_balloon(balloon, Scene(balloon=[balloon])) for balloon in balloons]

    def counts(**said: object) -> list[int]:
        scene = Scene(balloon=balloons, touch=Touch(**said))
        return [len(edges) for edges in meeting_edges(scene, shapes)]

    every = [len(np.unique(triangle_edges(mesh), axis=0)) for mesh, _ in meshes]
    assert counts() == [every[0], 12, 0, 36, 16]
    assert counts(edges=True) == counts(itself=True) == every
    assert counts(edges=False) == [0] * 5


def triangle_edges(mesh: PolygonMesh) -> np.ndarray:
    return np.sort(triangles_of(mesh)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)


def folding_tube(touch: Touch | bool | None) -> tuple[Simulator, PolygonMesh]:
    """Return a tube of 206 vertices whose halves fold until their ends meet at 8 m/s."""
    mesh = tube(rings=17, around=12)
    firm = Stiffness(structural=30.0, shear=15.0, flexion=0.5)
    thrown = Balloon(mesh=mesh, mass=0.2, damping=0.1, stiffness=firm, inflation=Inflation(pressure=0.0))
    scene = Scene(balloon=[thrown], touch=touch, frames_per_second=40.0, **VACUUM)
    simulator = Simulator(scene, "cpu")
    points = simulator.state.points.numpy()
    turning = 8.0 * np.clip(points[..., 0] / 0.2, -1.0, 1.0)
    velocities = np.stack([-turning * points[..., 1], turning * points[..., 0], np.zeros_like(turning)], axis=-1)
    simulator.state.velocities.assign(velocities)
    return simulator, mesh


def test_a_long_tube_that_folds_fast_is_nowhere_in_itself():
    """A tube whose halves fold until their ends meet at 8 m/s does not cross itself; it would at 96 places."""
    simulator, mesh = folding_tube(Touch(itself=True))
    places = [simulator.step().points[0] for _ in range(17)]
    assert [crossings(points, mesh) for points in places] == [0] * 17
    assert np.abs(places[-1][-2:, 0]).max() < 0.1


def test_letters_of_foil_that_meet_fast_come_apart_again():
    """Without edges, or where they do not touch themselves, they are 10 cm deep in each other."""
    letters = [
        Balloon(
            mesh=foil_mesh(letter, height=0.35, edge=0.035), mass=0.05, damping=0.02,
            position=position, rotation=rotation, velocity=velocity,
            stiffness=Stiffness(structural=100.0, shear=50.0, flexion=0.0),
            inflation=Inflation(pressure=[(0.0, 0.0), (0.25, 50.0)]),
        )
        for letter, position, rotation, velocity in (
            ("V", (-0.3, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
            ("L", (0.3, 0.23, -0.14), (90.0, 0.0, 90.0), (-1.0, 0.0, 0.0)),
        )
    ]  # fmt: skip
    simulator = Simulator(Scene(balloon=letters, frames=45, **VACUUM), "cpu")
    first, second = (shape.mesh for shape in simulator.model.shapes)
    faces = [*triangles_of(first).tolist(), *(triangles_of(second) + first.vertex_count).tolist()]
    gaps = []
    for frame in simulator.run():
        gaps.append(frame.points[1][:, 0].mean() - frame.points[0][:, 0].mean())
        if frame.number % 5 == 0:
            points = np.concatenate(frame.points).astype(np.float64)
            assert crossings(points, mesh_of(points, faces)) == 0
    assert min(gaps) < 0.02
    assert gaps[-1] > 0.1
    assert gaps[-1] > gaps[-10]


def test_the_airbag_unfolds_without_a_crossing():
    model, frames = played("airbag")
    meshes = [shape_at(model, frame) for frame in frames[::8]]
    assert [crossings(mesh.points, model.shapes[0].mesh) for mesh in meshes] == [0] * len(meshes)
    assert signed_volume(shape_at(model, frames[-1])) > 0.15


SHEET = square(4, 0.5)
"""half a meter wide"""


def test_flat_sheets_that_cross_edge_on_stop_each_other_and_keep_what_is_kept(device: str):
    """A sheet stands and flies at the rim of one that lies, between particles, and aside. Without thickness neither has
    a particle near a face of the other: they would pass like two cards with slits. Momentum and angular momentum are
    conserved to float32's rounding of two hundred substeps; and the energy of motion and springs never exceeds that at
    the start."""
    upright, still = replace(SHEET, points=SHEET.points[:, [0, 2, 1]]), {"mass": 0.05, "damping": 0.0}
    balloons = [
        Balloon(mesh=SHEET, inflation=SLACK, **still),
        Balloon(mesh=upright, position=(0.52, 0.06, 0.06), velocity=(-1.0, 0.1, 0.2), inflation=SLACK, **still),
    ]
    simulator = Simulator(Scene(balloon=balloons, touch=Touch(friction=0.5), **VACUUM), device, schedule="gather")
    kept = [each(simulator) for each in (momentum, angular_momentum)]
    energies = [energy(simulator), *after_each(simulator, 24, energy)]
    for each, start in zip((momentum, angular_momentum), kept, strict=True):
        assert each(simulator) == pytest.approx(start, abs=2e-6 * np.abs(start).max())
    assert 0.9 * energies[0] < min(energies) <= max(energies) < (1.0 + 1e-6) * energies[0]
    points, velocities = motion(simulator)
    assert np.abs(velocities[:25]).max() > 0.1
    lying, standing = points[:25], points[25:]
    assert (standing.mean(axis=0) - lying.mean(axis=0))[0] > 0.5
    for edges, mesh, faces in ((lying, upright, standing), (standing, SHEET, lying)):
        assert not edges_through(edges, sharp_edges(SHEET), replace(mesh, points=faces))


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
    pairs = after_each(simulator, 24, lambda each: np.split(motion(each)[0], 2))
    apart = [(other - one).mean(axis=0)[0] for one, other in pairs]
    assert min(apart) > 0.05
    if friction == 0.0:
        assert np.diff(apart)[-1] > 0.0
    assert touching(simulator) == 0
    thick = max(np.ptp(one[:, 2]) for one, _ in pairs)
    assert thick > 0.15
    meshes = [shape.mesh for shape in simulator.model.shapes]
    assert max(deepest_overlap(parts, meshes) for parts in pairs) < 0.03 * thick

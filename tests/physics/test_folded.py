"""Contact of edges: rims and seams that cross between particles, and layers that are folded at the start; parts of a
balloon that touches itself, and the work saved by knowing how far apart they are."""

from dataclasses import replace

import numpy as np
import pytest
from conserved import (
    SLACK,
    VACUUM,
    advanced,
    after_each,
    angular_momentum,
    cushion,
    edges_through,
    energy,
    momentum,
    motion,
    square,
    touching,
    tube,
)
from meshes import box, grid, hair, joined, quad_sphere, zigzag
from trajectories import played, shape_at

from balloon_warp import PolygonMesh, Simulator
from balloon_warp.benchmarks.overlap import deepest_overlap
from balloon_warp.kernels.contact.free_frames import BUSY, FREE, HURRIED
from balloon_warp.mesh.crossings import find_crossings
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.thickness import slenderness
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import plan_model
from balloon_warp.model.shape import shape_balloon
from balloon_warp.model.touch import meeting_edges, sharp_edges
from balloon_warp.scene import Balloon, Ground, Inflation, Obstacle, Scene, Stiffness, Touch, load_scene
from balloon_warp.scenes.model_airbag import GAP, airbag, airbag_flat

LIMP = Stiffness(structural=50.0, shear=25.0, flexion=0.0)


def crossings(points: np.ndarray, mesh: PolygonMesh) -> int:
    """Return the number of edges that pierce triangles with which they share no corner, in float64."""
    return len(find_crossings(points.astype(np.float64), triangles_of(mesh)).triangles)


def test_layers_that_fall_on_the_ground_keep_apart(device: str):
    """A part that is pushed into the ground, and taken out of it later, would go through the layer on it; with room for
    8 pairs of each edge, at 227 places."""
    mesh = zigzag(6, 0.002)
    flat = replace(mesh, points=mesh.points[:, [0, 2, 1]] * [1.0, 1.0, -1.0])
    falls = {"position": (0.0, 0.001, 0.0), "velocity": (0.0, -4.0, 0.0), "mass": 0.02, "damping": 0.0}
    limp = Balloon(mesh=flat, stiffness=LIMP, inflation=SLACK, **falls)
    setting = VACUUM | {"gravity": 9.81, "frames_per_second": 480.0, "substeps": 12}
    touch = Touch(itself=True, thickness=0.001, stiffness=500.0)
    simulator = Simulator(Scene(balloon=[limp], touch=touch, ground=Ground(), **setting), device, schedule="gather")
    for _ in range(6):
        points = simulator.step().points[0]
        assert crossings(points, flat) == 0
        assert points[:, 1].min() >= 0.0


def test_which_edges_meet():
    """Sharp edges, which are rims, seams and the edges of a box; all of sheets that bend freely and are folded, flat or
    open, and where balloons touch themselves; all or none, where the scene says so."""
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


def folding_tube(touch: bool | None) -> tuple[Simulator, PolygonMesh]:
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


def test_the_airbag_unfolds_without_a_crossing():
    model, frames = played("airbag")
    meshes = [shape_at(model, frame) for frame in frames[::8]]
    assert [crossings(mesh.points, model.shapes[0].mesh) for mesh in meshes] == [0] * len(meshes)
    assert signed_volume(shape_at(model, frames[-1])) > 0.15


SHEET = square(4, 0.5)
"""half a meter wide"""


def test_flat_sheets_that_cross_edge_on_stop_each_other_and_keep_what_is_kept(device: str):
    """No particle of sheets without thickness is near a face of the other: they would pass like two cards with slits.
    Rounding is of two hundred substeps."""
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


@pytest.mark.parametrize("degrees", [10.0, 20.0, 25.0])
@pytest.mark.parametrize("friction", [0.0, None], ids=["smooth", "as bundled"])
def test_heavy_slack_foil_does_not_come_through(friction: float | None, degrees: float, device):
    """No particle is deeper in the other than 3% of the final thickness: that at the start is no measure. Smooth ones
    bounce off; where skins rub, folds may hold each other until the speed is lost."""
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


def verdict(simulator: Simulator) -> int:
    """Return the verdict on the last frame of a world alone, or since the last search in it."""
    of_contact = getattr(simulator.schedule, "busy", None) or simulator.schedule.launches
    return int(of_contact.working.verdicts.numpy()[0])


def test_the_length_of_a_tube_over_its_diameter_is_its_slenderness():
    """A mesh that is open or has too few vertices to bend is left alone, as balls are; a long tube touches itself,
    softly."""
    for mesh, expected, itself in [
        (quad_sphere(8), np.pi**2 / 4.0, False),
        (grid(8, 8), np.pi, False),
        (hair(40), 19.3, False),
        (tube(65, 48), 2.2 / 0.16, "soft"),
    ]:
        assert slenderness(mesh) == pytest.approx(expected, rel=0.1)
        touch = plan_model(load_scene(mesh)).scene.touch
        assert (touch.itself if touch else False) == itself


def test_a_tube_that_folds_is_nowhere_in_itself_by_default():
    """The halves fold until they meet at 8 m/s; without contact they cross at more than 100 places."""
    simulator, mesh = folding_tube(None)
    assert simulator.schedule.name == "octets"
    seen = []
    for _ in range(60):
        assert crossings(simulator.step().points[0], mesh) == 0
        seen.append(verdict(simulator))
    assert set(seen) == {BUSY, HURRIED}
    simulator, mesh = folding_tube(False)
    assert crossings(advanced(simulator, 60).points[0], mesh) > 100


@pytest.mark.always
@pytest.mark.parametrize(("ways", "expected"), [((0.0, -1.0), HURRIED), ((-1.0, -1.0), FREE), ((0.0, 1.0), FREE)])
def test_parts_that_pass_through_each_other_within_a_frame_are_seen(ways: tuple[float, float], expected: int):
    """Two strips may have met in between if one goes to the other side; not if both go along, or away."""
    flat = grid(8, 2).points * 0.1
    mesh = joined(*(replace(grid(8, 2), points=flat + (0.0, 0.0, height)) for height in (0.0, 0.5)))
    scene = Scene(balloon=[Balloon(mesh=mesh, inflation=Inflation(k_normal=0.0))], touch=Touch(itself=True), **VACUUM)
    simulator = Simulator(scene, "cpu", schedule="octets")
    busy, state = simulator.schedule.busy, simulator.state
    busy.find(state)
    assert verdict(simulator) == FREE
    points = state.points.numpy()
    points[0, : len(flat), 2] += ways[0]
    points[0, len(flat) :, 2] += ways[1]
    state.points.assign(points)
    busy.contact_horizon.judge_afterwards(state)
    assert verdict(simulator) == expected


def true_gap(mesh: PolygonMesh, points: np.ndarray, apart: float) -> float:
    """Return how near particles are to a grid in triangles that they may touch [m]: no less than the true distance."""
    triangles = triangles_of(mesh)
    weights = np.array([(i, j, 8 - i - j) for i in range(9) for j in range(9 - i)]) / 8.0
    places = np.einsum("wk,nkx->nwx", weights, points[triangles])
    least = np.inf
    for particle in range(len(points)):
        rest = np.linalg.norm(mesh.points[triangles] - mesh.points[particle], axis=-1).min(axis=1)
        found = np.linalg.norm(places[rest >= apart] - points[particle], axis=-1)
        least = min(least, float(found.min(initial=np.inf)))
    return least


@pytest.mark.always("0.5")
@pytest.mark.parametrize("bend", [0.0, 0.5, 2.0, 4.0])
def test_the_room_is_no_larger_than_the_gap(bend: float):
    """A tube has some room in a tube until it has bent by a radian in its length."""
    mesh = tube(17, 12)
    simulator = Simulator(load_scene(mesh), "cpu", schedule="octets")
    x, y, z = mesh.points.T
    radius = 1.0 / max(bend, 1e-9) * 2.0
    bent = np.stack([(radius - y) * np.sin(x / radius), radius - (radius - y) * np.cos(x / radius), z], axis=1)
    bent = 1.1 * bent[:, [2, 0, 1]] + 3.0
    state, schedule = simulator.state, simulator.schedule
    state.points.assign(bent[None].astype(np.float32))
    schedule.busy.find(state)
    touch = schedule.busy.contact_horizon._tables.touch
    pad = float(touch.thickness.numpy()[0] + 2.0 * touch.slack.numpy()[0])
    room, gap = float(state.rooms.numpy()[0, 0]), true_gap(mesh, bent, float(touch.apart.numpy()[0]))
    assert room <= gap - pad
    assert verdict(simulator) == (FREE if room > 0.0 else BUSY)
    assert (room > 0.0) == (bend < 1.0)


def test_a_ball_on_a_thin_rod_does_not_cross_itself_where_it_touches_itself_softly():
    most = dict[bool | str, int]()
    mesh = quad_sphere(16, 0.5)
    ball = Balloon(mesh=mesh, position=(0.0, 1.2, 0.0), mass=0.3)
    rod = Obstacle(shape="capsule", radius=0.01, length=2.0, position=(0.0, 0.3, 0.0), rotation=(0.0, 0.0, 90.0))
    for itself in (False, "soft"):
        simulator = Simulator(Scene(balloon=[ball], ground=Ground(), obstacle=[rod], touch=Touch(itself=itself)), "cpu")
        places = [simulator.step().points[0] for _ in range(40)]
        most[itself] = max(crossings(points, mesh) for points in places[30:])
    assert most[False] > 50
    assert most["soft"] == 0


def test_the_airbag_is_folded_without_a_crossing_or_a_stretch():
    mesh, flat = airbag(), airbag_flat()
    assert np.ptp(mesh.points[:, 1]) == pytest.approx(31 * GAP)
    assert crossings(mesh.points, mesh) == 0
    ends = triangle_edges(mesh)
    lengths, sewn = (np.linalg.norm(m.points[ends[:, 0]] - m.points[ends[:, 1]], axis=1) for m in (mesh, flat))
    assert (lengths < 1.001 * sewn).all()

"""Balloons that are folded at the start: their layers are in contact, and no fold crosses another."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import grid, mesh_of, quad_sphere
from played import played, shape_at
from touching import VACUUM

from balloon_warp.foil.make import foil_mesh
from balloon_warp.kernels.contact.list_lengths import PAIRS
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.piercing import find_piercings
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model.folded import is_folded, is_stacked
from balloon_warp.model.meeting_edges import edges_by_leaf, meeting_edges
from balloon_warp.model.shape import shape_balloon
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Stiffness, Touch
from balloon_warp.scenes.model_airbag import GAP, airbag, airbag_flat
from balloon_warp.schedules import balloon_contact
from balloon_warp.schedules.touch_table import substeps_of_search
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

LIMP = Stiffness(structural=50.0, shear=25.0, flexion=0.0)


def crossings(points: np.ndarray, mesh: PolygonMesh) -> int:
    """Return the number of edges that pierce triangles with which they share no corner, in float64."""
    return len(find_piercings(points.astype(np.float64), triangles_of(mesh)).triangles)


def zigzag(folds: int, gap: float) -> PolygonMesh:
    """Return a strip 30 cm wide, folded to and fro, whose layers are closer than its particles."""
    cells = 3
    strip = grid((folds + 1) * (cells + 1) - 1, cells)
    columns = strip.points[:, 0].astype(int)
    layers, within = np.divmod(columns, cells + 1)
    across = np.where(layers % 2 == 0, within, cells - within)
    return replace(strip, points=0.1 * np.column_stack([across, strip.points[:, 1], gap / 0.1 * layers]))


def test_the_airbag_is_folded_without_a_crossing_or_a_stretch():
    """The airbag's 32 layers are 2 mm apart, and no edge is longer than it was sewn."""
    mesh, flat = airbag(), airbag_flat()
    assert np.ptp(mesh.points[:, 1]) == pytest.approx(31 * GAP)
    assert crossings(mesh.points, mesh) == 0
    ends = triangles_of(mesh)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    lengths, sewn = (np.linalg.norm(m.points[ends[:, 0]] - m.points[ends[:, 1]], axis=1) for m in (mesh, flat))
    assert (lengths < 1.001 * sewn).all()


@pytest.mark.parametrize(
    ("mesh", "folded", "stacked"),
    [
        (airbag(), True, True),
        (zigzag(3, 0.002), True, True),
        (foil_mesh("E", height=0.35, edge=0.015), True, False),
        (grid(6, 6), False, False),
        (quad_sphere(6), False, False),
    ],
    ids=["airbag", "zigzag", "foil", "sheet", "ball"],
)
def test_what_is_folded_and_what_is_stacked_is_known(mesh: PolygonMesh, folded: bool, stacked: bool):
    """Foil has two layers, which come near others seldom, and are searched so."""
    assert is_folded(mesh) is folded
    assert is_stacked(mesh) is stacked


def test_foil_is_searched_less_often_than_a_packet():
    def interval(mesh: PolygonMesh) -> int:
        limp = Balloon(mesh=mesh, stiffness=LIMP)
        return substeps_of_search(Simulator(Scene(balloon=[limp], touch=Touch(itself=True), substeps=240), "cpu").model)

    assert interval(foil_mesh("E", height=0.35, edge=0.03)) == 48  # five times a frame
    assert interval(zigzag(3, 0.002)) == 4


@pytest.mark.full
def test_layers_of_a_folded_strip_keep_apart(device: str):
    """Layers of a folded strip, pressed together from both sides at 0.5 m/s, do not cross."""
    mesh = zigzag(4, 0.004)
    middle = mesh.points[:, 2].mean()
    strip = Balloon(mesh=mesh, mass=0.02, stiffness=LIMP, inflation=Inflation(pressure=0.0), damping=0.0)
    scene = Scene(
        balloon=[strip], touch=Touch(itself=True, thickness=0.002, stiffness=500.0), frames_per_second=480.0, **VACUUM
    )
    simulator = Simulator(scene, device, schedule="gather")
    heights = simulator.state.points.numpy()
    velocities = simulator.state.velocities.numpy()
    velocities[0, :, 2] = -0.5 * np.sign(np.round(heights[0, :, 2] - middle, 6))
    simulator.state.velocities.assign(velocities)
    thinnest = np.inf
    for _ in range(16):
        simulator.step()
        points = simulator.state.points.numpy()[0].astype(np.float64)
        thinnest = min(thinnest, float(np.ptp(points[:, 2])))
        assert crossings(points, mesh) == 0
    assert thinnest < 0.7 * np.ptp(mesh.points[:, 2])


@pytest.mark.full
def test_layers_that_fall_on_the_ground_keep_apart(device: str):
    """Layers of a folded strip that falls flat on the ground at 4 m/s do not cross, and none is pushed into the ground.

    Taken out of it later, it would go through what lies on it; with room for 8 pairs of each edge, at 227 places.
    """
    mesh = zigzag(6, 0.002)
    flat = replace(mesh, points=mesh.points[:, [0, 2, 1]] * [1.0, 1.0, -1.0])
    strip = Balloon(
        mesh=flat, mass=0.02, stiffness=LIMP, inflation=Inflation(pressure=0.0), damping=0.0,
        position=(0.0, 0.001, 0.0), velocity=(0.0, -4.0, 0.0),
    )  # fmt: skip
    scene = Scene(
        balloon=[strip], touch=Touch(itself=True, thickness=0.001, stiffness=500.0), ground=Ground(), substeps=12,
        frames_per_second=480.0, **VACUUM | {"gravity": 9.81},
    )  # fmt: skip
    simulator = Simulator(scene, device, schedule="gather")
    for _ in range(6):
        simulator.step()
        points = simulator.state.points.numpy()[0].astype(np.float64)
        assert crossings(points, flat) == 0
        assert points[:, 1].min() >= 0.0


def test_which_edges_meet():
    """Contact of edges is on for sharp edges; for all of what bends freely and is folded, flat or open, and where
    balloons touch themselves; for all or none, where the scene says so."""
    sheet = mesh_of(0.1 * grid(3, 3).points, grid(3, 3).face_vertex_indices.reshape(-1, 4).tolist())
    limp, stiff = (Balloon(mesh=sheet, stiffness=replace_flexion(flexion)) for flexion in (0.0, 5.0))
    ball = Balloon(mesh=quad_sphere(3, 0.3), stiffness=LIMP)
    shapes = [shape_balloon(balloon, Scene(balloon=[balloon])) for balloon in (limp, stiff, ball)]

    def counts(**said: object) -> list[int]:
        scene = Scene(balloon=[limp, stiff, ball], touch=Touch(**said))
        return [len(edges) for edges in meeting_edges(scene, shapes)]

    assert counts() == [33, 12, 0]
    assert counts(edges=True) == counts(itself=True) == [33, 33, 162]
    assert counts(edges=False) == [0, 0, 0]


def replace_flexion(flexion: float) -> Stiffness:
    return LIMP.model_copy(update={"flexion": flexion})


def test_each_edge_is_in_the_first_leaf_that_has_it():
    triangles = triangles_of(grid(2, 2))
    every = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    leaves = np.arange(len(triangles)) // 3
    edges, homes = edges_by_leaf(triangles, leaves, every[::2])
    assert sorted(edges.tolist()) == every[::2].tolist()
    assert homes.tolist() == sorted(homes)
    for edge, home in zip(edges, homes, strict=True):
        having = [leaf for corners, leaf in zip(triangles, leaves, strict=True) if set(edge) <= set(corners)]
        assert home == min(having)


def folding_tube(touch: Touch | bool | None, schedule: str = "auto") -> tuple[Simulator, PolygonMesh]:
    """Return a tube of 206 vertices whose halves fold until their ends meet at 8 m/s."""
    mesh = tube(rings=17, around=12)
    firm = Stiffness(structural=30.0, shear=15.0, flexion=0.5)
    thrown = Balloon(mesh=mesh, mass=0.2, damping=0.1, stiffness=firm, inflation=Inflation(pressure=0.0))
    scene = Scene(balloon=[thrown], touch=touch, frames_per_second=40.0, **VACUUM)
    simulator = Simulator(scene, "cpu", schedule=schedule)
    points = simulator.state.points.numpy()
    turning = 8.0 * np.clip(points[..., 0] / 0.2, -1.0, 1.0)
    velocities = np.stack([-turning * points[..., 1], turning * points[..., 0], np.zeros_like(turning)], axis=-1)
    simulator.state.velocities.assign(velocities)
    return simulator, mesh


@pytest.mark.full
def test_a_long_tube_that_folds_fast_is_nowhere_in_itself():
    """A tube whose halves fold until their ends meet at 8 m/s does not cross itself; it would at 96 places."""
    simulator, mesh = folding_tube(Touch(itself=True))
    places = [simulator.step().points[0].astype(np.float64) for _ in range(17)]
    assert [crossings(points, mesh) for points in places] == [0] * 17
    assert np.abs(places[-1][-2:, 0]).max() < 0.1


def gaps(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return the distances between segments from a to b and from c to d [m]: at an end, or along the common normal."""

    def beside(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        part = np.clip(((p - q) * (r - q)).sum(-1) / ((r - q) ** 2).sum(-1), 0.0, 1.0)
        return np.linalg.norm(q + part[..., None] * (r - q) - p, axis=-1)

    ends = np.min([beside(a, c, d), beside(b, c, d), beside(c, a, b), beside(d, a, b)], axis=0)
    normal = np.cross(b - a, d - c)
    squared = np.maximum((normal**2).sum(-1), 1e-6 * ((b - a) ** 2).sum(-1) * ((d - c) ** 2).sum(-1))
    first = (np.cross(c - a, d - c) * normal).sum(-1) / squared
    second = (np.cross(c - a, b - a) * normal).sum(-1) / squared
    crossing = squared <= (normal**2).sum(-1)  # not parallel
    crossing &= (first > 0.0) & (first < 1.0) & (second > 0.0) & (second < 1.0)
    return np.where(crossing, np.abs(((c - a) * normal).sum(-1)) / np.sqrt(squared), ends)


@pytest.mark.full
@pytest.mark.parametrize(("threads", "room"), [(1, 12), (24, 12), (2, 0)], ids=["alone", "shared", "without room"])
def test_edges_that_may_touch_are_on_the_list(threads: int, room: int, monkeypatch):
    """Pairs that come within the skin and the slack until the next search are listed, whoever shares the search."""
    monkeypatch.setattr(balloon_contact, "threads_on", lambda device, many, turns: (threads, min(threads, 8)))
    for name in ("BOXED_OF_EDGE", "SEEKING_OF_EDGE"):
        monkeypatch.setattr(balloon_contact, name, room)
    simulator, mesh = folding_tube(Touch(itself=True), "gather")
    schedule, state, found = simulator.schedule, simulator.state, []
    t, working = schedule.tables.touch, schedule.launches.working
    edges, rest = t.edges.numpy(), np.asarray(mesh.points)
    near = float(t.thickness.numpy()[0] + 2 * t.slack.numpy()[0])
    first, second = edges[np.stack(np.triu_indices(len(edges), 1))]
    apart = np.linalg.norm(rest[first][:, :, None] - rest[second][:, None], axis=-1).min(axis=(1, 2))
    may = apart >= t.apart.numpy()[0]
    first, second = first[may], second[may]
    for _frame in range(8):
        points, velocities = (array.numpy()[0].astype(np.float64) for array in (state.points, state.velocities))
        substeps = iter(schedule.substeps(state))
        next(substeps)
        listed = working.edge_pairs.numpy()[0, : working.list_lengths.numpy()[0, int(PAIRS)], :2]
        pairs = edges[listed[listed[:, 0] >= 0]]
        for _ in substeps:
            pass
        corners = np.concatenate([first, second], axis=1).T
        ways = [gaps(*(points + part * t.seconds * velocities)[corners]) for part in (0.0, 0.3, 0.6, 1.0)]
        must = {tuple(pair) for pair in corners.T[np.min(ways, axis=0) < 0.999 * near].tolist()}
        relative = np.linalg.norm(velocities[first][:, :, None] - velocities[second][:, None], axis=-1).max(axis=(1, 2))
        can = {tuple(pair) for pair in corners.T[ways[0] < 1.001 * (near + t.seconds * relative)].tolist()}
        assert must <= {tuple(pair) for pair in pairs.reshape(-1, 4).tolist()} <= can
        found.append(len(must))
    assert max(found) > 20


@pytest.mark.full
def test_letters_of_foil_that_meet_fast_come_apart_again():
    """A V and an L of foil that meet at 2 m/s separate again, in a scene that says nothing of touching; without edges,
    or where they do not touch themselves, they are 10 cm deep in each other."""
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


def tube(rings: int, around: int) -> PolygonMesh:
    """Return a closed tube of 2 m along x, 16 cm wide."""
    along, angles = np.linspace(-1.0, 1.0, rings), 2.0 * np.pi * np.arange(around) / around
    points = [(x, 0.08 * np.cos(a), 0.08 * np.sin(a)) for x in along for a in angles]
    ends, following = len(points), np.roll(np.arange(around), -1)
    faces = [
        [first + i, first + j, first + around + j, first + around + i]
        for first in range(0, ends - around, around)
        for i, j in enumerate(following)
    ]
    faces += [[ends, j, i] for i, j in enumerate(following)]
    faces += [[ends + 1, ends - around + i, ends - around + j] for i, j in enumerate(following)]
    return mesh_of([*points, (-1.04, 0.0, 0.0), (1.04, 0.0, 0.0)], faces)


@pytest.mark.full
def test_the_airbag_unfolds_without_a_crossing():
    """The airbag unfolds from its packet to more than 0.15 m^3, without a crossing in every eighth frame."""
    model, frames = played("airbag")
    meshes = [shape_at(model, frame) for frame in frames[::8]]
    assert [crossings(mesh.points, model.shapes[0].mesh) for mesh in meshes] == [0] * len(meshes)
    assert signed_volume(shape_at(model, frames[-1])) > 0.15
